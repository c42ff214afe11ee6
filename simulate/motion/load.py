"""A held object as a box that may turn about the closing axis of the hand.

A thing held far from its centre of mass turns between the fingers when it is lifted, until one end
hangs. On the way to the box it then reaches lower than it did on the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from simulate.robots.description import Floats

__all__ = ["Load"]

_THINNEST_M = 0.004
_SPACING = 1.6
"""Of the spheres that cover it, in radii."""
_MAX_SPHERES = 8
"""Along an edge."""
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_TURNS = np.radians(np.arange(-90.0, 91.0, 5.0))
_NOISE_M = 0.007
"""Of a camera, and of the size as it was seen."""
_BESIDE_JAW_M, _MAX_DEPTH_M = 0.002, 0.045
"""Room left beside the jaws; the palm is further than that above the tool centre point."""
_MIN_POINTS = 30
_MIN_EXPLAINED = 0.6
_BEST_SHARE = 0.95
"""Of the points that the best turn explains: turns that explain as many are equally good."""


@dataclass(frozen=True, eq=False)
class Load:
    """A box in the hand.

    Parameters
    ----------
    tool_from_load : (4, 4) float, m
        Pose of the middle of the box in the frame of the tool, whose x axis is the closing axis.
    size : (3,) float, m
        Along the axes of the box.
    """

    tool_from_load: Floats
    size: Floats

    @classmethod
    def of(cls, base_from_tool: Floats, base_from_load: Floats, size: Floats) -> Load:
        """Return the load that a hand closes on, from both poses (4, 4), m, base frame."""
        return cls(np.linalg.inv(base_from_tool) @ base_from_load, np.asarray(size, np.float64))

    def turned(self, angle: float) -> Load:
        """Return the load turned by an angle (rad) about the closing axis."""
        return replace(self, tool_from_load=_about_x(angle) @ self.tool_from_load)

    def bottom(self, base_from_tool: Floats) -> float:
        """Return the height of its lowest corner, m, base frame, for a pose (4, 4) of the tool."""
        corners = self._in_tool(_CORNERS * self.size)
        return float((corners @ base_from_tool[2, :3]).min() + base_from_tool[2, 3])

    @property
    def reach(self) -> float:
        """Farthest that any of it is from the closing axis, m; it hangs no lower when it turns."""
        corners = self._in_tool(_CORNERS * self.size)
        return float(np.hypot(corners[:, 1], corners[:, 2]).max())

    def spheres(self) -> tuple[Floats, Floats]:
        """Return spheres that cover it: centres (k, 3), tool frame, and radii (k,), m."""
        radius = max(float(self.size.min()), _THINNEST_M) / 2
        reach = np.maximum(self.size / 2 - radius, 0.0)
        counts = np.ceil(2 * reach / (_SPACING * radius)).astype(int) + 1
        counts = np.minimum(counts, _MAX_SPHERES)
        grid = np.meshgrid(*[np.linspace(-r, r, n) for r, n in zip(reach, counts, strict=True)])
        centres = self._in_tool(np.stack([axis.ravel() for axis in grid], axis=1))
        return centres, np.full(len(centres), radius)

    def seen_turn(self, points: Floats, gap: float) -> float | None:
        """Return the angle (rad) about the closing axis by which the load is seen turned.

        Of the turns in steps of five degrees, it is the one that brings the surface of the box to
        most of the points between the jaws.

        Parameters
        ----------
        points : (n, 3) float, m, tool frame
            Of a view, without those of the table.
        gap
            Between the jaws, m: the hand itself shows no point in there, but for its palm.

        Returns
        -------
        float or None
            None if too little of it is seen, or no turn explains what is seen.
        """
        between = np.abs(points[:, 0]) < gap / 2 - _BESIDE_JAW_M
        between &= np.hypot(points[:, 1], points[:, 2]) < self.reach + _NOISE_M
        seen = points[between & (points[:, 2] > -_MAX_DEPTH_M)]
        if len(seen) < _MIN_POINTS:
            return None
        near = np.array([self.turned(float(turn))._count_near(seen) for turn in _TURNS])
        if near.max() < _MIN_EXPLAINED * len(seen):
            return None
        return float(_TURNS[near >= _BEST_SHARE * near.max()].mean())

    def _count_near(self, points: Floats) -> int:
        """Count the points (n, 3), tool frame, on the outline of the box along the closing axis."""
        rotation, origin = self.tool_from_load[:3, :3], self.tool_from_load[:3, 3]
        across = int(np.argmax(np.abs(rotation[0])))
        outside = np.abs((points - origin) @ rotation) - self.size / 2
        outside[:, across] = -np.inf
        return int((np.abs(outside.max(axis=1)) < _NOISE_M).sum())

    def _in_tool(self, points: Floats) -> Floats:
        """Return points (n, 3) of the box in the frame of the tool."""
        moved: Floats = points @ self.tool_from_load[:3, :3].T + self.tool_from_load[:3, 3]
        return moved


def _about_x(angle: float) -> Floats:
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.eye(4)
    turn[1:3, 1:3] = [[cos, -sin], [sin, cos]]
    return turn
