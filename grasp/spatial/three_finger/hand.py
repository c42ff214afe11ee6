"""Hands with three fingers that close on a common axis, 120 degrees apart, at the same speed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.gripper import ContactKind

__all__ = ["WAYS", "ThreeFingerHand"]

_ANGLES = 2 * np.pi * np.arange(3) / 3
WAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(3)], axis=1)
"""From the axis to each finger in the gripper frame, unit vectors (3, 3)."""


@dataclass(frozen=True)
class ThreeFingerHand:
    """Three round fingers about an axis. Gripper frame: z = approach on the axis, x = to a finger.

    The origin lies on the axis between the middles of the pads. The fingers move together, so that
    an object that moves freely is centred between them.

    Parameters
    ----------
    name
        The end effector's name on its robot.
    max_opening
        Diameter of the largest circle that fits between the open fingers, m.
    min_opening
        Of the smallest between the closed ones, m.
    finger_width
        Diameter of a finger, m.
    finger_length
        Reach of the fingers below the palm, along z, m.
    fingertip
        How far the fingers reach beyond the origin along z, m: half the height of a pad.
    palm
        Size of the palm's box along x, y, z, m; None = as wide as the open fingers, 5 cm deep.
    wrist
        Size of the box behind the palm, m; None = none.
    friction
        Coulomb coefficient between pads and object.
    max_force
        Of each finger where all push alike, N. One drive moves all: where an object asks for it,
        two fingers push with the force of three.
    max_effort
        Of a closed finger's joint, N or N m.
    max_payload
        Largest mass that the arm lifts, kg.
    gripper_type
        Grasps carry over between hands of one type.
    parent_from_gripper : (4, 4) or None
        Tool centre point in the link that carries the hand; None = they coincide.
    joints
        Joints that open and close it; () = one that is named after the hand. Their value is the
        radius, m.
    approach, retreat
        Straight way in and out: wanted and least length, m.

    Examples
    --------
    >>> hand = ThreeFingerHand("centric", max_opening=0.1)
    >>> hand.boxes(0.08).shape
    (4, 2, 3)
    >>> hand.joint_positions(0.06)
    {'centric': 0.03}
    """

    name: str
    max_opening: float
    min_opening: float = 0.0
    finger_width: float = 0.014
    finger_length: float = 0.06
    fingertip: float = 0.009
    palm: tuple[float, float, float] | None = None
    wrist: tuple[float, float, float] | None = None
    friction: float = 0.5
    max_force: float = 20.0
    max_effort: float = 20.0
    max_payload: float = 2.0
    gripper_type: str = "three_finger_hand"
    parent_from_gripper: NDArray[np.float64] | None = field(default=None, compare=False)
    joints: tuple[str, ...] = ()
    approach: tuple[float, float] = (0.10, 0.05)
    retreat: tuple[float, float] = (0.10, 0.05)

    symmetric = False

    def __post_init__(self) -> None:
        numbers = {
            "max_opening": self.max_opening, "finger_width": self.finger_width,
            "finger_length": self.finger_length, "friction": self.friction,
            "max_force": self.max_force, "max_payload": self.max_payload,
        }  # fmt: skip
        for name, value in numbers.items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(
                    f"three-finger hand {self.name!r}: {name} is positive, got {value}"
                )
        if not 0 <= self.min_opening < self.max_opening:
            raise ValueError(
                f"three-finger hand {self.name!r}: openings must satisfy 0 <= min < max m, got "
                f"{self.min_opening} and {self.max_opening}"
            )
        if not 0 <= self.fingertip < self.finger_length:
            raise ValueError(
                f"three-finger hand {self.name!r}: 0 <= fingertip < finger_length m is wanted, got "
                f"{self.fingertip} and {self.finger_length}"
            )

    @property
    def contact_kind(self) -> ContactKind:
        """``three_fingers``."""
        return "three_fingers"

    def fits(self, width_m: float, margin_m: float = 0.002) -> bool:
        """Tell whether the circle of a width can be closed on, with ``margin_m`` to spare."""
        return self.min_opening <= width_m <= self.max_opening - margin_m

    @property
    def reach(self) -> float:
        """Depth from the origin that an object may reach between the fingers, m."""
        return self.finger_length - self.fingertip

    def boxes(self, opening_m: float, sweep_m: float = 0.0) -> FloatArray:
        """Return the fingers, the palm and, where there is one, the wrist as boxes.

        Parameters
        ----------
        opening_m
            Diameter of the circle between the fingers.
        sweep_m
            Length of a straight approach; the boxes cover everything they pass on it.

        Returns
        -------
        (4 or 5, 2, 3), m
            Lowest and highest corner of each box in the gripper frame; round fingers in boxes with
            sides along the frame's.
        """
        half, root = self.finger_width / 2, self.fingertip - self.finger_length
        boxes = []
        for x, y, _ in (opening_m / 2 + half) * WAYS:
            boxes.append([(x - half, y - half, root), (x + half, y + half, self.fingertip)])
        across = self.max_opening + 2 * self.finger_width
        size = self.palm or (across, across, 0.05)
        boxes.append(
            [(-size[0] / 2, -size[1] / 2, root - size[2]), (size[0] / 2, size[1] / 2, root)]
        )
        if self.wrist is not None:
            x, y, z = self.wrist
            end = root - size[2]
            boxes.append([(-x / 2, -y / 2, end - z), (x / 2, y / 2, end)])
        corners = np.array(boxes, dtype=np.float64)
        corners[:, 0, 2] -= sweep_m
        return corners

    def joint_positions(self, opening_m: float) -> dict[str, float]:
        """Return the value of each joint at an opening: the radius, m."""
        return dict.fromkeys(self.joints or (self.name,), opening_m / 2)
