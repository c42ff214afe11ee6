"""Planning of the transport and the release of a held object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from simulate.grasping.judgement import HeightMap
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import ALLOWED, SPEED, ArmSpace
from simulate.motion.collision import ArmSpheres, Surroundings
from simulate.motion.kinematics import Chain, Goal, IkOptions, follow_line, solve_ik
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, join, time_path
from simulate.robots.description import Floats
from simulate.world.world import PlaceBox

__all__ = ["PlacePlan", "PlaceSpot", "plan_place"]

_SPOTS = ((0.0, 0.0), (-0.03, 0.03), (-0.03, -0.03), (0.03, 0.03), (0.03, -0.03))
_DESCENTS = ((0.012, 0.055), (0.025, 0.055), (0.040, 0.040), (0.060, 0.020), (0.080, 0.010))
"""Bottom of the object over the ground of the box when the hand opens, and the straight way down
to there, m. Low is gentle; long things may only fit over the walls."""
_GENTLE = (0.003, 0.055)
_POSTURES_TRIED = 6
_TURN_WEIGHT, _JOINT_WEIGHT = 3.0, 0.3
_LOAD_TOLERANCE = 0.012
_LARGE, _THINNEST_M = 0.08, 0.004
_HIGHEST_M = 0.08
"""Over the ground of a box: what is seen higher is the robot's arm, which hides what lies there."""
_TOP_SHARE = 0.95
"""Share of the occupied cells of a box below what counts as their height: stray ones do not."""
_IK = IkOptions(angle_tolerance=0.6, position_tolerance=0.004)
_PURPOSE = 2

_CARRYING: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.006,
    ("box", "finger"): 0.002,
    ("neighbour", "load"): 0.004,
}


@dataclass(frozen=True)
class PlaceSpot:
    """Positions where an object may be placed.

    Parameters
    ----------
    floor
        Height of the supporting surface, m, base frame.
    centres
        Places (x, y) m to try, best first.
    descents
        Bottom of the object over the ground when the hand opens, and the straight way down to
        there, m; best first.
    filled
        Height of what lies there already, over the floor, m, as far as it is seen. The object is
        let go over it if it can be, else over the floor.
    """

    floor: float
    centres: tuple[tuple[float, float], ...]
    descents: tuple[tuple[float, float], ...] = _DESCENTS
    filled: float = 0.0

    @property
    def grounds(self) -> tuple[float, ...]:
        """Heights over which the object may be let go, m, base frame, best first."""
        return (self.floor + self.filled, self.floor) if self.filled else (self.floor,)

    @classmethod
    def on_table(cls, x: float, y: float, floor: float) -> PlaceSpot:
        """Return one place on a table; the object is lowered fully, as a drop may topple it."""
        return cls(floor, ((x, y),), (_GENTLE, *_DESCENTS))

    @classmethod
    def in_box(
        cls, box: PlaceBox, used: int, size: float, seen: HeightMap | None = None
    ) -> PlaceSpot:
        """Return the places in a box into which ``used`` objects were put before.

        Each object goes to another spot; a large one (``size`` m) goes to the middle, onto what is
        there, because it would not clear the walls elsewhere.

        Parameters
        ----------
        seen
            The box as it was seen before.
        """
        first = 0 if size > _LARGE else used
        x, y = box.centre
        spots = [_SPOTS[(first + shift) % len(_SPOTS)] for shift in range(len(_SPOTS))]
        filled = 0.0 if seen is None else _filled(seen)
        return cls(box.floor, tuple((x + dx, y + dy) for dx, dy in spots), filled=filled)


def _filled(seen: HeightMap) -> float:
    """Return the height of what lies in a box, m; 0 if it is empty or the robot's arm is before it.

    Cells along the walls may show their rims.
    """
    inner = seen.heights[1:-1, 1:-1]
    lying = inner[seen.occupied[1:-1, 1:-1]]
    if not lying.size or lying.max() > _HIGHEST_M:
        return 0.0
    return float(np.quantile(lying, _TOP_SHARE))


@dataclass(frozen=True, eq=False)
class PlacePlan:
    """Waypoints over the box, down into it, and home once the hand is open.

    ``back`` leads home from over the box, for a hand that lost the object on the way; ``tool`` (3,)
    m, base frame, is the tool position at release.
    """

    transport: Trajectory
    lower: Trajectory
    retreat: Trajectory
    back: Trajectory
    tool: Floats


