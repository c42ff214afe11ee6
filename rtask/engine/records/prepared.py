"""What a robot sends to be stored, decoded, recognised and located; nothing is stored yet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from rtask.engine.grippers import KnownGripper
from rtask.engine.memory.question import question_for
from rtask.engine.memory.recall import recall
from rtask.engine.observation import Observation
from rtask.engine.perception.growth import Growth, grow
from rtask.engine.perception.identity import is_plausible, recognise, settle
from rtask.engine.perception.observation import Look, observe_once
from rtask.engine.perception.placement import Placement
from rtask.engine.perception.poses import ObjectPose, locate
from rtask.engine.records.objects import viewpoint_of
from rtask.engine.records.received import Outcome, OutcomeReport, Received, received
from rtask.engine.records.record import Earlier, earlier
from rtask.engine.remembered import KnownObject
from rtask.engine.terms import folded
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import read
from rtask.wire.types import Flag, Grasp, Iri, Number, Text

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["NewObject", "Prepared", "Repeated", "classes_named", "prepare", "stored_before"]

_MOST_MATCHES = 5


class NewObject(Look):
    """An object that was seen, and what came of grasping it."""

    object: Iri | None = None
    """IRI of the object, when the robot followed it and knows; default: recognised, or new"""
    name: Text | None = None
    """what people call this one object; default: made of kind and number"""
    class_description: Text | None = None
    """what kind of thing it is, in words; default: guessed from the shape"""
    function: Text | None = None
    """what it is for: write, contain liquid, ...; default: not known"""
    gripper_id: Text | None = None
    """name or IRI of the end effector that tried; default: the robot's only one"""
    task: Text = "pick"
    """what it was for: pick, place, push"""
    grasp: Grasp | None = None
    """the grasp that was tried, as received; default: given by X, Y, Z and rad"""
    X: Number | None = None
    """grasp in the frame of the cloud, m and rad; default: no grasp"""
    Y: Number | None = None
    """grasp in the frame of the cloud, m and rad; default: no grasp"""
    Z: Number | None = None
    """grasp in the frame of the cloud, m and rad; default: no grasp"""
    rad: Number | None = None
    """grasp in the frame of the cloud, m and rad; default: no grasp"""
    success: Flag = True
    """whether the grasp held, when no outcome is given"""
    confirmed_by: Literal["physics", "human"] | None = None
    """who says so; default: a person"""
    operator: Text | None = None
    """the person, when a person says so; default: nobody"""
    outcome: OutcomeReport | None = None
    """what came of it; default: given by success"""
    task_id: Text | None = None
    """from recognise_for_grasp, or any id: the same id stores once; default: a new task"""
    merge: Flag = True
    """add the view to a recognised object"""


@dataclass(frozen=True)
class Prepared:
    """One entry, decoded, recognised and located; nothing stored yet.

    Parameters
    ----------
    generation
        Of the index in which it was recognised.
    """

    item: NewObject
    where: str
    seen: Observation
    known: KnownObject | None
    placement: Placement | None
    gripper: KnownGripper | None
    grasp: Received | None
    outcome: Outcome | None
    view: NamedNode
    growth: Growth | None
    generation: int = 0


@dataclass(frozen=True)
class Repeated:
    """One entry whose id was stored before."""

    task_id: str
    before: Earlier
    gripper: KnownGripper | None


