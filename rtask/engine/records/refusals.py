"""Refusals to grasp, as the graph keeps them: which confidence was too low, and by how much."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from typing import Literal as OneOf

from rtask.engine.grippers import KnownGripper
from rtask.engine.triples import Triples, rounded, stamp
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import Literal, NamedNode, Quad, Value, iri, literal, moment

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["Refusal", "Response", "store_refusal", "store_response"]

Response = OneOf[
    "second_look",
    "new_object",
    "measured_sides",
    "other_grasp",
    "postponed",
    "pushed",
    "left_alone",
]
"""A robot's action after a refusal, as ``rt:refusalResponse`` keeps it."""


_REPEATED_WITHIN = dt.timedelta(hours=1)
"""Time after the last answer within which the same question repeats it; later it is a new try."""
_STILL_OPEN = literal("postponed")


@dataclass(frozen=True)
class Refusal:
    """A decision against a grasp.

    Parameters
    ----------
    task
        Id that the answer carries.
    gripper
        That was asked for.
    thing
        IRI of the object, known or most alike; empty where nothing resembles it.
    decision
        As :func:`rtask.engine.memory.thresholds.decide` answers it.
    """

    task: str
    gripper: KnownGripper
    thing: str
    decision: Mapping[str, Any]


def store_refusal(context: Context, refusal: Refusal, access: Access) -> NamedNode:
    """Store a refusal in the robot's own graph; return its IRI.

    A robot that asks again before it has responded, or after it has put the object off, gets the
    same refusal if nothing changed: it then has the time and the task of the latest answer, and
    waits for the response to that.
    """
    decision = refusal.decision
    author = context.author(access, refusal.gripper.robot_name)
    home, now = context.home_graph(author), dt.datetime.now(dt.UTC)
    told: dict[NamedNode, Value | None] = {
        PROV.wasAssociatedWith: refusal.gripper.robot,
        RT.refusedWith: refusal.gripper.iri,
        RT.refusedObject: iri(refusal.thing) if refusal.thing else None,
        RT.lackingConfidence: str(decision["too_low"]),
        RT.foundConfidence: rounded(float(decision["confidence"])),
        RT.requiredConfidence: rounded(float(decision["threshold"])),
        RT.refusalReason: str(decision["text"]),
        RT.refusalAdvice: str(decision["advice"]) or None,
    }
    latest: dict[NamedNode, Value | None] = {RT.requestId: refusal.task, RT.atTime: stamp(now)}
    with context.writing:
        triples = Triples()
        node = _repeated(context, told, home, now)
        before: list[Quad] = []
        if node is None:
            node = context.names.unique("refusal")
            triples.node(node, [RT.GraspRefusal], told)
        else:
            before = [
                quad
                for predicate in (*latest, RT.refusalResponse)
                for quad in context.kb.match(node, predicate, None, home)
            ]
        triples.node(node, [], latest)
        with context.kb.transaction(access=author, note="refuse to grasp") as tx:
            tx.remove_quads(before)
            triples.write(tx)
    return node


def _repeated(
    context: Context, told: Mapping[NamedNode, Value | None], home: NamedNode, now: dt.datetime
) -> NamedNode | None:
    """Return the refusal that says the same, if it is recent and no response has ended it.

    What resembles nothing known cannot be told apart, so that each refusal of such is its own.
    """
    if told[RT.refusedObject] is None:
        return None
    # Few refusals of a robot have the same confidence to six digits.
    for same in context.kb.match(None, RT.foundConfidence, told[RT.foundConfidence], home):
        node = same.subject
        if not isinstance(node, NamedNode):
            continue
        if any(q.object != _STILL_OPEN for q in context.kb.match(node, RT.refusalResponse)):
            continue
        if not all(context.kb.match(node, p, v, home) for p, v in told.items() if v is not None):
            continue
        if any(now - _time(quad) <= _REPEATED_WITHIN for quad in context.kb.match(node, RT.atTime)):
            return node
    return None


def store_response(
    context: Context, refusal: NamedNode, response: Response, author: Access
) -> Commit | None:
    """Store the robot's action after a refusal; return None if one is stored already."""
    with context.writing:
        if context.kb.match(refusal, RT.refusalResponse):
            return None
        with context.kb.transaction(access=author, note="respond to a refusal") as tx:
            tx.add(refusal, RT.refusalResponse, literal(response))
    return tx.commit


def _time(quad: Quad) -> dt.datetime:
    return moment(quad.object.value if isinstance(quad.object, Literal) else None)
