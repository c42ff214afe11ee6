"""Preparation of received objects: decoded, recognised and located, not yet stored."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.question import question_for
from rtask.engine.memory.recall import recall
from rtask.engine.observation import Observation
from rtask.engine.perception.growth import Growth, grow
from rtask.engine.perception.identity import is_plausible, recognise, settle
from rtask.engine.perception.observation import Look, observe_once
from rtask.engine.perception.placement import Placement
from rtask.engine.perception.poses import ObjectPose, last_heading, locate
from rtask.engine.records.identity import check_operator, check_task, confirmed
from rtask.engine.records.objects import no_object, viewpoint_of
from rtask.engine.records.outcomes import Outcome, OutcomeReport
from rtask.engine.records.places import Located, located
from rtask.engine.records.received import TWO_TURNS_RAD, Received, received
from rtask.engine.records.record import Earlier, earlier
from rtask.engine.remembered import Memory, RememberedObject
from rtask.engine.terms import folded
from rtask.errors import UnknownTermError, UsageError
from rtask.kb.durability.blobs import Blob
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import read
from rtask.wire.request_id import StoredOnce
from rtask.wire.types import Flag, Grasp, Iri, Number, Text, Unit

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition
    from features.words.word import Word
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["NewObject", "Prepared", "Repeated", "classes_named", "prepare", "stored_before"]

_MAX_MATCHES = 5


class NewObject(Look):
    """An observed object and the outcome of grasping it."""

    object: Iri | None = None
    """IRI of an object that the robot has tracked; default: recognised, or new"""
    thing: Iri | None = None
    """IRI of the single thing, if the robot knows which one it is; default: by place and time"""
    name: Text | None = None
    """name of the object; default: made of kind and number"""
    class_description: Text | None = None
    """kind of object in words; default: guessed from the shape"""
    function: Text | None = None
    """function of the object: write, contain liquid, ...; default: not known"""
    gripper_id: Text | None = None
    """name or IRI of the end effector used; default: the robot's only one"""
    task: Text = "pick"
    """purpose of the grasp: pick, place, push"""
    grasp: Grasp | None = None
    """the attempted grasp, as received; default: given by X, Y, Z and rad"""
    X: Annotated[Number, Unit("m")] | None = None
    """of the grasp, in the frame of the cloud; default: no grasp"""
    Y: Annotated[Number, Unit("m")] | None = None
    """of the grasp, in the frame of the cloud; default: no grasp"""
    Z: Annotated[Number, Unit("m")] | None = None
    """of the grasp, in the frame of the cloud; default: no grasp"""
    rad: Annotated[Number, Unit("rad"), Ge(-TWO_TURNS_RAD), Le(TWO_TURNS_RAD)] | None = None
    """closing direction of the grasp, in the frame of the cloud; default: no grasp"""
    success: Flag = True
    """whether the grasp held, without an outcome"""
    confirmed_by: Literal["physics", "human"] | None = None
    """who confirmed it; default: a person"""
    operator: Text | None = None
    """name of the person who confirmed it; default: nobody"""
    outcome: OutcomeReport | None = None
    """the outcome; default: given by success"""
    task_id: Annotated[Text | None, StoredOnce()] = None
    """from recognise_for_grasp, or any id; stored once for each id; default: a new task"""
    merge: Flag = True
    """add the view to the object if it is recognised"""


@dataclass(frozen=True)
class Prepared:
    """An entry that is decoded, recognised and located, but not yet stored.

    Parameters
    ----------
    generation
        Generation of the index in which it was recognised.
    vector : (d,) float32 or None
        Vector of the view, if a network is in use.
    located
        Pose of the object in the frame that the request names, if it is certain.
    resembles
        The stored object that a new one may be, and how sure that is; None where it resembles none
        enough for another view to decide.
    words
        Words on the view; None where they are not read.
    """

    item: NewObject
    where: str
    seen: Observation
    existing: RememberedObject | None
    placement: Placement | None
    gripper: StoredGripper | None
    grasp: Received | None
    outcome: Outcome | None
    view: NamedNode
    growth: Growth | None
    generation: int = 0
    vector: NDArray[np.float32] | None = None
    located: Located | None = None
    resembles: tuple[RememberedObject, float] | None = None
    words: tuple[Word, ...] | None = None


