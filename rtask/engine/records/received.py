"""Checked grasps as sent back by robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

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
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Message, read
from rtask.wire.types import Number, Unit

if TYPE_CHECKING:
    from rtask.engine.decisions import Decision

__all__ = ["CANDIDATE", "TWO_TURNS_RAD", "Received", "in_object", "received"]

Quaternion = tuple[float, float, float, float]

_WIDEST_M = 1.0
_FARTHEST_M = 4.0
"""From the origin of an object; beyond it, a grasp belongs to something else. The thesis's own
message has 2.5 m (Gatto 2016, 3.2.4)."""

TWO_TURNS_RAD = 12.57
"""What goes beyond was measured in degrees."""

CANDIDATE = "candidate:"
"""Prefix of the ids of proposed grasps."""


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

    def check_reach(self, path: str = "grasp") -> None:
        """Refuse a grasp that is nowhere near its object.

        Raises
        ------
        UsageError
            It names the coordinate that is farthest off.
        """
        if self.in_object is None:
            return
        name, value = max(zip("xyz", self.in_object[:3], strict=True), key=lambda at: abs(at[1]))
        if abs(value) > _FARTHEST_M:
            raise UsageError(
                f"{path}: {name} is {value:.3g} m from the object, more than {_FARTHEST_M:g}",
                field=path,
            )

    def completed(self, decision: Decision | None) -> Received:
        """Return the grasp completed from the decision in which it was offered."""
        # What the robot says goes first: it may have corrected the offer while it moved.
        offer = decision.offers.get(self.id) if decision is not None else None
        if offer is None:
            return self
        return replace(
            self,
            in_object=self.in_object or offer.in_object,
            orientation=self.orientation or offer.quaternion,
            width=offer.width if self.width is None else self.width,
            opening=offer.opening if self.opening is None else self.opening,
            quality=offer.quality if self.quality is None else self.quality,
            belief=self.belief or offer.belief,
            contacts=self.contacts or offer.contacts,
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
    theta: Annotated[Number, Unit("rad"), Ge(-TWO_TURNS_RAD), Le(TWO_TURNS_RAD)] | None = None
    width: Annotated[Number, Unit("m"), Ge(0), Le(_WIDEST_M)] | None = None
    opening: Annotated[Number, Unit("m"), Ge(0), Le(_WIDEST_M)] | None = None
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
    theta: Annotated[Number, Unit("rad"), Ge(-TWO_TURNS_RAD), Le(TWO_TURNS_RAD)]
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
    grasp_iri = iri(name) if name and not name.startswith(CANDIDATE) else None
    if isinstance(value, str):
        return Received(name, grasp_iri)
    given = read(_Numbers, {k: value.get(k) for k in _Numbers.model_fields}, path + ".")
    width, opening, quality = given.width, given.opening, given.grasp_quality
    in_frame, in_space = _planar(given), _pose_in_space(value, path)
    # A grasp in space may carry planar numbers beside its pose: together they would state two
    # poses, and only the second says how the hand is turned.
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
        iri=grasp_iri,
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
    contact_fields = value.get("contacts")
    if not contact_fields:
        return None
    where = f"{path}.contacts"
    if frame_from_gripper is None:
        raise UsageError(f"{where}: a grasp with contacts has kind 'spatial' and a pose",
                         field=where)  # fmt: skip
    if not isinstance(contact_fields, list):
        raise UsageError(f"{where}: expected a list of contacts", field=where)
    rows = [read(_Contact, contact, f"{where}[{k}].") for k, contact in enumerate(contact_fields)]
    radius = rows[0].seal_radius
    try:
        contacts = Contacts(
            "three_fingers" if radius is None else "suction",
            np.array([(contact.x, contact.y, contact.z) for contact in rows]),
            np.array([(contact.nx, contact.ny, contact.nz) for contact in rows]), radius,
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
    if all(part is None for part in given):
        return None
    try:
        pose = matrix_from_pose(np.zeros(3), np.array(given, dtype=np.float64))
    except (ValueError, TypeError) as error:
        reason = f"{path}.in_object: qx, qy, qz, qw are no unit quaternion: {given}"
        raise UsageError(reason, field=f"{path}.in_object") from error
    return in_object(pose)[1]


def in_object(pose: FloatArray) -> tuple[tuple[float, float, float, float], Quaternion]:
    """Return (x, y, z, theta) and the quaternion of a pose (4, 4)."""
    (x, y, z), (qx, qy, qz, qw) = (part.tolist() for part in pose_from_matrix(pose))
    return (x, y, z, closing_yaw(pose)), (qx, qy, qz, qw)
