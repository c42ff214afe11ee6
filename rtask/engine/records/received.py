"""Checked grasps and outcomes as sent back by robots."""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le, MaxLen
from numpy.typing import NDArray
from pydantic import Field

from grasp.arrays import FloatArray
from grasp.messages import matrix_from_message, planar_from_message
from grasp.spatial.candidate import Contacts, GraspCandidate, contacts_of
from grasp.spatial.frames import (
    closing_yaw,
    matrix_from_pose,
    planar_from_pose,
    pose_from_matrix,
    pose_from_planar,
)
from grasp.spatial.gripper import EndEffector
from rtask.engine.perception.placement import Placement
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Message, read
from rtask.wire.types import Array, Flag, Image, Number, Text, Texts, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.decisions import Decision

__all__ = ["CANDIDATE", "TIMES", "Outcome", "OutcomeReport", "Received", "in_object", "received"]

log = logging.getLogger(__name__)

Quaternion = tuple[float, float, float, float]

_LATEST_S = 253_402_300_799
"""End of the year 9999, s since the epoch."""
CANDIDATE = "candidate:"
"""Prefix of the ids of proposed grasps."""

TIMES = {
    "segmentation_s": RT.segmentationTime,
    "transfer_s": RT.transferTime,
    "decode_s": RT.decodingTime,
    "extraction_s": RT.extractionTime,
    "matching_s": RT.matchingTime,
    "query_s": RT.queryTime,
    "pose_s": RT.poseTime,
    "generation_s": RT.generationTime,
    "choice_s": RT.choiceTime,
    "planning_s": RT.planningTime,
    "execution_s": RT.executionTime,
    "total_s": RT.totalTime,
}
"""Property of the graph for each duration of a message, s."""


class StepTimes(Message):
    """Durations of the steps of an attempt."""

    segmentation_s: Annotated[Number, Unit("s")] | None = None
    """time for segmentation; default: not measured"""
    transfer_s: Annotated[Number, Unit("s")] | None = None
    """time for the transfer; default: not measured"""
    decode_s: Annotated[Number, Unit("s")] | None = None
    """time for decoding; default: not measured"""
    extraction_s: Annotated[Number, Unit("s")] | None = None
    """time for feature extraction; default: not measured"""
    matching_s: Annotated[Number, Unit("s")] | None = None
    """time for matching; default: not measured"""
    query_s: Annotated[Number, Unit("s")] | None = None
    """time for the query; default: not measured"""
    pose_s: Annotated[Number, Unit("s")] | None = None
    """time for the pose; default: not measured"""
    generation_s: Annotated[Number, Unit("s")] | None = None
    """time for generating grasps; default: not measured"""
    choice_s: Annotated[Number, Unit("s")] | None = None
    """time for the choice; default: not measured"""
    planning_s: Annotated[Number, Unit("s")] | None = None
    """time for motion planning; default: not measured"""
    execution_s: Annotated[Number, Unit("s")] | None = None
    """time for the execution; default: not measured"""
    total_s: Annotated[Number, Unit("s")] | None = None
    """total time; default: not measured"""


class Picture(Message):
    """A picture of an attempt."""

    phase: Text
    """pre_grasp, closed, lifted, placed, ..."""
    data: Image
    """base64 PNG or JPEG"""


class MotionReport(Message):
    """Joints of a robot during an attempt, sample by sample."""

    joints: Annotated[Texts, MaxLen(64)]
    """names; the opening of a hand, 0 (closed) to 1, counts as a joint by the hand's name"""
    times: Array
    """s since the start of the attempt, rising; one a sample"""
    positions: Array
    """as measured, rad or m; all joints of the first sample, then of the second, ..."""
    commands: Array
    """as commanded at the same moments, in the same order"""


