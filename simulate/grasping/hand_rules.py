"""Rules of each kind of hand: heights, openings, closing directions and costs of a grasp.

The planner knows nothing else about a hand. All rules depend on measured sizes, never on the name
of a kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from simulate.grasping.rules import GraspRequest, closing_angles, grasp_heights, openings
from simulate.robots.description import Arm, Floats

__all__ = ["DiagonalMouth", "HandRules", "ParallelJaws", "SuctionFromAbove", "rules_for"]

_DOWN = np.array([0.0, 0.0, -1.0])
_ROUND = tuple(float(angle) for angle in np.deg2rad((0, 90, 45, 135)))
"""Closing directions for a hand that must know on which side its fixed jaw is, rad."""


class HandRules(Protocol):
    """Rules of a hand that the planner asks for."""

    EQUAL: float
    """Difference of costs below which grasps hold about as well, so that time may decide."""

    def heights(self, request: GraspRequest) -> tuple[float, ...]:
        """Return heights of the tool over the table, m, best first."""

    def openings(self, request: GraspRequest) -> tuple[float, ...]:
        """Return how far (0..1) to open before the grasp, best first."""

    def angles(self, request: GraspRequest) -> tuple[float | None, ...]:
        """Return closing directions (rad) to try, best first; None leaves the direction free."""

    def approach(self, request: GraspRequest) -> Floats | None:
        """Return the direction (3,) from which the hand must come; None = as the arm can."""

    def largest_tilt(self, request: GraspRequest) -> float:
        """Return the largest tilt of the approach (rad from the vertical) to try."""

    def cost(self, request: GraspRequest, tilt: float, height: float, direction: int) -> float:
        """Return the cost of a tilt (rad), a height (m) and the n-th closing direction."""


class DiagonalMouth:
    """A hand whose thumb and fingers meet below its own axis."""

    # Its tilt decides what it holds. Giving .05 of it (4 degrees) gained no time.
    EQUAL = 0.0

    STANDS = 1.2
    """Height over the table, as a share of the width, up to which what a finger pushes slides."""
    TIPPING = 20.0
    """Cost of each m above it: the thumb may push alone, where the fingers meet nothing."""
    DEPTH = 0.008
    """Depth of the tool point below the top of the object, m, from which on nothing is gained."""
    SHALLOW = 40.0
    """Cost of each m less: a thing held by its rim, far from its mass, turns out of the hand."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def heights(self, request: GraspRequest) -> tuple[float, ...]:
        """Return heights by the measured size; see :func:`grasp_heights`."""
        return tuple(grasp_heights(request))

    def openings(self, request: GraspRequest) -> tuple[float, ...]:
        """Return wide openings; see :func:`openings`."""
        return openings(request)

    def angles(self, request: GraspRequest) -> tuple[float | None, ...]:
        """Return closing directions, with offsets for thin objects; see :func:`closing_angles`."""
        return closing_angles(request)

    def approach(self, request: GraspRequest) -> Floats | None:
        """Return None: an arm of five joints cannot choose its approach."""
        return None

    def largest_tilt(self, request: GraspRequest) -> float:
        """Return the limit of the request."""
        return request.largest_tilt

    def cost(self, request: GraspRequest, tilt: float, height: float, direction: int) -> float:
        """Return the distance from the preferred tilt and the requested closing direction.

        Hands that close high over the table, or near the top of an object, cost more.
        """
        off = abs(tilt - request.preferred_tilt(height))
        high = max(min(height, request.height) - self.STANDS * request.width, 0.0)
        depth = request.height - height
        # Of what lies thin the fingertips hold all, and the table decides.
        shallow = 0.0 if request.lies_thin else max(self.DEPTH - depth, 0.0)
        return (
            request.tilt_weight * off
            + request.yaw_weight * direction
            + self.TIPPING * high
            + self.SHALLOW * shallow
        )


class ParallelJaws:
    """Two parallel plates that come straight down and close along one axis."""

    TIP_BELOW_TOOL = 0.008
    """Reach of the fingertips beyond the tool centre point, m."""

    # The second side of a thing that fits both ways (.2) is held as well.
    EQUAL = 0.21

    _CLEAR = 0.002
    _USABLE_DEPTH = 0.033
    _SPARE = 0.008

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def heights(self, request: GraspRequest) -> tuple[float, ...]:
        """Return half the height of the object or the depth of the fingers, and 7 mm more."""
        lowest = self.TIP_BELOW_TOOL + self._CLEAR
        rule = max(0.5 * request.height, request.height - self._USABLE_DEPTH, lowest)
        requested = request.z - request.table_height
        if not np.isnan(requested):
            highest = max(request.height - 0.01, lowest)
            rule = float(
                np.clip(requested, max(request.height - self._USABLE_DEPTH, lowest), highest)
            )
        return (rule, rule + 0.007)

    def openings(self, request: GraspRequest) -> tuple[float, ...]:
        """Return fully open, then just wide enough for close neighbours."""
        narrow = (request.width + 2 * self._SPARE) / self._arm.mouth
        if self._arm.has_single_jaw:  # a narrower one would lie beside its own tool point
            return (1.0,)
        return (1.0, narrow) if narrow < 0.9 else (1.0,)

    def angles(self, request: GraspRequest) -> tuple[float | None, ...]:
        """Return the requested direction, and the perpendicular one if it fits too."""
        if request.only_theta:
            return (request.theta,)
        if request.round:
            return _ROUND if self._arm.has_single_jaw else (None,)
        if max(request.length, request.width) < self._arm.mouth - self._SPARE:
            return (request.theta, request.theta + np.pi / 2)
        return (request.theta, request.theta + 0.2, request.theta - 0.2)

    def approach(self, request: GraspRequest) -> Floats | None:
        """Return straight down."""
        return _DOWN

    def largest_tilt(self, request: GraspRequest) -> float:
        """Return 0.4 rad."""
        return 0.4

    def cost(self, request: GraspRequest, tilt: float, height: float, direction: int) -> float:
        """Return the cost of the tilt and of the closing direction."""
        return tilt + 0.2 * direction


class SuctionFromAbove:
    """A cup that comes straight down onto the top of an object."""

    EQUAL = 0.21

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def heights(self, request: GraspRequest) -> tuple[float, ...]:
        """Return the height of the object's top."""
        return (request.base_height - request.table_height + request.height,)

    def openings(self, request: GraspRequest) -> tuple[float, ...]:
        """Return 1: the vacuum is off."""
        return (1.0,)

    def angles(self, request: GraspRequest) -> tuple[float | None, ...]:
        """Return the requested direction, and the perpendicular one: a cup is round."""
        if request.only_theta:
            return (request.theta,)
        return (request.theta, request.theta + np.pi / 2)

    def approach(self, request: GraspRequest) -> Floats | None:
        """Return straight down."""
        return _DOWN

    def largest_tilt(self, request: GraspRequest) -> float:
        """Return 0.2 rad, which a lip makes up for."""
        return 0.2

    def cost(self, request: GraspRequest, tilt: float, height: float, direction: int) -> float:
        """Return the cost of the tilt."""
        return tilt


def rules_for(arm: Arm) -> HandRules:
    """Return the rules of an arm's hand."""
    return _RULES[arm.grip](arm)


_RULES: dict[str, Callable[[Arm], HandRules]] = {
    "diagonal_mouth": DiagonalMouth,
    "parallel_jaws": ParallelJaws,
    "suction_cup": SuctionFromAbove,
    "three_fingers": ParallelJaws,
}
