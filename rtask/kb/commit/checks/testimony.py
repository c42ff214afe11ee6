"""Who may say what a robot is, what it did and how that ended: that robot, and people.

Every robot writes into its own graph only, but a question about attempts looks into all graphs.
Without these checks, a robot could end the evidence of another by stating in its own graph that
its outcome is disputed, or change what its hand is.
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
from rtask.kb.store.quads import with_properties
from rtask.rdf.namespaces import PROV, RDF, RDFS, RT
from rtask.rdf.terms import GraphName, Literal, NamedNode, TripleKey

__all__ = ["require_own_testimony"]

_JUDGED_BY = (RT.PhysicsFeedback, RT.HumanFeedback)
_CLASSES: dict[NamedNode, tuple[NamedNode, ...]] = {
    **dict.fromkeys((RT.executesGrasp, RT.hasOutcome, PROV.endedAtTime), (RT.GraspAttempt,)),
    **dict.fromkeys(
        (RT.success, RT.judgedSuccess, RT.disputed, RT.hasReason, RT.placed, RT.placeReason,
         RT.hasFeedback), (RT.GraspOutcome,)),
    **dict.fromkeys((RT.verdict, RT.preset, RT.heldVotes, RT.lostVotes), _JUDGED_BY),
}  # fmt: skip
"""Classes of what a statement may be about, by its property."""
_ABOUT_VALUE = frozenset((RT.outcomeOf, RT.triedIn))
"""Inverses, whose value is the attempt."""


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
        owner = _robot_described(quad, graphs)
        if owner is not None and owner != quote(access.agent or "", safe=""):
            raise _refused(quad, access, owner)
        for node, kind in _testimony(quad):
            asked.setdefault((node, RDF.type, kind), quad)
    if not asked:
        return
    # Looked up together: the same triples are looked up again for the union of all graphs.
    holders.find(asked)
    for key, quad in asked.items():
        owner = _other_owner(holders.of(key), access, graphs)
        if owner is not None:
            raise _refused(quad, access, owner)


def _matters(predicate: NamedNode) -> bool:
    is_stated = predicate.value.startswith((ontology.NS, RDFS.label.value))
    return is_stated or predicate in _ABOUT_VALUE or predicate in _CLASSES


def _robot_described(quad: Quad, graphs: Graphs) -> str | None:
    """Return the robot of which a statement gives a value: its name, or the sizes of its hand.

    Vocabularies of others are free: nothing that robots are told rests on them.
    """
    start = f"{graphs.base}robot/"
    subject = quad.subject
    if (
        isinstance(subject, NamedNode)
        and isinstance(quad.object, Literal)
        and subject.value.startswith(start)
        and quad.predicate.value.startswith((ontology.NS, RDFS.label.value))
    ):
        return subject.value.removeprefix(start).partition("/")[0]
    return None


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


def _refused(quad: Quad, access: Access, owner: str) -> ForbiddenError:
    return ForbiddenError(
        f"the token belongs to {access.agent!r}: it cannot state {quad.predicate} of "
        f"{quad.subject}, which is that of {owner!r}",
        statement=f"{quad.subject} {quad.predicate} {quad.object}",
    )
