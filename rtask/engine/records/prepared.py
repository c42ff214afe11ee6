"""What a robot sends to be stored, decoded, recognised and located; nothing is stored yet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.engine.memory.recall import KnownObject, recall
from rtask.engine.operations.messages import Field, read
from rtask.engine.operations.recognise import SIGHT, locate, question_for
from rtask.engine.operations.robots import KnownGripper
from rtask.engine.perception.identity import is_plausible, recognise, settle
from rtask.engine.perception.models import Growth, grow
from rtask.engine.perception.observation import Observation
from rtask.engine.perception.placement import Placement
from rtask.engine.perception.poses import ObjectPose
from rtask.engine.records.objects import viewpoint_of
from rtask.engine.records.received import OUTCOME, Outcome, Received, received
from rtask.engine.records.record import Earlier, earlier
from rtask.engine.terms import folded
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.kb.commit.access import Access

__all__ = ["ITEM", "Prepared", "Repeated", "classes_named", "prepare", "stored_before"]

_MOST_MATCHES = 5
_PLACE = ("X", "Y", "Z", "rad")

ITEM = (
    *SIGHT,
    Field("object", "string", "IRI of the object, when the robot followed it and knows"),
    Field("name", "string", "what people call this one object"),
    Field("class_description", "string", "what kind of thing it is, in words"),
    Field("function", "string", "what it is for: write, contain liquid, ..."),
    Field("gripper_id", "string", "name or IRI of the end effector that tried"),
    Field("task", "string", "what it was for: pick, place, push", default="pick"),
    Field("grasp", "grasp", "the grasp that was tried, as received"),
    *(Field(name, "number", "grasp in the frame of the cloud, m and rad") for name in _PLACE),
    Field("success", "boolean", "whether the grasp held, when no outcome is given", default=True),
    Field("confirmed_by", "string", "who says so", choices=("physics", "human")),
    Field("operator", "string", "the person, when a person says so"),
    Field("outcome", "record", "what came of it", fields=OUTCOME),
    Field("task_id", "string", "from recognise_for_grasp, or any id: the same id stores once"),
    Field("merge", "boolean", "add the view to a recognised object", default=True),
)


@dataclass(frozen=True)
class Prepared:
    """One entry, decoded, recognised and located; nothing stored yet."""

    item: dict[str, Any]
    where: str
    seen: Observation
    known: KnownObject | None
    placement: Placement | None
    gripper: KnownGripper | None
    grasp: Received | None
    outcome: Outcome | None
    view: NamedNode
    growth: Growth | None


@dataclass(frozen=True)
class Repeated:
    """One entry whose id was stored before."""

    task_id: str
    before: Earlier
    gripper: KnownGripper | None


def prepare(
    engine: Engine, item: dict[str, Any], where: str, access: Access
) -> Prepared | Repeated:
    """Return an entry ready to be written, or what an earlier request of its id stored.

    Raises
    ------
    UnknownTermError
        When it names an object or a gripper that the graph does not know.
    UsageError
        When its fields do not belong together.
    """
    gripper = _gripper(engine, item, access)
    before = stored_before(engine, item["task_id"], access, gripper)
    if before is not None:
        return Repeated(item["task_id"], before, gripper)
    seen = engine.observations.observe(item, where)
    kinds = classes_named(engine, item["class_description"])
    recognition = recognise(engine.recogniser, seen, engine.policy, _MOST_MATCHES)
    question = question_for(
        engine, seen, recognition, item["object"], gripper,
        () if item["object"] else tuple(kind.value for kind in kinds),
    )  # fmt: skip
    memory = recall(engine.kb, question)
    recognition = settle(recognition, memory, seen, engine.policy)
    known = None
    if item["object"]:
        known = memory.objects.get(item["object"])
        if known is None:
            raise UnknownTermError(f"the graph knows no object {item['object']}")
    elif item["merge"] and recognition.accepted and (kinds or not item["class_description"]):
        known = memory.objects.get(recognition.matches[0].object_iri)
    placement, pose = locate(engine, seen, recognition, known, memory)
    decision = engine.decisions.get(item["task_id"])
    grasp = _grasp(item, where)
    if grasp is not None:
        grasp = grasp.placed(placement).completed(decision)
    outcome = _outcome(engine, item, grasp, where)
    if item["outcome"] is not None and gripper is None:
        raise UsageError(
            f"{where}gripper_id is missing: an outcome is one of a gripper; "
            "register_robot introduces it", field=where + "gripper_id",
        )  # fmt: skip
    view = engine.names.unique("view")
    is_alike = known is None or is_plausible(known, seen, engine.policy)
    is_round = placement is not None and placement.is_round
    growth = grow(
        engine.models, None if known is None else iri(known.iri), seen,
        _viewpoint(seen, known, placement, pose) if is_alike else None, view, is_round,
    )  # fmt: skip
    return Prepared(item, where, seen, known, placement, gripper, grasp, outcome, view, growth)


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
    engine: Engine, task_id: str | None, access: Access, gripper: KnownGripper | None
) -> Earlier | None:
    """Return what an earlier request of this id and author stored."""
    if task_id is None:
        return None
    author = engine.author(access, gripper.robot_name if gripper else None)
    agents = [engine.agent_iri(author), *([gripper.robot] if gripper else [])]
    return earlier(engine, task_id, agents)


def _gripper(engine: Engine, item: dict[str, Any], access: Access) -> KnownGripper | None:
    try:
        return engine.grippers.find(item["gripper_id"], access.agent)
    except UnknownTermError:
        if item["gripper_id"]:
            raise
        return None


def classes_named(engine: Engine, description: str | None) -> list[NamedNode]:
    """Return the classes whose names are the description, not only begin with it."""
    if not description:
        return []
    wanted = folded(description)
    found = engine.classes.find(description)
    return [kind.iri for kind in found if wanted in map(folded, kind.names)]


def _grasp(item: dict[str, Any], where: str) -> Received | None:
    if item["grasp"] is not None:
        return received(item["grasp"], where + "grasp")
    given = [item[name] is not None for name in _PLACE]
    if not any(given):
        return None
    if not all(given):
        raise UsageError(f"{where}X: X, Y, Z and rad belong together", field=where + "X")
    x, y, z, rad = (item[name] for name in _PLACE)
    return Received(in_frame=(x, y, z, rad))


def _outcome(
    engine: Engine, item: dict[str, Any], grasp: Received | None, where: str
) -> Outcome | None:
    fields = item["outcome"]
    if fields is None:
        if grasp is None:
            return None
        # As in the thesis, the operator has validated what is inserted (Gatto 2016, 3.2.4).
        said = {"success": item["success"], "confirmed_by": item["confirmed_by"] or "human"}
        fields = read(OUTCOME, {**said, "operator": item["operator"]})
    elif grasp is None:
        raise UsageError(f"{where}grasp is missing: an outcome is one of a grasp")
    return Outcome.of(fields, engine.reasons, where + "outcome")