class OutcomeReport(Message):
    """Outcome of an attempt as reported."""

    success: Flag
    """whether the object was held"""
    placed: Flag | None = None
    """whether it reached its destination; default: not known"""
    place: Text | None = None
    """name of the place where it was put, such as "left box"; default: not known"""
    reason: Text | None = None
    """code of the reason: ok, missed, slip_lift, ...; default: ok if it held, else not judged"""
    lifted_m: Annotated[Number, Unit("m")] | None = None
    """height reached; default: not known"""
    slip: Annotated[Number, Unit("m")] | None = None
    """distance that the object slipped in the hand; default: not known"""
    started: Annotated[Number, Unit("s"), Ge(0), Le(_LATEST_S)] | None = None
    """start of the attempt since the epoch; default: duration_s before its end, unless simulated"""
    ended: Annotated[Number, Unit("s"), Ge(0), Le(_LATEST_S)] | None = None
    """end of the attempt since the epoch, by the same clock; default: now"""
    duration_s: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """of the attempt; by the clock of the simulation if there is one; default: not known"""
    links_touching: Annotated[Whole, Ge(0)] | None = None
    """number of hand links in contact at the end; default: not known"""
    contact_force: Annotated[Number, Unit("N"), Ge(0)] | None = None
    """contact force at the jaws; default: not known"""
    jaw_gap: Annotated[Number, Unit("m"), Ge(0)] | None = None
    """opening of the closed jaws; default: not known"""
    hold_s: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """duration of the hold; default: not known"""
    place_offset: Annotated[Number, Unit("m"), Ge(0)] | None = None
    """distance from the destination; default: not known"""
    approach_tilt: Annotated[Number, Unit("rad")] | None = None
    """angle between approach and vertical; default: not known"""
    preset: Literal["faithful", "fast", "real"] | None = None
    """kind of physics: faithful, fast or real; default: not known"""
    seed: Annotated[Whole, Ge(0)] | None = None
    """seed of the simulation; default: none"""
    attempt_number: Annotated[Whole, Ge(1)] | None = None
    """counted from 1 for each object and episode; default: not known"""
    candidate_count: Annotated[Whole, Ge(1)] | None = None
    """number of grasps to choose from; default: not known"""
    candidate_rank: Annotated[Whole, Ge(1)] | None = None
    """rank of the chosen grasp; default: not known"""
    confirmed_by: Literal["physics", "human"] | None = None
    """who confirmed it; default: nobody"""
    operator: Text | None = None
    """name of the person who confirmed it; default: nobody"""
    comment: Text | None = None
    """remark of the person or the robot; default: none"""
    times: StepTimes | None = None
    """durations of the steps; default: not known"""
    images: Annotated[list[Picture], MaxLen(32)] = Field(default_factory=list)
    """pictures of the attempt"""
    motion: MotionReport | None = None
    """the joints during the attempt; default: not recorded"""