@dataclass(frozen=True)
class Repeated:
    """An entry whose id is already stored, or whose view is."""

    task_id: str
    before: Earlier
    gripper: StoredGripper | None


def prepare(context: Context, item: NewObject, where: str, access: Access) -> Prepared | Repeated:
    """Return an entry ready to be stored, or the result of an earlier request with its id.

    Raises
    ------
    UnknownTermError
        It names an unknown object or gripper.
    UsageError
        Its fields contradict each other.
    ConflictError
        An earlier request with its id reported another outcome.
    """
    gripper = _gripper(context, item, access)
    check_task(context, item.task_id, access, where)
    check_operator(item.operator, access, where)
    if item.outcome is not None:
        report = confirmed(item.outcome, access, f"{where}outcome.")
        item = item.model_copy(update={"outcome": report})
    repeated = _repeated(context, item, gripper, where, access)
    if repeated is not None:
        return repeated
    seen = observe_once(context, item, where)
    kinds = classes_named(context, item.class_description)
    recogniser = context.views.recogniser  # which reads the index, a generation of its own, if new
    generation = context.views.generation
    recognition = recognise(recogniser, seen, context.policy, _MAX_MATCHES, words=context.words)
    question = question_for(
        context.policy, seen, recognition, item.object, gripper,
        () if item.object else tuple(kind.value for kind in kinds),
    )  # fmt: skip
    # Grasps of other objects of the class are no part of an insertion.
    memory = recall(context.kb, replace(question, classes=()))
    recognition = settle(recognition, memory, seen, context.policy)
    existing = _existing(context, item, recognition, memory, has_kind=bool(kinds))
    if existing is not None and _is_view_alone(item):
        same = _view_with(context, iri(existing.iri), seen.data)
        if same:
            return Repeated(item.task_id or "", Earlier(existing.iri, view=same), gripper)
    heading = last_heading(context, gripper.robot if gripper else None, item.object, seen)
    placement, pose = locate(context.models, seen, recognition, existing, memory, heading)
    decision = context.decisions.get(item.task_id)
    grasp = _grasp(item, where)
    if grasp is not None:
        grasp = grasp.placed(placement).completed(decision)
    outcome = _outcome(context, item, grasp, access, where)
    if item.outcome is not None and gripper is None:
        raise UsageError(
            f"{where}gripper_id is missing: an outcome needs a gripper; "
            "register it with register_robot", field=where + "gripper_id",
        )  # fmt: skip
    view = context.names.unique("view")
    is_round = placement is not None and placement.is_round
    # What a robot names may be another thing than it says: such a view must not bend the model.
    is_alike = existing is None or is_plausible(existing, seen, context.policy)
    growth = grow(
        context.models, None if existing is None else iri(existing.iri), seen,
        _viewpoint(seen, existing, placement, pose) if is_alike else None, view, is_round,
    )  # fmt: skip
    embeddings = context.views.embeddings
    vector = None if embeddings is None else embeddings.vector_of(seen)
    # The robot says which object it is, or this view defines a new one; else it was recognised.
    is_given = existing is None or item.object is not None
    place = located(
        seen, item.frame_id, placement, pose,
        1.0 if is_given else float(recognition.matches[0].confidence), is_round,
    )  # fmt: skip
    return Prepared(
        item, where, seen, existing, placement, gripper, grasp, outcome, view, growth, generation,
        vector, place, _resembled(item, existing, recognition, memory),
        None if context.words is None else context.words.read(seen),
    )  # fmt: skip


def _repeated(
    context: Context, item: NewObject, gripper: StoredGripper | None, where: str, access: Access
) -> Repeated | None:
    """Return what an earlier request with the entry's id stored; refuse another outcome."""
    before = stored_before(context, item.task_id, access, gripper)
    if before is None:
        return None
    if item.outcome is not None:
        reported = Outcome.of(item.outcome, context.reasons, f"{where}.outcome")
        before.refuse_contradiction(item.task_id or "", reported.held)
    return Repeated(item.task_id or "", before, gripper)


