"""Suction cups as end effectors: their sizes, and the force of their vacuum."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.gripper import ContactKind

__all__ = ["SuctionCup"]

_LIFTED_M = 0.004
"""The stem stays clear of the surface by this, m: it is the lip that touches."""

_FLANGE_M = 0.05
"""Depth of a flange of which only the radius is known, m: a straight approach makes it longer."""


@dataclass(frozen=True)
class SuctionCup:
    """One cup on a stem. Gripper frame: z = approach, origin in the middle of the lip.

    Parameters
    ----------
    name
        The end effector's name on its robot.
    radius
        Of the lip, m.
    compliance
        How far apart in depth points of the lip may lie and still seal, m; None = .4 of the radius,
        as of a cup with bellows.
    pressure
        Below that of the air, Pa: 60 kPa is what common ejectors reach.
    friction
        Coulomb coefficient between lip and object.
    gripper_type
        Grasps carry over between cups of one type.
    length
        Of the stem behind the lip, m.
    stem_radius
        m; None = .8 of the lip's.
    wrist
        Size of the box behind the stem, m; None = none. See :meth:`flanged`.
    max_payload
        Largest mass that the arm lifts, kg.
    parent_from_gripper : (4, 4) or None
        Lip in the link that carries the cup; None = they coincide.
    joint
        That switches the vacuum: 1 = on; "" = one named after the cup.
    approach, retreat
        Straight way in and out: wanted and least length, m.

    Examples
    --------
    >>> round(SuctionCup("cup", radius=0.015).force)  # 60 kPa on 7 cm2
    42
    """

    name: str
    radius: float = 0.015
    compliance: float | None = None
    pressure: float = 60_000.0
    friction: float = 0.5
    gripper_type: str = "suction_cup"
    length: float = 0.06
    stem_radius: float | None = None
    wrist: tuple[float, float, float] | None = None
    max_payload: float = 3.0
    parent_from_gripper: NDArray[np.float64] | None = field(default=None, compare=False)
    joint: str = ""
    approach: tuple[float, float] = (0.10, 0.05)
    retreat: tuple[float, float] = (0.10, 0.05)

    symmetric = True
    max_effort = 0.0
    min_opening = 0.0

    def __post_init__(self) -> None:
        numbers = {
            "radius": self.radius, "compliance": self.give, "pressure": self.pressure,
            "friction": self.friction, "length": self.length, "max_payload": self.max_payload,
        }  # fmt: skip
        for name, value in numbers.items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"suction cup {self.name!r}: {name} is positive, got {value}")

    @property
    def contact_kind(self) -> ContactKind:
        """``suction``."""
        return "suction"

    @property
    def finger_width(self) -> float:
        """Diameter of the lip, m."""
        return 2 * self.radius

    @property
    def give(self) -> float:
        """Compliance of the lip, m."""
        return 0.4 * self.radius if self.compliance is None else self.compliance

    @property
    def force(self) -> float:
        """Of the vacuum on what it seals, N."""
        return float(self.pressure * np.pi * self.radius**2)

    @property
    def max_opening(self) -> float:
        """Compliance, m: the opening of a cup without vacuum, as messages state it."""
        return self.give

    def fits(self, width_m: float, margin_m: float = 0.002) -> bool:
        """Return True: a cup closes on nothing, so that no width is too large for it."""
        return True

    def boxes(self, opening_m: float = 0.0, sweep_m: float = 0.0) -> FloatArray:
        """Return the stem and, where there is one, the wrist as boxes (1 or 2, 2, 3), m.

        Parameters
        ----------
        opening_m
            Without effect; parallel grippers have one.
        sweep_m
            Length of a straight approach that the boxes cover.
        """
        r = 0.8 * self.radius if self.stem_radius is None else self.stem_radius
        back = -_LIFTED_M - self.length
        boxes = [[(-r, -r, back), (r, r, -_LIFTED_M)]]
        if self.wrist is not None:
            x, y, z = self.wrist
            boxes.append([(-x / 2, -y / 2, back - z), (x / 2, y / 2, back)])
        corners = np.array(boxes, dtype=np.float64)
        corners[:, 0, 2] -= sweep_m
        return corners

    def flanged(self, radius: float, depth: float = _FLANGE_M) -> SuctionCup:
        """Return the cup on a round flange: its wrist is a box of the same section.

        Parameters
        ----------
        radius, depth
            Of the flange and what is as wide behind it, m.

        Examples
        --------
        >>> [round(side, 3) for side in SuctionCup("cup").flanged(0.044).wrist or ()]
        [0.078, 0.078, 0.05]
        """
        side = radius * float(np.sqrt(np.pi))
        return replace(self, wrist=(side, side, depth))

    @property
    def flange_radius(self) -> float:
        """Radius of a flange with the section of the wrist, m; 0 where there is none."""
        return 0.0 if self.wrist is None else float(np.sqrt(self.wrist[0] * self.wrist[1] / np.pi))

    def joint_positions(self, opening_m: float) -> dict[str, float]:
        """Return the value of the switch: on where nothing is open.

        >>> SuctionCup("cup").joint_positions(0.0)
        {'cup': 1.0}
        """
        return {self.joint or self.name: 0.0 if opening_m > 0 else 1.0}