@dataclass(frozen=True)
class Received:
    """A grasp as sent back by a robot.

    Parameters
    ----------
    id
        As received: an IRI, ``candidate:<k>`` or empty.
    iri
        IRI of a stored grasp, or None.
    in_object
        (x, y, z, theta) in the object's frame, or None.
    in_frame
        (x, y, z, theta) in the robot's frame, z absolute, or None.
    orientation
        Quaternion (x, y, z, w) in the object's frame of a grasp in space, or None.
    frame_from_gripper : (4, 4) or None, m
        Pose in the robot's frame of a grasp in space.
    belief
        alpha and beta before the attempt, or None.
    contacts
        Of a cup or of three fingers in the gripper frame; None for jaws, or if not told.
    """

    id: str = ""
    iri: NamedNode | None = None
    in_object: tuple[float, float, float, float] | None = None
    in_frame: tuple[float, float, float, float] | None = None
    orientation: Quaternion | None = None
    frame_from_gripper: NDArray[np.float64] | None = field(default=None, compare=False)
    width: float | None = None
    opening: float | None = None
    quality: float | None = None
    belief: tuple[float, float] | None = None
    contacts: Contacts | None = None

    @property
    def object_from_gripper(self) -> NDArray[np.float64]:
        """Pose (4, 4), m, of the tool centre point in the object's frame, where it is known."""
        assert self.in_object is not None
        x, y, z, theta = self.in_object
        if self.orientation is None:
            return np.asarray(pose_from_planar(x, y, z, theta), dtype=np.float64)
        pose = matrix_from_pose(np.array([x, y, z]), np.array(self.orientation))
        return np.asarray(pose, dtype=np.float64)

    def held_by(self, hand: EndEffector, path: str = "grasp") -> Received:
        """Return the grasp with the contacts of a hand; jaws have none.

        Contacts that were not told are where the pose and the width put them.

        Raises
        ------
        UsageError
            The contacts are of another kind of hand, or out of its reach.
        """
        if hand.contact_kind == "jaws" and self.contacts is None:
            return self
        try:
            contacts = self.contacts
            if contacts is None:
                width = hand.max_opening if self.width is None else self.width
                contacts = contacts_of(GraspCandidate(np.eye(4), width), hand)
            assert contacts is not None
            contacts.check_reach(hand)
        except ValueError as error:
            where = f"{path}.contacts"
            raise UsageError(f"{where}: {error}", field=where) from error
        if self.in_object is None or self.orientation is not None:
            return replace(self, contacts=contacts)
        at, orientation = in_object(self.object_from_gripper)
        return replace(self, contacts=contacts, in_object=at, orientation=orientation)

    def completed(self, decision: Decision | None) -> Received:
        """Return the grasp completed from the decision in which it was offered."""
        option = decision.options.get(self.id) if decision is not None else None
        if option is None or option.choice is None:
            return self
        return replace(
            self,
            in_object=self.in_object or option.in_object,
            orientation=self.orientation or option.quaternion,
            width=option.grasp.width if self.width is None else self.width,
            opening=option.opening if self.opening is None else self.opening,
            quality=option.quality if self.quality is None else self.quality,
            belief=self.belief or (option.choice.alpha, option.choice.beta),
            contacts=self.contacts or option.contacts,
        )

    def placed(self, placement: Placement | None) -> Received:
        """Return the grasp with its pose in the object's frame if it can be computed."""
        if placement is None:
            return self
        if self.frame_from_gripper is not None:
            pose = np.linalg.inv(placement.frame_from_object) @ self.frame_from_gripper
            at, orientation = in_object(pose)
            return replace(self, in_object=at, orientation=orientation)
        if self.in_frame is None:
            return self
        x, y, z, theta = self.in_frame
        x, y, theta = placement.to_object(x, y, theta)
        z -= float(placement.frame_from_object[2, 3])
        return replace(self, in_object=(x, y, z, theta))


class _Numbers(Message):
    """Numbers of a received grasp, m and rad."""

    x: Number | None = None
    y: Number | None = None
    z: Number | None = None
    theta: Number | None = None
    width: Number | None = None
    opening: Number | None = None
    grasp_quality: Number | None = None
    alpha: Number | None = None
    beta: Number | None = None


class _InObject(Message):
    """A grasp in its object's frame, m and rad, with a quaternion if it is in space."""

    x: Number
    """abscissa"""
    y: Number
    """ordinate"""
    z: Number
    """height"""
    theta: Number
    """closing direction about z"""
    qx: Number | None = None
    qy: Number | None = None
    qz: Number | None = None
    qw: Number | None = None


