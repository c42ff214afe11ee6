"""Grippers that close two jaws on an object (Kehoe 2014, 3.4), and their shape in space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ContactKind", "EndEffector", "ParallelGripper", "nao_hand", "panda_hand", "parallel_jaw",
]  # fmt: skip

ContactKind = Literal["jaws", "suction", "three_fingers"]
"""Contacts by which a hand holds: two that oppose each other, a sealed lip, or three about an axis.
A grasp by contacts of one kind says nothing to hands of another."""

_PALM_CLEARANCE_M = 0.005


class EndEffector(Protocol):
    """Interface of every end effector that planning, messages and drawings use."""

    @property
    def name(self) -> str:
        """On its robot."""

    @property
    def contact_kind(self) -> ContactKind:
        """Contacts by which it holds."""

    @property
    def gripper_type(self) -> str:
        """Grasps carry over between end effectors of one type."""

    @property
    def symmetric(self) -> bool:
        """Whether half a turn about the approach makes no difference."""

    @property
    def min_opening(self) -> float:
        """Smallest width that it holds, m."""

    @property
    def max_opening(self) -> float:
        """Before closing at most, m."""

    @property
    def finger_width(self) -> float:
        """Of what touches the object, across, m."""

    @property
    def max_payload(self) -> float:
        """Largest mass that it lifts, kg."""

    @property
    def max_effort(self) -> float:
        """Of a closed joint, N or N m."""

    @property
    def friction(self) -> float:
        """Coulomb coefficient on the object."""

    @property
    def approach(self) -> tuple[float, float]:
        """Straight way in: wanted and least length, m."""

    @property
    def retreat(self) -> tuple[float, float]:
        """Straight way out: wanted and least length, m."""

    @property
    def parent_from_gripper(self) -> NDArray[np.float64] | None:
        """Tool centre point in the link that carries the end effector (4, 4)."""

    def fits(self, width_m: float, margin_m: float = 0.002) -> bool:
        """Tell whether a width between contacts can be held, with ``margin_m`` to spare."""

    def boxes(self, opening_m: float, sweep_m: float = 0.0) -> NDArray[np.float64]:
        """Return the parts as boxes (n, 2, 3), m, in the gripper frame."""

    def joint_positions(self, opening_m: float) -> dict[str, float]:
        """Return the value of each joint at an opening."""


@dataclass(frozen=True)
class ParallelGripper:
    """Two jaws that move towards each other along one closing direction.

    A hand whose fingers oppose a thumb counts as one: what matters here is the opening. Gripper
    frame: z = approach, x = closing direction, origin midway between the fingertips' pads.

    Parameters
    ----------
    name
        The end effector's name on its robot, e.g. ``nao_right_hand``.
    gripper_type
        Grasps carry over between grippers of one type, e.g. ``nao_hand``.
    min_opening, max_opening
        Smallest and largest width that it can hold, m.
    finger_width
        Width of a jaw face, along y, m; thickness of a finger too unless that is given.
    finger_length
        Reach of the fingers below the palm, along z, m.
    max_payload
        Largest mass that it can lift, kg.
    symmetric
        Whether both jaws are alike, so that a closing direction and its opposite are one grasp.
    finger_thickness
        Along x, m; None = ``finger_width``.
    fingertip
        How far the fingers reach beyond the origin along z, m: half the height of a pad.
    palm
        Size of the palm's box along x, y, z, m; None = as wide as the open fingers, 4 cm deep.
    wrist
        Size of the box behind the palm, m; None = none.
    friction
        Coulomb coefficient between pads and object.
    max_effort
        Of a closed finger's joint: N if it slides, N m if it turns.
    max_force
        Of each jaw on what it holds, N.
    parent_from_gripper : (4, 4) or None
        Tool centre point in the link that carries the end effector; None = they coincide.
    joints
        Joints that open and close it; () = one that is named after the gripper.
    approach, retreat
        Straight way in and out: wanted and least length, m.
    joint_table
        Pairs (opening in m, value of each joint), both rising; () = the value is the opening.

    Examples
    --------
    >>> hand = ParallelGripper("nao_right_hand", "nao_hand", 0.0, 0.05)
    >>> hand.fits(0.04), hand.fits(0.06)
    (True, False)
    >>> hand.boxes(0.03).shape
    (3, 2, 3)
    """

    name: str
    gripper_type: str
    min_opening: float
    max_opening: float
    finger_width: float = 0.0124
    finger_length: float = 0.05
    max_payload: float = 0.3
    symmetric: bool = True
    finger_thickness: float | None = None
    fingertip: float = 0.006
    palm: tuple[float, float, float] | None = None
    wrist: tuple[float, float, float] | None = None
    friction: float = 0.5
    max_effort: float = 20.0
    max_force: float = 20.0
    parent_from_gripper: NDArray[np.float64] | None = field(default=None, compare=False)
    approach: tuple[float, float] = (0.10, 0.05)
    retreat: tuple[float, float] = (0.10, 0.05)
    joints: tuple[str, ...] = ()
    joint_table: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not 0 <= self.min_opening < self.max_opening < np.inf:
            raise ValueError(
                f"gripper {self.name!r}: openings must satisfy 0 <= min < max m, finite, "
                f"got {self.min_opening} and {self.max_opening}"
            )
        sizes = (self.finger_width, self.finger_length, self.max_payload)
        if not all(0 < size < np.inf for size in sizes):
            raise ValueError(
                f"gripper {self.name!r}: finger_width, finger_length (m) and max_payload (kg) "
                f"must be positive, got {self.finger_width}, {self.finger_length}, "
                f"{self.max_payload}"
            )
        if not (0 <= self.fingertip < self.finger_length and self.friction > 0):
            raise ValueError(
                f"gripper {self.name!r}: 0 <= fingertip < finger_length m and friction > 0 are "
                f"wanted, got {self.fingertip}, {self.finger_length}, {self.friction}"
            )
        table = np.array(self.joint_table, dtype=np.float64).reshape(-1, 2)
        if len(table) == 1 or np.any(np.diff(table, axis=0) <= 0):
            raise ValueError(f"gripper {self.name!r}: both columns of joint_table must rise")

    @property
    def contact_kind(self) -> ContactKind:
        """``jaws``."""
        return "jaws"

    @property
    def thickness(self) -> float:
        """Thickness of a finger along the closing direction, m."""
        return self.finger_width if self.finger_thickness is None else self.finger_thickness

    def modelled(self) -> ParallelGripper:
        """Return the gripper with the whole shape of its type, where that is known here.

        What a robot says about its own hand stays: openings, payload, name.

        >>> ParallelGripper("hand", "panda_hand", 0.0, 0.07).modelled().palm
        (0.205, 0.063, 0.066)
        """
        shape_of_type = {"nao_hand": nao_hand, "panda_hand": panda_hand}.get(self.gripper_type)
        if shape_of_type is None:
            return self
        return replace(
            shape_of_type(self.name), min_opening=self.min_opening, max_opening=self.max_opening,
            max_payload=self.max_payload, symmetric=self.symmetric,
        )  # fmt: skip

    def fits(self, width_m: float, margin_m: float = 0.002) -> bool:
        """Tell whether a width between contacts can be held, with ``margin_m`` to spare."""
        return self.min_opening <= width_m <= self.max_opening - margin_m

    def boxes(self, opening_m: float, sweep_m: float = 0.0) -> NDArray[np.float64]:
        """Return both fingers, the palm and, where there is one, the wrist as boxes.

        Parameters
        ----------
        opening_m
            Distance between the jaws.
        sweep_m
            Length of a straight approach; the boxes cover everything they pass on it.

        Returns
        -------
        (3 or 4, 2, 3), m
            Lowest and highest corner of each box in the gripper frame. The first is at -x.
        """
        half, thick, wide = opening_m / 2, self.thickness, self.finger_width / 2
        root = self.fingertip - self.finger_length
        palm = self.palm
        if palm is None:
            palm = (self.max_opening + 2 * thick, 2 * self.finger_width, 0.04)
        boxes = [
            [(-half - thick, -wide, root), (-half, wide, self.fingertip)],
            [(half, -wide, root), (half + thick, wide, self.fingertip)],
            [(-palm[0] / 2, -palm[1] / 2, root - palm[2]), (palm[0] / 2, palm[1] / 2, root)],
        ]
        if self.wrist is not None:
            x, y, z = self.wrist
            end = root - palm[2]
            boxes.append([(-x / 2, -y / 2, end - z), (x / 2, y / 2, end)])
        corners = np.array(boxes, dtype=np.float64)
        corners[:, 0, 2] -= sweep_m
        return corners

    @property
    def reach(self) -> float:
        """Depth from the origin that an object may reach between the jaws, m."""
        return self.finger_length - self.fingertip - _PALM_CLEARANCE_M

    def joint_positions(self, opening_m: float) -> dict[str, float]:
        """Return the value of each joint at an opening."""
        value = opening_m
        if self.joint_table:
            openings, values = np.array(self.joint_table).T
            value = float(np.interp(opening_m, openings, values))
        return dict.fromkeys(self.joints or (self.name,), value)

    def opening_at(self, joint_value: float) -> float:
        """Return the opening, m, at a value of its joints."""
        if not self.joint_table:
            return joint_value
        openings, values = np.array(self.joint_table).T
        return float(np.interp(joint_value, values, openings))


def _rotation(*columns: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.stack([np.array(column, dtype=np.float64) for column in columns], axis=1)


def panda_hand(name: str = "panda_hand") -> ParallelGripper:
    """Return the gripper of Franka Emika's Panda: 8 cm stroke, rubber pads.

    >>> panda_hand().joint_positions(0.04)
    {'panda_finger_joint1': 0.02, 'panda_finger_joint2': 0.02}
    """
    # The hand's fingers slide along its y axis; the pads are 103.4 mm before its origin.
    parent_from_gripper = np.eye(4)
    parent_from_gripper[:3, :3] = _rotation((0, 1, 0), (-1, 0, 0), (0, 0, 1))
    parent_from_gripper[2, 3] = 0.1034
    return ParallelGripper(
        name,
        "panda_hand",
        0.0,
        0.08,
        finger_width=0.02,
        finger_length=0.054,
        max_payload=3.0,
        finger_thickness=0.014,
        fingertip=0.009,
        palm=(0.205, 0.063, 0.066),
        friction=0.5,
        parent_from_gripper=parent_from_gripper,
        joints=("panda_finger_joint1", "panda_finger_joint2"),
        joint_table=((0.0, 0.0), (0.08, 0.04)),
    )


_NAO_TILT = 0.8


def nao_hand(name: str = "nao_right_hand") -> ParallelGripper:
    """Return a hand of the NAO: two fingers against a thumb that open diagonally to the wrist.

    >>> round(nao_hand().joint_positions(0.025)["RHand"], 2)
    0.5
    """
    c, s = float(np.cos(_NAO_TILT)), float(np.sin(_NAO_TILT))
    wrist_from_gripper = np.eye(4)
    wrist_from_gripper[:3, :3] = _rotation((s, 0, c), (0, -1, 0), (c, 0, -s))
    wrist_from_gripper[:3, 3] = (0.083, 0.0, -0.024)
    return ParallelGripper(
        name,
        "nao_hand",
        0.0,
        0.05,
        finger_width=0.0124,
        finger_length=0.05,
        max_payload=0.3,
        symmetric=False,
        fingertip=0.006,
        palm=(0.05, 0.05, 0.05),
        wrist=(0.05, 0.05, 0.06),
        max_effort=0.06,
        max_force=2.0,
        approach=(0.055, 0.033),
        retreat=(0.06, 0.035),
        parent_from_gripper=wrist_from_gripper,
        joints=("LHand" if "left" in name else "RHand",),
        joint_table=((0.0, 0.0), (0.05, 1.0)),
    )


def parallel_jaw(stroke_m: float, name: str = "jaw") -> ParallelGripper:
    """Return a plain two-finger gripper of a stroke, sized like industrial ones.

    >>> parallel_jaw(0.05).max_opening
    0.05
    """
    if not np.isfinite(stroke_m) or stroke_m <= 0:
        raise ValueError(f"the stroke of a gripper is positive, in m, got {stroke_m}")
    width = float(np.clip(0.25 * stroke_m, 0.006, 0.03))
    return ParallelGripper(
        name,
        "parallel_jaw",
        0.0,
        stroke_m,
        finger_width=width,
        finger_length=max(0.7 * stroke_m, 0.03),
        max_payload=1.0,
        fingertip=0.4 * width,
    )