def _resembled(
    item: NewObject, existing: RememberedObject | None, recognition: Recognition, memory: Memory
) -> tuple[RememberedObject, float] | None:
    """Return the stored object that a new one may be, and how likely, for a person to decide."""
    if existing is not None or not item.merge or not recognition.ask_again:
        return None
    first = recognition.matches[0]
    return memory.objects[first.object_iri], float(first.confidence)


def _existing(
    context: Context, item: NewObject, recognition: Recognition, memory: Memory, *, has_kind: bool
) -> RememberedObject | None:
    """Return the stored object that an entry is about; None for a new one.

    Raises
    ------
    UnknownTermError
        It names an unknown object.
    """
    if item.object:
        existing = memory.objects.get(item.object)
        if existing is None:
            raise no_object(context, item.object)
        return existing
    # A kind that nobody knows is a new kind: what was recognised is of another one.
    if item.merge and recognition.accepted and (has_kind or not item.class_description):
        return memory.objects.get(recognition.matches[0].object_iri)
    return None


def _viewpoint(
    seen: Observation,
    existing: RememberedObject | None,
    placement: Placement | None,
    pose: ObjectPose | None,
) -> NDArray[np.float64] | None:
    """Return the pose of the camera in the object's frame if it is certain."""
    if pose is not None and pose.accepted and existing is not None and not existing.is_round:
        return pose.object_from_camera
    if placement is None or not placement.is_verified:
        return None
    return viewpoint_of(seen, placement)


def stored_before(
    context: Context, task_id: str | None, access: Access, gripper: StoredGripper | None
) -> Earlier | None:
    """Return the result of an earlier request with this id and author."""
    if task_id is None:
        return None
    author = context.author(access, gripper.robot_name if gripper else None)
    agents = [context.agent_iri(author), *([gripper.robot] if gripper else [])]
    return earlier(context, task_id, agents)


def _is_view_alone(item: NewObject) -> bool:
    """Tell whether an entry reports neither a grasp nor where the object is."""
    fields = (item.grasp, item.X, item.Y, item.Z, item.rad, item.outcome, item.frame_id)
    return all(value is None for value in fields)


def _view_with(context: Context, object_iri: NamedNode, data: bytes) -> str:
    """Return the view of an object that was made of these very bytes, or nothing.

    Stored twice, one picture would confirm itself where views of an object are to confirm each
    other.
    """
    blob = Blob(hashlib.sha256(data).hexdigest(), len(data), "").iri
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?view WHERE {{ ?content rt:hasBlob {blob} . ?view rt:viewContent ?content .
  {object_iri} rt:hasView ?view }} ORDER BY ?view LIMIT 1""")
    return next((str(row.value("view")) for row in rows), "")


def _gripper(context: Context, item: NewObject, access: Access) -> StoredGripper | None:
    try:
        return context.grippers.find(item.gripper_id, access, is_acting=True)
    except UnknownTermError:
        if item.gripper_id:
            raise
        return None


def classes_named(context: Context, description: str | None) -> list[NamedNode]:
    """Return the classes with exactly this name."""
    if not description:
        return []
    name = folded(description)
    kinds = context.classes.find(description)
    return [kind.iri for kind in kinds if name in map(folded, kind.names)]


def _grasp(item: NewObject, where: str) -> Received | None:
    if item.grasp is not None:
        return received(item.grasp, where + "grasp")
    x, y, z, rad = item.X, item.Y, item.Z, item.rad
    if x is None and y is None and z is None and rad is None:
        return None
    if x is None or y is None or z is None or rad is None:
        raise UsageError(f"{where}X: X, Y, Z and rad must be given together", field=where + "X")
    return Received(in_frame=(x, y, z, rad))


def _outcome(
    context: Context, item: NewObject, grasp: Received | None, access: Access, where: str
) -> Outcome | None:
    report = item.outcome
    if report is None:
        if grasp is None:
            return None
        # As in the thesis, a person has validated the insertion (Gatto 2016, 3.2.4).
        given = {"success": item.success, "confirmed_by": item.confirmed_by or "human"}
        report = read(OutcomeReport, {**given, "operator": item.operator})
        report = confirmed(report, access, where)
    elif grasp is None:
        raise UsageError(f"{where}grasp is missing: an outcome needs a grasp")
    outcome = Outcome.of(report, context.reasons, where + "outcome")
    return outcome.by_our_clock(context.policy.clock_ahead_s)