def received(value: str | Mapping[str, Any], path: str) -> Received:
    """Read a grasp: its IRI, one of the grasps of an answer, or a bare Grasp message.

    Raises
    ------
    UsageError
        The message names the field.
    """
    name = value if isinstance(value, str) else str(value.get("id") or "")
    known = iri(name) if name and not name.startswith(CANDIDATE) else None
    if isinstance(value, str):
        return Received(name, known)
    given = read(_Numbers, {k: value.get(k) for k in _Numbers.model_fields}, path + ".")
    width, opening, quality = given.width, given.opening, given.grasp_quality
    in_frame, in_space = _planar(given), _pose_in_space(value, path)
    if in_space is not None:
        in_frame = None
    elif in_frame is None and "grasp_pose" in value and "pre_grasp_posture" not in value:
        in_frame = _bare_pose(value["grasp_pose"], path)
    elif in_frame is None and "grasp_pose" in value:
        try:
            planar = planar_from_message(dict(value))
        except ValueError as error:
            raise UsageError(f"{path}: {error}", field=path) from error
        in_frame = (planar.x, planar.y, planar.z, planar.theta)
        width, opening, quality = planar.width, planar.opening, planar.quality
    at_object, orientation = None, None
    if value.get("in_object") is not None:
        at = read(_InObject, value["in_object"], path + ".in_object.")
        at_object = (at.x, at.y, at.z, at.theta)
        orientation = _orientation(at, path)
    if not name and in_frame is None and at_object is None and in_space is None:
        raise UsageError(f"{path}: expected an id or a pose", field=path)
    return Received(
        id=name,
        iri=known,
        in_object=at_object,
        in_frame=in_frame,
        orientation=orientation,
        frame_from_gripper=in_space,
        width=width,
        opening=opening,
        quality=quality,
        belief=None if given.alpha is None or given.beta is None else (given.alpha, given.beta),
        contacts=_contacts(value, in_space, path),
    )


class _Contact(Message):
    """A place at which a lip or a finger touches, in the frame of its grasp's pose."""

    x: Annotated[Number, Unit("m")]
    y: Annotated[Number, Unit("m")]
    z: Annotated[Number, Unit("m")]
    nx: Number
    ny: Number
    nz: Number
    seal_radius: Annotated[Number, Unit("m")] | None = None


def _contacts(
    value: Mapping[str, Any], frame_from_gripper: NDArray[np.float64] | None, path: str
) -> Contacts | None:
    """Return the contacts of a message in the gripper frame, or None if it tells of none."""
    told = value.get("contacts")
    if not told:
        return None
    where = f"{path}.contacts"
    if frame_from_gripper is None:
        raise UsageError(f"{where}: a grasp with contacts has kind 'spatial' and a pose",
                         field=where)  # fmt: skip
    if not isinstance(told, list):
        raise UsageError(f"{where}: expected a list of contacts", field=where)
    rows = [read(_Contact, one, f"{where}[{k}].") for k, one in enumerate(told)]
    radius = rows[0].seal_radius
    try:
        contacts = Contacts(
            "three_fingers" if radius is None else "suction",
            np.array([(one.x, one.y, one.z) for one in rows]),
            np.array([(one.nx, one.ny, one.nz) for one in rows]), radius,
        )  # fmt: skip
    except ValueError as error:
        raise UsageError(f"{where}: {error}", field=where) from error
    return contacts.within(frame_from_gripper)


def _planar(given: _Numbers) -> tuple[float, float, float, float] | None:
    x, y, z, theta = given.x, given.y, given.z, given.theta
    if x is None or y is None or z is None or theta is None:
        return None
    return x, y, z, theta


def _bare_pose(pose: Any, path: str) -> tuple[float, float, float, float]:
    """Return the numbers of a geometry_msgs/PoseStamped that comes without postures."""
    if not isinstance(pose, Mapping) or "pose" not in pose:
        raise UsageError(
            f"{path}.grasp_pose: expected a geometry_msgs/PoseStamped with its pose",
            field=f"{path}.grasp_pose",
        )
    try:
        return planar_from_pose(matrix_from_message(pose["pose"]))
    except ValueError as error:
        raise UsageError(f"{path}: {error}", field=path) from error


