"""Grippers that close two jaws on an object (Kehoe 2014, 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ParallelGripper"]


@dataclass(frozen=True)
class ParallelGripper:
    """Two jaws that move towards each other along one closing direction.

    A hand whose fingers oppose a thumb counts as one: what matters here is the opening.

    Parameters
    ----------
    name
        The end effector's name on its robot, e.g. ``nao_right_hand``.
    gripper_type
        Grasps carry over between grippers of one type, e.g. ``nao_hand``.
    min_opening, max_opening
        Smallest and largest width that it can hold, m.
    finger_width
        Width of a jaw face and thickness of a finger, m.
    finger_length
        Reach of the fingers below the palm, m.
    max_payload
        Largest mass that it can lift, kg.
    symmetric
        Whether both jaws are alike, so that a closing direction and its opposite are one grasp.

    Examples
    --------
    >>> hand = ParallelGripper("nao_right_hand", "nao_hand", 0.0, 0.05)
    >>> hand.fits(0.04), hand.fits(0.06)
    (True, False)
    """

    name: str
    gripper_type: str
    min_opening: float
    max_opening: float
    finger_width: float = 0.0124
    finger_length: float = 0.05
    max_payload: float = 0.3
    symmetric: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.min_opening < self.max_opening:
            raise ValueError(
                f"gripper {self.name!r}: openings must satisfy 0 <= min < max m, "
                f"got {self.min_opening} and {self.max_opening}"
            )
        if self.finger_width <= 0 or self.finger_length <= 0 or self.max_payload <= 0:
            raise ValueError(
                f"gripper {self.name!r}: finger_width, finger_length (m) and max_payload (kg) "
                f"must be positive, got {self.finger_width}, {self.finger_length}, "
                f"{self.max_payload}"
            )

    def fits(self, width_m: float, margin_m: float = 0.002) -> bool:
        """Tell whether a width between contacts can be held, with ``margin_m`` to spare."""
        return self.min_opening <= width_m <= self.max_opening - margin_m
