"""Grasp requests, planned grasps, and the rules of a hand with a diagonal mouth.

A request comes from perception: where to grasp, along which direction to close, and how large the
object is. The rules here derive from it what the planner tries, depending on measured sizes, never
on the name of a kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulate.motion.collision import Obstacle, PointField
from simulate.motion.trajectory import Trajectory

__all__ = ["GraspRequest", "PlannedGrasp", "closing_angles", "grasp_heights", "openings"]

_TALL = 0.045
_THIN = 0.028
_LONG = 0.060
_SECOND_SIDE_FITS = 0.036
_PEN_HEIGHTS = (0.0165, 0.012, 0.0085)
_FLAT, _TOO_FLAT = 0.55, 0.7
_PEN_YAW_OFFSETS = (0.0, 0.22, -0.22, 0.43, -0.43, 0.65, -0.65)


@dataclass(frozen=True)
class GraspRequest:
    """A grasp to plan, base frame of the robot; all values are perceived.

    Parameters
    ----------
    x, y
        Where to grasp, m.
    theta
        Closing direction about +z, rad, mod pi.
    z
        Height of the tool centre point, m, absolute; nan lets the rule choose.
    width
        Across the jaws at the grasp, m.
    height
        Of the object over the table, m.
    length
        Longer side of the footprint, m.
    opening
        Between the jaws before they close, m; the hand rounds it to what it can do.
    table_height
        m.
    arm
        ``left``, ``right`` (with or without ``_arm``) or ``auto``: the arm on that side of the
        table, the other one when it cannot.
    round
        Whether the footprint is a circle, so that any closing direction is suitable.
    mass
        kg, if known.
    position_tolerance
        Tolerance of the tool at the grasp, m.
    only_theta
        Close along theta and no other direction, even if another would do.
    outline
        Of the object seen from above: x, y, m, yaw of its longer side, rad, length, width, m; None
        = not known, and then the robot cannot see whether an end stays on the table.
    stances
        ``own``: the present stance; ``other``: another stance; ``any``: another one if necessary.
    pose : (4, 4) or None
        ``base_from_gripper``: the tool exactly so, x closing and z approaching; x, y, theta and z
        then follow from it, see :meth:`at_pose`, and no rule of the hand changes it.
    points : (n, 3) or None, m, base frame
        Of the object, where its shape is seen rather than known: with ``pose`` alone.
    bottom
        Height of the object's lowest point, m, absolute; nan = it stands on the table.
    """

    x: float
    y: float
    theta: float
    z: float = math.nan
    width: float = 0.03
    height: float = 0.05
    length: float = 0.03
    opening: float = 0.05
    table_height: float = 0.27
    arm: str = "auto"
    round: bool = False
    mass: float | None = None
    position_tolerance: float = 0.0015
    only_theta: bool = False
    stances: Literal["any", "own", "other"] = "any"
    outline: tuple[float, float, float, float, float] | None = None
    pose: NDArray[np.float64] | None = field(default=None, compare=False, repr=False)
    points: NDArray[np.float64] | None = field(default=None, compare=False, repr=False)
    bottom: float = math.nan

    @classmethod
    def at_pose(
        cls,
        pose: NDArray[np.float64],
        width: float,
        opening: float,
        points: NDArray[np.float64],
        table_height: float,
        mass: float | None = None,
    ) -> GraspRequest:
        """Return a request for one pose of the tool, as grasp planning in clutter gives it.

        Parameters
        ----------
        pose : (4, 4)
            ``base_from_gripper``.
        width, opening
            Between the contacts, and between the jaws before they close, m.
        points : (n, 3), m, base frame
            Seen of the object.
        table_height
            m.

        Raises
        ------
        ValueError
            The pose is not a rigid transform, or there are no points.
        """
        pose = np.asarray(pose, dtype=np.float64)
        rotation = pose[:3, :3] if pose.shape == (4, 4) else np.zeros((3, 3))
        rigid = np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-6)
        if not (rigid and np.isfinite(pose).all() and np.linalg.det(rotation) > 0):
            raise ValueError("pose must be a rigid transform (4, 4), base_from_gripper, in m")
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise ValueError(f"points must have shape (n, 3) in m, n > 0, got {points.shape}")
        size = np.ptp(points, axis=0)
        x, y, z = (float(v) for v in pose[:3, 3])
        return cls(
            x, y, float(np.arctan2(pose[1, 0], pose[0, 0])), z,
            width=width, height=float(size[2]), length=float(max(size[:2])), opening=opening,
            table_height=table_height, mass=mass, stances="own", pose=pose, points=points,
            bottom=max(float(points[:, 2].min()), table_height),
        )  # fmt: skip

    @property
    def base_height(self) -> float:
        """Height of the object's bottom, m, absolute."""
        return self.table_height if math.isnan(self.bottom) else self.bottom

    @property
    def is_tall(self) -> bool:
        """Whether the hand can close around it well above the table."""
        return self.height >= _TALL

    @property
    def lies_thin(self) -> bool:
        """Whether it is a thin, long object lying on the table, like a pen."""
        thin = self.height < _THIN and self.width < _THIN + 0.004
        return thin and self.length >= max(_LONG, 2.2 * self.width)

    @property
    def tilt_weight(self) -> float:
        """Weight of the angle of the approach; one rad of closing error weighs 1.5."""
        return 3.0 if self.lies_thin else 0.8

    @property
    def largest_tilt(self) -> float:
        """Largest tilt of the approach (rad from the vertical) to try."""
        return _TOO_FLAT if self.lies_thin else 1.35

    @property
    def yaw_weight(self) -> float:
        """Cost of each further closing direction of :func:`closing_angles`."""
        return 0.06 if self.lies_thin else 0.2

    def preferred_tilt(self, tool_height: float) -> float:
        """Return the angle (rad) of the approach from the vertical that holds best."""
        if self.lies_thin:  # the fingertips must sweep along the table on both sides
            return 0.28 + 14.0 * max(_PEN_HEIGHTS[0] - tool_height, 0.0)
        return 0.6