def _pose_in_space(value: Mapping[str, Any], path: str) -> NDArray[np.float64] | None:
    """Return the pose (4, 4) of a grasp that is declared as one in space, or None.

    A ``tool_pose`` goes before ``grasp_pose``, which may be that of the end effector's parent link.
    """
    name = "tool_pose" if value.get("tool_pose") is not None else "grasp_pose"
    if value.get("kind") != "spatial" or name not in value:
        return None
    try:
        return np.asarray(matrix_from_message(value[name]["pose"]), dtype=np.float64)
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path}.{name}: {error}", field=f"{path}.{name}") from error


def _orientation(at: _InObject, path: str) -> Quaternion | None:
    given = [at.qx, at.qy, at.qz, at.qw]
    if all(one is None for one in given):
        return None
    try:
        pose = matrix_from_pose(np.zeros(3), np.array(given, dtype=np.float64))
    except (ValueError, TypeError) as error:
        said = f"{path}.in_object: qx, qy, qz, qw are no unit quaternion: {given}"
        raise UsageError(said, field=f"{path}.in_object") from error
    return in_object(pose)[1]


def in_object(pose: FloatArray) -> tuple[tuple[float, float, float, float], Quaternion]:
    """Return (x, y, z, theta) and the quaternion of a pose (4, 4)."""
    (x, y, z), (qx, qy, qz, qw) = (part.tolist() for part in pose_from_matrix(pose))
    return (x, y, z, closing_yaw(pose)), (qx, qy, qz, qw)


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt, checked against the reason codes of the ontology.

    Parameters
    ----------
    place_reason
        Code of the reason why an object that was held did not arrive; empty if it did, or if no
        known code was given.
    """

    held: bool
    reason: str
    placed: bool | None = None
    place_reason: str = ""
    comments: tuple[str, ...] = ()
    report: OutcomeReport = field(default_factory=lambda: OutcomeReport(success=False))

    @property
    def is_fast(self) -> bool:
        """Whether it was simulated with the coarse physics preset."""
        return bool(self.report.preset == "fast")

    def span(self, now: dt.datetime) -> tuple[dt.datetime | None, dt.datetime]:
        """Return when the attempt started, if that is known, and when it ended.

        The seconds of a simulation pass faster or slower than those of the clock by which the
        attempt ended, so that they do not tell when it started.

        Parameters
        ----------
        now
            The end of an attempt whose report does not tell it.

        Raises
        ------
        UsageError
            It started after it ended.
        """
        report, is_simulated = self.report, self.report.preset in ("faithful", "fast")
        ended = now if report.ended is None else dt.datetime.fromtimestamp(report.ended, dt.UTC)
        if report.started is None:
            if report.duration_s is None or is_simulated:
                return None, ended
            return ended - dt.timedelta(seconds=float(report.duration_s)), ended
        started = dt.datetime.fromtimestamp(report.started, dt.UTC)
        if started > ended:
            raise UsageError(
                f"outcome.started: {started.isoformat()} is after the end of the attempt, "
                f"{ended.isoformat()}; give both by one clock",
                field="outcome.started",
            )
        return started, ended

    @classmethod
    def of(cls, report: OutcomeReport, known: frozenset[str], path: str) -> Outcome:
        """Interpret a reported outcome.

        The only reason of a success is ``ok``; a later failure becomes a comment. An unknown code
        becomes ``not_judged`` and is kept as a comment.

        Raises
        ------
        UsageError
            A failure has the reason ``ok``.
        """
        held, code, after = report.success, report.reason, ""
        comments = [report.comment] if report.comment else []
        if held:
            if code not in (None, "ok"):
                comments.append(f"after holding: {code}")
                after = code if code in known and report.placed is False else ""
            code = "ok"
        elif code == "ok":
            raise UsageError(f"{path}.reason: a failure cannot have the reason ok", field=path)
        elif code is None or code not in known:
            if code is not None:
                log.warning("unknown reason code %r is kept as a comment", code)
                comments.append(code)
            code = "not_judged"
        return cls(held, code, report.placed, after, tuple(comments), report)
