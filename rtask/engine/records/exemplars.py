"""Things that robots see and handle: which exemplar of a product it is, and where it is now.

A place is stated twice: as an estimate of the product's pose, which is what the robot measured, and
as the placement of a single thing, which is what follows from all that is known of it.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rtask.engine.records.outcomes import Outcome
from rtask.engine.records.places import Sighting, may_have_moved, state_frame_of
from rtask.engine.records.task_tree import place_iri
from rtask.engine.triples import Triples
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri, object_term, python_value
from rtask.world import Relation, WorldEdit
from rtask.world.edit import Seen
from rtask.world.statements import Statement

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper

__all__ = ["Left", "exemplar_handled", "leave_exemplar", "move_exemplar", "see_exemplar"]

_CONTAINERS = frozenset(
    {"bag", "basket", "bin", "bowl", "box", "carton", "container", "crate", "drawer"}
)
"""Words in the names of places in which things are, rather than on them."""


def see_exemplar(context: Context, edit: WorldEdit, sighting: Sighting, exemplar: str = "") -> str:
    """State which thing of a product is seen, and where; return its IRI.

    Parameters
    ----------
    exemplar
        IRI of the thing, if the robot says which one it means.
    """
    place = sighting.located
    frame = state_frame_of(Triples(), sighting.robot, place.frame_id)
    hands = _hands(context, sighting.robot)
    return edit.see(
        Seen(
            sighting.object_iri.value, frame.value, place.frame_from_object,
            sighting.time.timestamp(), confidence=place.confidence,
            min_extent_m=_min_extent(context, sighting.object_iri), is_round=place.is_round,
            robot=sighting.robot.value, hands=hands, agent=sighting.agent.value,
            source="" if sighting.event is None else sighting.event.value, exemplar=exemplar,
        )
    )  # fmt: skip


def exemplar_handled(
    context: Context, edit: WorldEdit, object_iri: NamedNode, gripper: StoredGripper,
    outcome: Outcome,
) -> str:  # fmt: skip
    """Return the thing that a robot handled without saying which one; "" if nobody knows it.

    What it held was one for certain, though nobody may have seen it before.
    """
    hands = _hands(context, gripper.robot)
    exemplar = edit.exemplar_of(object_iri.value, gripper.robot.value, hands)
    if not exemplar and outcome.held:
        return edit.make_exemplar(object_iri.value)
    return exemplar


@dataclass(frozen=True)
class Left:
    """How an attempt left the thing that it was made on.

    Parameters
    ----------
    hand
        IRI of the end effector.
    held, placed
        Whether it was held, and whether it reached its destination, if that is known.
    place, place_name
        Where it was put, as the robot named it; None and empty if it did not.
    """

    hand: NamedNode
    held: bool
    placed: bool | None
    place: NamedNode | None = None
    place_name: str = ""


def move_exemplar(
    edit: WorldEdit,
    exemplar: str,
    gripper: StoredGripper,
    outcome: Outcome,
    ended: dt.datetime,
    source: NamedNode,
) -> None:
    """State where an attempt left a thing; see :func:`leave_exemplar`."""
    if not exemplar or not may_have_moved(outcome):
        return
    name = outcome.report.place or ""
    place = place_iri(gripper.robot, name) if name else None
    left = Left(gripper.iri, outcome.held, outcome.placed, place, name)
    if outcome.held:
        edit.statements += _reached(edit, exemplar, gripper.robot, ended.timestamp())
    leave_exemplar(edit, exemplar, left, ended.timestamp(), gripper.robot, source)


def _reached(edit: WorldEdit, exemplar: str, robot: NamedNode, time_s: float) -> list[Statement]:
    """Return that a robot reaches the table or box from which it has taken a thing.

    That its hand got there stays so, even if somebody finds that it held nothing.
    """
    before = edit.place_by(exemplar, time_s)
    if before is None or before.relation not in ("on", "in") or not before.holds_at(time_s):
        return []
    if edit.world.product_of(before.place):  # a tray is carried about
        return []
    reached: Statement = (robot, RT.reaches, iri(before.place))
    return [] if edit.world.kb.match(*reached) else [reached]


def leave_exemplar(
    edit: WorldEdit, exemplar: str, left: Left, time_s: float, robot: NamedNode, source: NamedNode
) -> None:
    """State where an attempt that may have moved a thing left it.

    It is held by the end effector if nothing is said of placing it, and in or on the place where
    it was put if the robot names that. If it was lost, put down somewhere, or let go at a place
    without being seen there, its place is unknown until it is seen again.
    """
    relation: Relation = "held_by"
    target: NamedNode | None = None
    if left.held and left.placed is None and left.place is None:
        target = left.hand
    elif left.held and left.placed and left.place is not None:
        target = left.place
        relation = "in" if _CONTAINERS & set(left.place_name.lower().split()) else "on"
    if target is None:
        edit.lose(exemplar, time_s)
        return
    edit.put(exemplar, relation, target.value, time_s, robot.value, source.value)


def _hands(context: Context, robot: NamedNode) -> tuple[str, ...]:
    return tuple(hand.iri.value for hand in context.grippers.all() if hand.robot == robot)


def _min_extent(context: Context, object_iri: NamedNode) -> float:
    """Return the smaller horizontal extent of a product, m, or 0 if it is not stored."""
    if context.names.is_new(object_iri):
        return 0.0
    extents = [
        float(str(python_value(object_term(quad.object))))
        for predicate in (RT.extentX, RT.extentY)
        for quad in context.kb.match(object_iri, predicate)
    ]
    return min(extents, default=0.0)