@dataclass(frozen=True, eq=False)
class PlannedGrasp:
    """A grasp with the way points that carry it out.

    Parameters
    ----------
    request
        The request.
    arm
        ``left_arm`` or ``right_arm``.
    opening
        Opening of the hand before closing, 0..1.
    closing_angle, tilt
        Closing direction that the arm achieves, and the angle of its approach to the vertical, rad.
    tool_height
        m over the table.
    posture : (dof,) float, rad
        At the grasp.
    free, approach, lift
        Waypoints from home to the pre-grasp, on to the grasp, and up.
    obstacles
        Obstacles that the planner avoided, without the object itself.
    ik_solutions
        Number of postures found for it.
    planning_s
        CPU seconds.
    seed
        Seed of the planner, also used for transport.
    stance
        Stance that the robot takes for it; empty if it keeps its own.
    least_s
        Time of its ways up to the end of the lift and, where it is known into which box the object
        is put, at least of those there and home, s; nan = not known.
    """

    request: GraspRequest
    arm: str
    opening: float
    closing_angle: float
    tilt: float
    tool_height: float
    posture: NDArray[np.float64]
    free: Trajectory
    approach: Trajectory
    lift: Trajectory
    obstacles: tuple[Obstacle | PointField, ...] = field(repr=False)
    ik_solutions: int
    planning_s: float
    seed: int
    stance: str = ""
    least_s: float = math.nan

    @property
    def is_doubtful(self) -> bool:
        """Whether to prefer another grasp of the object, if there is one.

        Measured with lying pens, poses known: held 31 of 37 at a tilt below .5, 12 of 15 up to .7,
        1 of 14 beyond, where the palm comes down before the fingers are around.
        """
        return self.request.lies_thin and self.tilt > _FLAT


def grasp_heights(request: GraspRequest) -> Iterator[float]:
    """Yield heights (m over the table) for the tool centre point, best first.

    A requested height is used within what the hand can do with an object of that size; for thin
    objects the table decides. Measured with pens and the hand fully open: 14 of 16 held at
    16 mm with a steep approach, 13 of 16 at 7 to 13 mm with a flatter one, 2 of 11 else.
    """
    if request.lies_thin:
        yield from _PEN_HEIGHTS
        return
    if request.is_tall:
        rule, low, high = min(max(0.5 * request.height, 0.026), 0.045), 0.024, 0.055
    else:
        rule = max(0.55 * request.height, 0.018)
        low, high = max(rule - 0.004, 0.016), rule + 0.004
    requested = request.z - request.table_height
    first = rule if math.isnan(requested) else min(max(requested, low), high)
    yield from (first, first + 0.007, first + 0.014)


def openings(request: GraspRequest) -> tuple[float, ...]:
    """Return how far (0..1) to open before the grasp, best first.

    Measured over 270 grasps of anything but pens: fully open 98 % held, .9 84 %, .8 45 %, .7 15 %.
    The mouth is V-shaped, and a narrower one leaves the object at its rim. Less than fully open is
    only for room between neighbours.
    """
    return (1.0, 0.75) if request.lies_thin else (1.0, 0.9)


def closing_angles(request: GraspRequest) -> tuple[float | None, ...]:
    """Return closing directions (rad) to try, best first; None leaves the direction free."""
    if request.only_theta:
        return (request.theta,)
    if request.round:
        return (None,)
    if request.lies_thin:
        return tuple(request.theta + offset for offset in _PEN_YAW_OFFSETS)
    if max(request.length, request.width) < _SECOND_SIDE_FITS:
        return (request.theta, request.theta + math.pi / 2)
    return (request.theta,)