def plan_place(
    space: ArmSpace,
    plan: PlannedGrasp,
    start: Floats,
    spot: PlaceSpot,
) -> PlacePlan | str:
    """Plan the transport of a held object to a place.

    Parameters
    ----------
    space
        Of the robot.
    plan
        The grasp that holds the object.
    start : (dof,) float, rad
        Posture at the top of the lift.
    spot
        Where to.

    Returns
    -------
    PlacePlan or str
        ``place_plan`` if there is no path.
    """
    chain, request = space.chains[plan.arm], plan.request
    empty = space.spheres(plan.arm, plan.opening)
    loaded = empty.carrying(*_load(plan, chain))
    around = space.surroundings(plan.arm, request.table_height, plan.obstacles)
    slack = loaded.slack(around, _CARRYING)
    rng = np.random.default_rng((plan.seed, _PURPOSE))
    tool, _ = chain.tool_poses(start[None])
    tool_over_bottom = request.table_height + plan.tool_height - request.base_height
    upright = tool[0, 2]
    approach = tool[0, :, 2] if chain.orients_freely else None
    for ground, (release, above) in product(spot.grounds, spot.descents):
        for x, y in spot.centres:
            height = ground + tool_over_bottom + release
            goal = Goal(np.array([x, y, height]), None, approach, chain.orients_freely)
            found = solve_ik(chain, goal, rng, _IK, warm=start[None])
            for posture in _most_upright(chain, found, upright, start):
                line = follow_line(chain, posture, np.array([0.0, 0.0, above]), tolerance=0.006)
                if line is None or (loaded.clearances(line, around, slack) < 0).any():
                    continue
                planned = _complete(space, plan, loaded, around, start, line, goal.position)
                if planned is not None:
                    return planned
    return "place_plan"


def _complete(
    space: ArmSpace,
    plan: PlannedGrasp,
    loaded: ArmSpheres,
    around: Surroundings,
    start: Floats,
    line: Floats,
    tool: Floats,
) -> PlacePlan | None:
    chain = space.chains[plan.arm]
    transport = space.path(
        plan.arm,
        loaded,
        around,
        start,
        line[-1],
        plan.seed,
        SPEED["transport"],
        CARRYING_ACCELERATION,
        _LOAD_TOLERANCE,
        _CARRYING,
    )
    if isinstance(transport, str):
        return None
    home = np.array(space.robot.arm(plan.arm).home)
    empty = space.spheres(plan.arm, plan.opening)
    back = space.path(
        plan.arm, empty, around, line[-1], home, plan.seed, SPEED["return"], allowed=_CARRYING
    )
    if isinstance(back, str):
        return None
    return PlacePlan(
        transport,
        time_path(line[::-1], SPEED["approach"] * chain.velocity, CARRYING_ACCELERATION),
        join([time_path(line, 2 * SPEED["approach"] * chain.velocity), back]),
        back,
        tool,
    )


def _most_upright(chain: Chain, found: Floats, upright: Floats, start: Floats) -> Floats:
    """Return the best few postures, those that tilt the object and move the joints least."""
    if len(found) == 0:
        return found
    tip = np.linalg.norm(chain.tool_poses(found)[0][:, 2] - upright, axis=1)
    travel = np.abs(found - start).max(axis=1)
    order = np.argsort(_TURN_WEIGHT * tip + _JOINT_WEIGHT * travel, kind="stable")
    return found[order[:_POSTURES_TRIED]]


def _load(plan: PlannedGrasp, chain: Chain) -> tuple[Floats, Floats]:
    """Cover the held object with spheres: centres (k, 3) in the wrist frame, radii (k,), m."""
    request = plan.request
    middle, yaw, size = _extent(request)
    radius = max(float(size.min()), _THINNEST_M) / 2
    reach = np.maximum(size / 2 - radius, 0.0)
    counts = np.minimum(np.ceil(2 * reach / (1.6 * radius)).astype(int) + 1, 8)
    grid = np.meshgrid(*[np.linspace(-r, r, n) for r, n in zip(reach, counts, strict=True)])
    local = np.stack([axis.ravel() for axis in grid], axis=1)
    cos, sin = np.cos(yaw), np.sin(yaw)
    across = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    rotations, positions = chain.link_frames(plan.posture[None])
    points = local @ across.T + middle
    return (points - positions[0, -1]) @ rotations[0, -1], np.full(len(points), radius)


def _extent(request: GraspRequest) -> tuple[Floats, float, Floats]:
    """Return the middle (3,) m, base frame, yaw (rad) and size (3,) m of what is grasped.

    The hand may hold it far from its middle.
    """
    height = request.base_height + request.height / 2
    if request.outline is not None:
        x, y, yaw, length, width = request.outline
        return np.array([x, y, height]), yaw, np.array([length, width, request.height])
    if request.points is not None:
        low, high = request.points.min(axis=0), request.points.max(axis=0)
        x, y = (low + high)[:2] / 2
        return np.array([x, y, height]), 0.0, np.array([*(high - low)[:2], request.height])
    size = np.array([request.width, max(request.length, request.width), request.height])
    return np.array([request.x, request.y, height]), request.theta, size
