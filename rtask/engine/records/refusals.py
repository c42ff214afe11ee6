"""Refusals to grasp, as the graph keeps them: which confidence was too low, and by how much."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from rtask.engine.grippers import KnownGripper
from rtask.engine.triples import Triples, rounded, stamp
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit

__all__ = ["Refusal", "Response", "store_refusal", "store_response"]

Response = Literal[
    "second_look",
    "new_object",
    "measured_sides",
    "other_grasp",
    "postponed",
    "pushed",
    "left_alone",
]
"""A robot's action after a refusal, as ``rt:refusalResponse`` keeps it."""


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
    """Store a refusal in the robot's own graph; return its IRI."""
    decision = refusal.decision
    author = context.author(access, refusal.gripper.robot_name)
    with context.writing:
        triples = Triples()
        node = triples.node(
            context.names.unique("refusal"),
            [RT.GraspRefusal],
            {
                PROV.wasAssociatedWith: refusal.gripper.robot,
                RT.refusedWith: refusal.gripper.iri,
                RT.refusedObject: iri(refusal.thing) if refusal.thing else None,
                RT.lackingConfidence: str(decision["too_low"]),
                RT.foundConfidence: rounded(float(decision["confidence"])),
                RT.requiredConfidence: rounded(float(decision["threshold"])),
                RT.refusalReason: str(decision["text"]),
                RT.refusalAdvice: str(decision["advice"]) or None,
                RT.requestId: refusal.task,
                RT.atTime: stamp(dt.datetime.now(dt.UTC)),
            },
        )
        with context.kb.transaction(access=author, note="refuse to grasp") as tx:
            triples.write(tx)
    return node


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
