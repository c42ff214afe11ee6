"""Refusals to grasp, as the graph keeps them: which confidence was too low, and by how much."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from typing import Literal as Choice

from rtask.engine.triples import Triples, rounded, stamp
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import Literal, NamedNode, Quad, Value, iri, literal, moment

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["Refusal", "Response", "refusal_iri", "store_refusal", "store_response"]

Response = Choice[
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
    robot, gripper
        The robot that asked, and the end effector.
    object
        IRI of the object, known or most alike; empty where nothing resembles it.
    decision
        As :func:`rtask.engine.memory.thresholds.decide` answers it.
    at
        When it was refused.
    """

    task: str
    robot: NamedNode
    gripper: NamedNode
    object: str
    decision: Mapping[str, Any]
    at: dt.datetime

    def facts(self) -> dict[NamedNode, Value | None]:
        """Return what a repetition of it has in common with it."""
        decision = self.decision
        return {
            PROV.wasAssociatedWith: self.robot,
            RT.refusedWith: self.gripper,
            RT.refusedObject: iri(self.object) if self.object else None,
            RT.lackingConfidence: str(decision["too_low"]),
            RT.foundConfidence: rounded(float(decision["confidence"])),
            RT.requiredConfidence: rounded(float(decision["threshold"])),
            RT.refusalReason: str(decision["text"]),
            RT.refusalAdvice: str(decision["advice"]) or None,
        }


def refusal_iri(context: Context, refusal: Refusal, author: Access) -> NamedNode:
    """Return the IRI for a refusal.

    A robot that asks again before it has responded, or after it has put the object off, gets the
    same refusal if nothing changed: it then has the time and the task of the latest answer, and
    waits for the response to that. Where the graph is a copy, the earlier one may not be in it yet.
    """
    facts = refusal.facts()
    key = repr(sorted((str(name), str(value)) for name, value in facts.items()))
    node = _repeated(context, facts, context.home_graph(author), refusal.at)
    if node is None and context.pass_on is not None and refusal.object:
        passed_on = context.refusals.get(key)
        if passed_on is not None and refusal.at - passed_on[1] <= _REPEATED_WITHIN:
            is_ended = any(
                quad.object != _STILL_OPEN
                for quad in context.kb.match(passed_on[0], RT.refusalResponse)
            )
            node = None if is_ended else passed_on[0]
    node = node or context.names.unique("refusal")
    if context.pass_on is not None:
        context.refusals.put(key, (node, refusal.at))
    return node


def store_refusal(context: Context, refusal: Refusal, node: NamedNode, author: Access) -> None:
    """Store a refusal in the robot's own graph; one that is there has its latest time and task."""
    home = context.home_graph(author)
    latest: dict[NamedNode, Value | None] = {
        RT.requestId: refusal.task, RT.atTime: stamp(refusal.at),
    }  # fmt: skip
    with context.writing:
        triples = Triples()
        times = [_time(quad) for quad in context.kb.match(node, RT.atTime, None, home)]
        if times and max(times) >= refusal.at:
            return  # it has arrived before
        before: list[Quad] = []
        if times:
            before = [
                quad
                for predicate in (*latest, RT.refusalResponse)
                for quad in context.kb.match(node, predicate, None, home)
            ]
        else:
            triples.node(node, [RT.GraspRefusal], refusal.facts())
        triples.node(node, [], latest)
        with context.kb.transaction(access=author, note="refuse to grasp") as tx:
            tx.remove_quads(before)
            triples.write(tx)


def _repeated(
    context: Context,
    properties: Mapping[NamedNode, Value | None],
    home: NamedNode,
    now: dt.datetime,
) -> NamedNode | None:
    """Return the refusal that says the same, if it is recent and no response has ended it.

    What resembles nothing known cannot be told apart, so that each refusal of such is its own.
    """
    if properties[RT.refusedObject] is None:
        return None
    # Few refusals of a robot have the same confidence to six digits.
    for same in context.kb.match(None, RT.foundConfidence, properties[RT.foundConfidence], home):
        node = same.subject
        if not isinstance(node, NamedNode):
            continue
        if any(q.object != _STILL_OPEN for q in context.kb.match(node, RT.refusalResponse)):
            continue
        if not all(
            context.kb.match(node, p, v, home) for p, v in properties.items() if v is not None
        ):
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