def prepare(context: Context, item: NewObject, where: str, access: Access) -> Prepared | Repeated:
    """Return an entry ready to be written, or what an earlier request of its id stored.

    Raises
    ------
    UnknownTermError
        When it names an object or a gripper that the graph does not know.
    UsageError
        When its fields do not belong together.
    """
    gripper = _gripper(context, item, access)
    before = stored_before(context, item.task_id, access, gripper)
    if before is not None:
        return Repeated(item.task_id or "", before, gripper)
    seen = observe_once(context, item, where)
    kinds = classes_named(context, item.class_description)
    generation = context.views.generation
    recognition = recognise(context.views.recogniser, seen, context.policy, _MOST_MATCHES)
    question = question_for(
        context.policy, seen, recognition, item.object, gripper,
        () if item.object else tuple(kind.value for kind in kinds),
    )  # fmt: skip
    memory = recall(context.kb, question)
    recognition = settle(recognition, memory, seen, context.policy)
    known = None
    if item.object:
        known = memory.objects.get(item.object)
        if known is None:
            raise UnknownTermError(f"the graph knows no object {item.object}")
    elif item.merge and recognition.accepted and (kinds or not item.class_description):
        known = memory.objects.get(recognition.matches[0].object_iri)
    placement, pose = locate(context.models, seen, recognition, known, memory)
    decision = context.decisions.get(item.task_id)
    grasp = _grasp(item, where)
    if grasp is not None:
        grasp = grasp.placed(placement).completed(decision)
    outcome = _outcome(context, item, grasp, where)
    if item.outcome is not None and gripper is None:
        raise UsageError(
            f"{where}gripper_id is missing: an outcome is one of a gripper; "
            "register_robot introduces it", field=where + "gripper_id",
        )  # fmt: skip
    view = context.names.unique("view")
    is_alike = known is None or is_plausible(known, seen, context.policy)
    is_round = placement is not None and placement.is_round
    growth = grow(
        context.models, None if known is None else iri(known.iri), seen,
        _viewpoint(seen, known, placement, pose) if is_alike else None, view, is_round,
    )  # fmt: skip
    return Prepared(
        item, where, seen, known, placement, gripper, grasp, outcome, view, growth, generation
    )


def _viewpoint(
    seen: Observation,
    known: KnownObject | None,
    placement: Placement | None,
    pose: ObjectPose | None,
) -> NDArray[np.float64] | None:
    """Return how the camera stood to the object, when that is sure."""
    if pose is not None and pose.accepted and known is not None and not known.is_round:
        return pose.object_from_camera
    if placement is None or not placement.is_verified:
        return None
    return viewpoint_of(seen, placement)


def stored_before(
    context: Context, task_id: str | None, access: Access, gripper: KnownGripper | None
) -> Earlier | None:
    """Return what an earlier request of this id and author stored."""
    if task_id is None:
        return None
    author = context.author(access, gripper.robot_name if gripper else None)
    agents = [context.agent_iri(author), *([gripper.robot] if gripper else [])]
    return earlier(context, task_id, agents)


def _gripper(context: Context, item: NewObject, access: Access) -> KnownGripper | None:
    try:
        return context.grippers.find(item.gripper_id, access.agent)
    except UnknownTermError:
        if item.gripper_id:
            raise
        return None


def classes_named(context: Context, description: str | None) -> list[NamedNode]:
    """Return the classes whose names are the description, not only begin with it."""
    if not description:
        return []
    wanted = folded(description)
    found = context.classes.find(description)
    return [kind.iri for kind in found if wanted in map(folded, kind.names)]


def _grasp(item: NewObject, where: str) -> Received | None:
    if item.grasp is not None:
        return received(item.grasp, where + "grasp")
    x, y, z, rad = item.X, item.Y, item.Z, item.rad
    if x is None and y is None and z is None and rad is None:
        return None
    if x is None or y is None or z is None or rad is None:
        raise UsageError(f"{where}X: X, Y, Z and rad belong together", field=where + "X")
    return Received(in_frame=(x, y, z, rad))


def _outcome(
    context: Context, item: NewObject, grasp: Received | None, where: str
) -> Outcome | None:
    report = item.outcome
    if report is None:
        if grasp is None:
            return None
        # As in the thesis, the operator has validated what is inserted (Gatto 2016, 3.2.4).
        said = {"success": item.success, "confirmed_by": item.confirmed_by or "human"}
        report = read(OutcomeReport, {**said, "operator": item.operator})
    elif grasp is None:
        raise UsageError(f"{where}grasp is missing: an outcome is one of a grasp")
    return Outcome.of(report, context.reasons, where + "outcome")
