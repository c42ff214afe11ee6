"""Planning of the transport and the release of a held object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from features.geometry import pose_matrix
from simulate.grasping.judgement import HeightMap
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import ALLOWED, SPEED, ArmSpace
from simulate.motion.collision import ArmSpheres, Obstacle, Surroundings
from simulate.motion.kinematics import Chain, Goal, IkOptions, follow_line, solve_ik
from simulate.motion.load import Load
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, join, time_path
from simulate.robots.description import Floats
from simulate.world.world import PlaceBox

__all__ = ["TABLE_DESCENTS", "PlacePlan", "PlaceSpot", "held_load", "plan_place", "plan_rise"]

_SPOTS = ((0.0, 0.0), (-0.03, 0.03), (-0.03, -0.03), (0.03, 0.03), (0.03, -0.03))
_SPOT_M = 0.03
_DESCENTS = ((0.012, 0.055), (0.025, 0.055), (0.040, 0.040), (0.060, 0.020), (0.080, 0.010))
"""Bottom of the object over the ground of the box when the hand opens, and the straight way down
to there, m. Low is gentle; long things may only fit over the walls."""
_GENTLE = (0.003, 0.055)
TABLE_DESCENTS = (_GENTLE, *_DESCENTS)
"""The same for a table: an object is lowered fully if it can be, as a drop may topple it."""
_POSTURES_TRIED = 6
_TURN_WEIGHT, _JOINT_WEIGHT = 3.0, 0.3
_LOAD_TOLERANCE = 0.012
_LARGE = 0.08
_RISES = (1.0, 0.67, 0.33)
"""Shares of what an end of the object hangs down by which the hand first rises, best first."""
_HANGS_M = 0.005
_CLIMB_M, _HIGHEST_CLIMB_M = 0.02, 0.40
"""Steps in which the hand rises while the load overlaps what stands around it, and their sum."""
_ASIDE_M = 0.004
"""By which an overlap may deepen on the way up: the arm follows a line within some millimetres."""
_HIGHEST_M = 0.08
"""Over the ground of a box: what is seen higher is the robot's arm, which hides what lies there."""
_TOP_SHARE = 0.95
"""Share of the occupied cells of a box below what counts as their height: stray ones do not."""
_IK = IkOptions(angle_tolerance=0.6, position_tolerance=0.004)
_TURNED_IK = IkOptions(angle_tolerance=0.2, position_tolerance=0.004)
_PURPOSE = 2

_CARRYING: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.006,
    ("box", "finger"): 0.002,
    ("neighbour", "load"): 0.004,
}
_LEAVING: Mapping[tuple[str, str], float] = {
    **_CARRYING,
    ("placed", "finger"): 0.02,
    ("placed", "palm"): 0.01,
}
"""The open hand may still be around what it has put down when its way home begins."""
_LETTING_GO: Mapping[tuple[str, str], float] = {
    **_LEAVING,
    ("placed", "finger"): np.inf,
    ("placed", "palm"): 0.02,
}
_SLANTS = ((0.030, 0.030), (0.030, 0.050), (0.015, 0.040), (0.015, 0.060))
"""Ways up and away from the shoulder, m, to where the arm does not get straight up."""
_BACK_M = 0.045
"""By which the hand backs off from what it has put down there, m."""


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
    walled: bool = True
    """Whether walls around it keep the way home clear of what is put there."""
    closings: tuple[tuple[float, ...], ...] = ()
    """Closing directions about the vertical, rad, base frame, to try first at each of the centres:
    so turned, others get their hands around what is put there. None: any will do."""

    @property
    def grounds(self) -> tuple[float, ...]:
        """Heights over which the object may be let go, m, base frame, best first."""
        return (self.floor + self.filled, self.floor) if self.filled else (self.floor,)

    @property
    def turned(self) -> Iterator[tuple[tuple[float, float], Floats | None]]:
        """Yield each place with the closing directions (3,) to try there; None for any."""
        closings = self.closings or ((),) * len(self.centres)
        for centre, angles in zip(self.centres, closings, strict=True):
            for angle in angles:
                yield centre, np.array([np.cos(angle), np.sin(angle), 0.0])
        yield from ((centre, None) for centre in self.centres)

    @classmethod
    def on_table(cls, x: float, y: float, floor: float) -> PlaceSpot:
        """Return one place on a table."""
        return cls(floor, ((x, y),), TABLE_DESCENTS, walled=False)

    @classmethod
    def in_box(
        cls, box: PlaceBox, used: int, size: float, seen: HeightMap | None = None
    ) -> PlaceSpot:
        """Return the places in a box into which ``used`` objects were put before.

        Each object goes to another spot; a large one (``size`` m) goes to the middle, onto what is
        there, because it would not clear the walls elsewhere. Spots that the robot sees come first:
        a NAO's own arm hides a strip of its box, and what comes to lie there it cannot find again.

        Parameters
        ----------
        seen
            The box as it was seen before.
        """
        first = 0 if size > _LARGE else used
        x, y = box.centre
        turned = (_SPOTS[(first + shift) % len(_SPOTS)] for shift in range(len(_SPOTS)))
        spots = [(x + dx, y + dy) for dx, dy in turned]
        if seen is None:
            return cls(box.floor, tuple(spots))
        spots.sort(key=lambda spot: not _is_in_view(seen, *spot))
        return cls(box.floor, tuple(spots), filled=_filled(seen))


