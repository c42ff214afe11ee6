"""Reports of a robot's action after a refusal to grasp, once for each refusal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.operations.operation import operation
from rtask.engine.records.refusals import Response, store_response
from rtask.errors import ForbiddenError, UnknownTermError
from rtask.rdf.namespaces import PROV, RDF, RT
from rtask.rdf.terms import Literal, NamedNode, iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["ReportRefusal", "ReportedRefusal", "report_refusal"]


class ReportRefusal(Message):
    """The action of a robot after a refusal to grasp."""

    refusal: Iri
    """IRI of the refusal, from the decision"""
    response: Response
    """second_look, new_object (grasped although not recognised), measured_sides (located without
    the doubtful pose), other_grasp (of another planner), postponed, pushed or left_alone"""


class ReportedRefusal(Answer):
    """Whether the action was stored."""

    stored: int
    """0 if an action after this refusal is already stored"""
    commit: str


@operation("write", "writes", "store what a robot did after a refusal to grasp", deferrable=True)
def report_refusal(context: Context, request: ReportRefusal, access: Access) -> ReportedRefusal:
    """Store the action in the graph of the robot that was refused."""
    refusal = iri(request.refusal)
    homes = [quad.graph_name for quad in context.kb.match(refusal, RDF.type, RT.GraspRefusal)]
    if not homes:
        raise UnknownTermError(f"refusal: the graph has no refusal {request.refusal}")
    author = context.author(access, _robot_of(context, refusal))
    if access.agent is not None and context.home_graph(author) not in homes:
        raise ForbiddenError(f"refusal: {request.refusal} is that of another robot")
    commit = store_response(context, refusal, request.response, author)
    if commit is None:
        return ReportedRefusal(stored=0, commit="")
    return ReportedRefusal(stored=1, commit=context.commit_id(commit))


def _robot_of(context: Context, refusal: NamedNode) -> str | None:
    """Return the name of the robot that was refused."""
    for robot in context.kb.match(refusal, PROV.wasAssociatedWith):
        if isinstance(robot.object, NamedNode):
            for name in context.kb.match(robot.object, RT.name):
                if isinstance(name.object, Literal):
                    return name.object.value
    return None
