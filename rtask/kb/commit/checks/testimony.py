"""Who may say what a robot is, can, and did, and how that ended: that robot, and people.

Every robot writes into its own graph only, but plans and questions about attempts look into all
graphs. Without these checks, a robot could end the evidence of another by stating in its own graph
that its outcome is disputed, change what its hand is, or have it planned for what it cannot do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from urllib.parse import quote

from pyoxigraph import Quad

import ontology
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Holders
from rtask.kb.store.quads import InGraph, with_properties
from rtask.rdf.namespaces import PROV, RDF, RDFS, RT
from rtask.rdf.terms import GraphName, Literal, NamedNode, TripleKey

__all__ = ["require_own_condition", "require_own_testimony"]

_JUDGED_BY = (RT.PhysicsFeedback, RT.HumanFeedback)
_CLASSES: dict[NamedNode, tuple[NamedNode, ...]] = {
    **dict.fromkeys((RT.executesGrasp, RT.hasOutcome, PROV.endedAtTime), (RT.GraspAttempt,)),
    **dict.fromkeys(
        (RT.success, RT.judgedSuccess, RT.disputed, RT.hasReason, RT.placed, RT.placeReason,
         RT.hasFeedback), (RT.GraspOutcome,)),
    **dict.fromkeys((RT.verdict, RT.preset, RT.heldVotes, RT.lostVotes), _JUDGED_BY),
}  # fmt: skip
"""Classes of what a statement may be about, by its property."""
_ABOUT_VALUE = frozenset((RT.outcomeOf, RT.triedIn, RT.carriedOutBy, RT.through))
"""Properties whose value is the attempt: a task that names it says what the attempt was for."""
_ABLE = frozenset(
    (RT.reaches, RT.meets, RT.canGrasp, RT.canPerform, RT.hasCapability, RT.providesCapability,
     RT.hasEndEffector, RT.hasSensor)
)  # fmt: skip
"""What a robot, or a part of it, can do and has: plans are made of these."""
_ABLE_OF_VALUE = frozenset(
    (RT.meets, RT.beyondReachOf, RT.endEffectorOf, RT.sensorOf, RT.placementOf)
)
"""The same, where the robot or its part is the value: its frames stand where it says itself."""


def require_own_testimony(
    quads: Iterable[Quad], access: Access, graphs: Graphs, holders: Holders
) -> None:
    """Raise if a robot describes another robot, or its attempts and outcomes.

    Parameters
    ----------
    quads
        That are added.
    holders
        Of the store as it is without them.

    Raises
    ------
    ForbiddenError
        Naming the statement and the robot.
    """
    if access.role != "robot" or access.of_owner:
        return
    asked: dict[TripleKey, Quad] = {}
    for quad in with_properties(quads, _matters):
        for robot, described in _robots_described(quad, graphs):
            if robot != quote(access.agent or "", safe=""):
                raise _refused(quad, access, robot, described)
        for node, kind in _testimony(quad):
            asked.setdefault((node, RDF.type, kind), quad)
    if not asked:
        return
    # Looked up together: the same triples are looked up again for the union of all graphs.
    holders.find(asked)
    for key, quad in asked.items():
        owner = _other_owner(holders.of(key), access, graphs)
        if owner is not None:
            raise _refused(quad, access, owner, key[0])


def _matters(predicate: NamedNode) -> bool:
    is_stated = predicate.value.startswith((ontology.NS, RDFS.label.value))
    return is_stated or predicate in _CLASSES or predicate == RDF.type


def _robots_described(quad: Quad, graphs: Graphs) -> Iterator[tuple[str, object]]:
    """Yield the robots of which a statement says what they are or can do, by name and term.

    Vocabularies of others are free: nothing that robots are told rests on them.
    """
    predicate, value = quad.predicate, quad.object
    is_of_subject = predicate in _ABLE or (predicate == RDF.type and value == RT.OutOfOrder)
    if isinstance(value, Literal):
        is_of_subject = predicate.value.startswith((ontology.NS, RDFS.label.value))
    if is_of_subject and (robot := _robot_of(quad.subject, graphs)):
        yield robot, quad.subject
    if predicate in _ABLE_OF_VALUE and (robot := _robot_of(value, graphs)):
        yield robot, value


def _robot_of(node: object, graphs: Graphs) -> str:
    """Return the name of the robot that a node is, or is a part of; "" for none."""
    start = f"{graphs.base}robot/"
    if isinstance(node, NamedNode) and node.value.startswith(start):
        return node.value.removeprefix(start).partition("/")[0]
    return ""


def require_own_condition(derived: InGraph, access: Access, graphs: Graphs) -> None:
    """Raise if it follows from what a robot stated that another one is out of order.

    It may give properties of its own any class as domain or range, so that what it states does not
    show it.

    Parameters
    ----------
    derived
        What newly follows.

    Raises
    ------
    ForbiddenError
        Naming the robot or its hand.
    """
    if access.role != "robot" or access.of_owner:
        return
    own = quote(access.agent or "", safe="")
    for subject, _, value in derived.having(RDF.type):
        if value == RT.OutOfOrder and _robot_of(subject, graphs) not in ("", own):
            raise ForbiddenError(
                f"the token belongs to {access.agent!r}: it would follow that {subject}, which is "
                f"that of {_robot_of(subject, graphs)!r}, is out of order"
            )


def _testimony(quad: Quad) -> Iterator[tuple[NamedNode, NamedNode]]:
    """Yield the attempt, outcome or verdict that a statement is about, with its class."""
    if quad.predicate in _ABOUT_VALUE:
        if isinstance(quad.object, NamedNode):
            yield quad.object, RT.GraspAttempt
    elif isinstance(quad.subject, NamedNode):
        for kind in _CLASSES.get(quad.predicate, ()):
            yield quad.subject, kind


def _other_owner(held_by: Sequence[GraphName], access: Access, graphs: Graphs) -> str | None:
    """Return the robot that stored a node; None if nobody did, or the caller."""
    owners = {graphs.owner(graph) for graph in held_by} - {None}
    return None if access.agent in owners else next(iter(sorted(map(str, owners))), None)


def _refused(quad: Quad, access: Access, owner: str, node: object) -> ForbiddenError:
    return ForbiddenError(
        f"the token belongs to {access.agent!r}: it cannot state {quad.predicate} of "
        f"{node}, which is that of {owner!r}",
        statement=f"{quad.subject} {quad.predicate} {quad.object}",
    )