def _is_in_view(seen: HeightMap, x: float, y: float) -> bool:
    """Tell whether most of what is around a spot is seen."""
    around = np.isfinite(seen.heights[seen.within(x, y, 0.0, _SPOT_M, _SPOT_M)])
    return bool(around.size and around.mean() > 0.5)


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
    turn: float = 0.0,
) -> PlacePlan | str:
    """Plan the transport of a held object to a place.

    Where an end of it hangs down, the hand first rises by as much; where the load overlaps what
    stands around it, until it is free or as high as the arm gets.

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
    turn
        By which the object has turned in the hand about the closing axis, rad.

    Returns
    -------
    PlacePlan or str
        ``place_plan`` if there is no path.
    """
    chain, request = space.chains[plan.arm], plan.request
    empty = space.spheres(plan.arm, plan.opening)
    upright_load = held_load(plan, chain)
    load = upright_load.turned(turn)
    centres, radii = load.spheres()
    loaded = empty.carrying(centres @ chain.tool.rotation.T + chain.tool.origin, radii)
    around = space.surroundings(plan.arm, request.table_height, plan.obstacles)
    slack = loaded.slack(around, _CARRYING)
    rng = np.random.default_rng((plan.seed, _PURPOSE))
    tool, _ = chain.tool_poses(start[None])
    base_from_tool = pose_matrix(*(part[0] for part in chain.tool_poses(start[None])))
    hangs = upright_load.bottom(base_from_tool) - load.bottom(base_from_tool)
    tool_over_bottom = request.table_height + plan.tool_height - request.base_height + hangs
    upright = tool[0, 2]
    approach = tool[0, :, 2] if chain.orients_freely else None
    _, lifted = chain.tool_poses(plan.lift.positions[-1:])
    higher = float(base_from_tool[2, 3] - lifted[0, 2])
    rise = _rise(chain, loaded, around, slack, start, hangs - higher)
    rise = _climb(chain, loaded, around, slack, rise)
    if loaded.clearances(rise[-1:], around, slack)[0] < -_LOAD_TOLERANCE:
        return "place_plan"
    hold = _Hold(space, plan, load, loaded, around, rise)
    for ground, (release, above) in product(spot.grounds, spot.descents):
        for (x, y), closing in spot.turned:
            position = np.array([x, y, ground + tool_over_bottom + release])
            goal = Goal(position, closing, approach, chain.orients_freely)
            options = _IK if closing is None else _TURNED_IK
            postures = solve_ik(chain, goal, rng, options, warm=start[None])
            for posture in _most_upright(chain, postures, upright, start):
                line = follow_line(chain, posture, np.array([0.0, 0.0, above]), tolerance=0.006)
                if line is None or (loaded.clearances(line, around, slack) < 0).any():
                    continue
                planned = _complete(hold, line, position)
                if planned is not None and not spot.walled:
                    return _clear_of(hold, line, planned)
                if planned is not None:
                    return planned
    if spot.walled or chain.orients_freely:
        return "place_plan"
    for x, y in spot.centres:
        position = np.array([x, y, spot.floor + tool_over_bottom + _GENTLE[0]])
        postures = solve_ik(chain, Goal(position), rng, _IK, warm=start[None])
        aslant = _aslant(hold, _most_upright(chain, postures, upright, start), position)
        if aslant is not None:
            return aslant
    return "place_plan"


@dataclass(frozen=True, eq=False)
class _Hold:
    """A held object, the arm that carries it, and what stands around.

    ``rise`` (k, dof) are the postures up from which its transport begins.
    """

    space: ArmSpace
    plan: PlannedGrasp
    load: Load
    loaded: ArmSpheres
    around: Surroundings
    rise: Floats

    @property
    def chain(self) -> Chain:
        """Joints of the arm."""
        return self.space.chains[self.plan.arm]

    @property
    def empty(self) -> ArmSpheres:
        """Collision model of the arm whose open hand has let go."""
        return self.space.spheres(self.plan.arm, self.plan.opening)

    def with_placed(self, posture: Floats) -> Surroundings:
        """Return what stands around, and the object where it is let go in a posture."""
        base_from_load = pose_matrix(*(part[0] for part in self.chain.tool_poses(posture[None])))
        base_from_load = base_from_load @ self.load.tool_from_load
        at, rotation = base_from_load[:3, 3], base_from_load[:3, :3]
        return self.around.with_obstacles([Obstacle("placed", at, self.load.size / 2, rotation)])


def plan_rise(space: ArmSpace, plan: PlannedGrasp, start: Floats, height: float) -> Trajectory:
    """Plan the way straight up with a held object, by a height (m) or as far as the arm can."""
    chain = space.chains[plan.arm]
    spheres = space.spheres(plan.arm, plan.opening)
    around = space.surroundings(plan.arm, plan.request.table_height, plan.obstacles)
    line = _rise(chain, spheres, around, spheres.slack(around, _CARRYING), start, height)
    return time_path(line, SPEED["lift"] * chain.velocity, CARRYING_ACCELERATION)


def _complete(hold: _Hold, line: Floats, tool: Floats) -> PlacePlan | None:
    """Return the plan that goes down a line (k, dof), given upwards, and up it again; or none."""
    chain = hold.chain
    transport, back = _transport(hold, line[-1]), _way_home(hold, hold.around, line[-1])
    if transport is None or back is None:
        return None
    return PlacePlan(
        transport,
        time_path(line[::-1], SPEED["approach"] * chain.velocity, CARRYING_ACCELERATION),
        join([time_path(line, 2 * SPEED["approach"] * chain.velocity), back]),
        back,
        tool,
    )


def _transport(hold: _Hold, goal: Floats) -> Trajectory | None:
    """Return the way of the held object to over its place, if there is one."""
    plan, chain, rise = hold.plan, hold.chain, hold.rise
    transport = hold.space.path(
        plan.arm, hold.loaded, hold.around, rise[-1], goal, plan.seed, SPEED["transport"],
        CARRYING_ACCELERATION, _LOAD_TOLERANCE, _CARRYING,
    )  # fmt: skip
    if isinstance(transport, str):
        return None
    if len(rise) > 1:
        up = time_path(rise, SPEED["lift"] * chain.velocity, CARRYING_ACCELERATION)
        transport = join([up, transport])
    return transport


def _way_home(
    hold: _Hold,
    around: Surroundings,
    start: Floats,
    allowed: Mapping[tuple[str, str], float] = _CARRYING,
) -> Trajectory | None:
    """Return the way home of the empty hand, if there is one."""
    arm = hold.plan.arm
    home = np.array(hold.space.robot.arm(arm).home)
    back = hold.space.path(
        arm, hold.empty, around, start, home, hold.plan.seed, SPEED["return"], allowed=allowed
    )
    return None if isinstance(back, str) else back


def _aslant(hold: _Hold, postures: Floats, tool: Floats) -> PlacePlan | None:
    """Return a plan that comes down from farther away, for a place near the shoulder, or none.

    There an arm does not get straight up. The open hand leaves the object as it would leave one
    that it did not grasp, back along its approach.
    """
    chain = hold.chain
    _, shoulder = chain.link_frames(postures)
    slack = hold.loaded.slack(hold.around, _CARRYING)
    for posture, first in zip(postures, shoulder[:, 0], strict=True):
        away = (tool - first) * [1.0, 1.0, 0.0]
        away /= max(float(np.linalg.norm(away)), 1e-6)
        rotation, _ = chain.tool_poses(posture[None])
        placed = hold.with_placed(posture)
        touching = hold.empty.slack(placed, _LETTING_GO)
        leave = follow_line(chain, posture, -_BACK_M * rotation[0, :, 2], tolerance=0.006)
        if leave is None or (hold.empty.clearances(leave, placed, touching) < 0).any():
            continue
        for up, out in _SLANTS:
            line = follow_line(chain, posture, out * away + [0.0, 0.0, up], tolerance=0.006)
            if line is None or (hold.loaded.clearances(line, hold.around, slack) < 0).any():
                continue
            home = _way_home(hold, placed, leave[-1]) or _way_home(
                hold, placed, leave[-1], _LEAVING
            )
            transport, back = _transport(hold, line[-1]), _way_home(hold, hold.around, line[-1])
            if home is None or transport is None or back is None:
                continue
            lower = time_path(line[::-1], SPEED["approach"] * chain.velocity, CARRYING_ACCELERATION)
            away_from_it = time_path(leave, 2 * SPEED["approach"] * chain.velocity)
            return PlacePlan(transport, lower, join([away_from_it, home]), back, tool)
    return None


def _clear_of(hold: _Hold, line: Floats, planned: PlacePlan) -> PlacePlan:
    """Return the plan with a way home that stays clear of the placed object, if there is one."""
    placed, chain = hold.with_placed(line[0]), hold.chain
    # From above the object nothing of it need be allowed; from around it the fingers would be
    # allowed to sweep along its top, which topples a can that was set down upright.
    out = _out_of(hold, placed, line)
    for up, allowed in ((out, _CARRYING), (line, _LEAVING)):
        back = _way_home(hold, placed, up[-1], allowed)
        if back is not None:
            leave = time_path(up, 2 * SPEED["approach"] * chain.velocity)
            return replace(planned, retreat=join([leave, back]))
    return planned


def _out_of(hold: _Hold, placed: Surroundings, line: Floats) -> Floats:
    """Return a line (k, dof) continued straight up until the open hand is free of the object."""
    slack = hold.empty.slack(placed, _CARRYING)
    allowed = hold.empty.forgiving(line[-1], placed, slack)
    for _ in range(round(_HIGHEST_CLIMB_M / _CLIMB_M)):
        if hold.empty.clearances(line[-1:], placed, slack)[0] >= 0:
            break
        up = np.array([0.0, 0.0, _CLIMB_M])
        more = follow_line(hold.chain, line[-1], up, points=4, tolerance=0.006)
        if more is None or (hold.empty.clearances(more, placed, allowed) < -_ASIDE_M).any():
            break
        line = np.concatenate([line, more[1:]])
    return line


def _rise(
    chain: Chain,
    loaded: ArmSpheres,
    around: Surroundings,
    slack: Floats,
    start: Floats,
    height: float,
) -> Floats:
    """Return the line (k, dof) straight up by a height, m, or by less if need be.

    Without one, it is the start alone.
    """
    if height > _HANGS_M:
        free = min(float(loaded.clearances(start[None], around, slack)[0]), 0.0)
        for share in _RISES:
            line = follow_line(chain, start, np.array([0.0, 0.0, share * height]), tolerance=0.006)
            if line is not None and (loaded.clearances(line, around, slack) >= free).all():
                return line
    return start[None]


def _climb(
    chain: Chain, loaded: ArmSpheres, around: Surroundings, slack: Floats, line: Floats
) -> Floats:
    """Return a line (k, dof) continued straight up until the load is free, if it is not yet.

    It ends where the arm gets no higher, or where anything but what the load overlaps already
    would be touched.
    """
    if loaded.clearances(line[-1:], around, slack)[0] >= -_LOAD_TOLERANCE:
        return line
    out = loaded.forgiving(line[-1], around, slack)
    for _ in range(round(_HIGHEST_CLIMB_M / _CLIMB_M)):
        up = follow_line(chain, line[-1], np.array([0.0, 0.0, _CLIMB_M]), points=4, tolerance=0.006)
        if up is None or (loaded.clearances(up, around, out) < -_ASIDE_M).any():
            break
        line = np.concatenate([line, up[1:]])
        if loaded.clearances(line[-1:], around, slack)[0] >= 0:
            break
    return line


def _most_upright(chain: Chain, postures: Floats, upright: Floats, start: Floats) -> Floats:
    """Return the best few postures, those that tilt the object and move the joints least."""
    if len(postures) == 0:
        return postures
    tip = np.linalg.norm(chain.tool_poses(postures)[0][:, 2] - upright, axis=1)
    travel = np.abs(postures - start).max(axis=1)
    order = np.argsort(_TURN_WEIGHT * tip + _JOINT_WEIGHT * travel, kind="stable")
    return postures[order[:_POSTURES_TRIED]]


def held_load(plan: PlannedGrasp, chain: Chain) -> Load:
    """Return what a grasp closes on, as it is seen before.

    The hand may hold it far from its middle.
    """
    request = plan.request
    if request.outline is not None:
        x, y, yaw, length, width = request.outline
        seen = _standing(request, x, y, yaw, (length, width))
    elif request.points is not None:
        seen = Obstacle.around("load", request.points, request.base_height)
    else:
        footprint = (request.width, max(request.length, request.width))
        seen = _standing(request, request.x, request.y, request.theta, footprint)
    rotation, position = chain.tool_poses(plan.posture[None])
    base_from_tool = pose_matrix(rotation[0], position[0])
    return Load.of(base_from_tool, pose_matrix(seen.rotation, seen.centre), 2 * seen.half)


def _standing(
    request: GraspRequest, x: float, y: float, yaw: float, footprint: tuple[float, float]
) -> Obstacle:
    middle = (x, y, request.base_height + request.height / 2)
    return Obstacle.box("load", middle, (*footprint, request.height), yaw)
