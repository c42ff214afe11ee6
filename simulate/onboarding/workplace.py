"""A workplace that suits an arm: table, boxes, cameras and the posture between grasps.

Where the arm can bring its hand down decides: several heights and distances of the table are tried,
and the one with the most grid points in reach is taken.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from simulate.motion.arm_space import ALLOWED, ArmSpace
from simulate.motion.kinematics import Chain, Goal, solve_ik
from simulate.robots.cameras import standing_cameras
from simulate.robots.description import Arm, Floats, Pose, RobotDescription, Workplace

__all__ = ["Placed", "home_postures", "place_robot", "reach_share"]

_DOWN = np.array([0.0, 0.0, -1.0])
_STEEP = 0.4
"""Largest angle (rad) of the hand to the vertical."""
_PANDA_REACH_M = 0.95
"""Reach of the arm for which the sizes of table and boxes were chosen."""
_MIN_TABLE_M = 0.05
_NEAR_M, _BOX_GAP_M, _RIM_M = 0.12, 0.06, 0.04
_TRIED_DISTANCES = (0.42, 0.50, 0.58)
_TRIED_HEIGHTS = (-0.45, -0.30, -0.15, -0.03)
"""Of the table: distance of the area's middle, and height over the shoulder, in reaches."""
_GRIP_M, _CARRY_M = 0.03, 0.12
"""Heights over the table at which the hand must come down."""
_TURNS = (0.0, math.pi / 2, -math.pi / 2, math.pi)
_ENOUGH = 0.9
_HOMES = tuple(itertools.product((1.45, 1.15, 1.75, 2.1), (0.30, 0.42, 0.54), (0.26, 0.36)))
"""Azimuth (rad) to the arm's side, distance in reaches, height over the table, m."""
_CLEAR_M = 0.02


@dataclass(frozen=True)
class Placed:
    """A robot at its workplace; ``share`` of a 5 x 7 grid is in reach, 0..1."""

    robot: RobotDescription
    share: float


def place_robot(robot: RobotDescription, seed: int = 0) -> Placed:
    """Return the robot at the table, out of those tried, that its arms reach best.

    Parameters
    ----------
    robot
        With arms, without fixed joints, its root at the origin of the base frame or above it.
    seed
        Of the starts of inverse kinematics.
    """
    best: Placed | None = None
    for turn in _TURNS:
        turned = _turned(robot, turn)
        reach, shoulder = _reach(turned, seed)
        for distance, height in itertools.product(_TRIED_DISTANCES, _TRIED_HEIGHTS):
            tried = _at_table(turned, reach, shoulder, distance, height)
            share = reach_share(tried, (3, 4), seed)
            if best is None or share > best.share + 1e-9:
                best = Placed(tried, share)
        if best is not None and best.share >= _ENOUGH:
            break
    assert best is not None
    finished = _with_cameras(best.robot)
    return Placed(finished, reach_share(finished, (5, 7), seed))


def _turned(robot: RobotDescription, angle: float) -> RobotDescription:
    spin = Pose((0.0, 0.0, 0.0), (0.0, 0.0, angle)).matrix
    return replace(robot, base_from_root=Pose.of(spin @ robot.base_from_root.matrix))


def _reach(robot: RobotDescription, seed: int) -> tuple[float, Floats]:
    """Return the largest distance (m) of a tool from its shoulder, and the shoulders' mean (3,)."""
    rng = np.random.default_rng((seed, 1))
    reaches, shoulders = [], []
    for name in robot.arms:
        chain = Chain.of(robot, name)
        q = chain.lower + rng.random((400, chain.dof)) * (chain.upper - chain.lower)
        _, positions = chain.link_frames(q)
        _, tools = chain.tool_poses(q)
        shoulder = positions[0, min(1, chain.dof - 1)]
        reaches.append(float(np.linalg.norm(tools - shoulder, axis=1).max()))
        shoulders.append(shoulder)
    return max(reaches), np.mean(shoulders, axis=0)


def _at_table(
    robot: RobotDescription, reach: float, shoulder: Floats, distance: float, height: float
) -> RobotDescription:
    """Return the robot at a table; it is lifted on a stand where the table would be too low."""
    scale = float(np.clip(reach / _PANDA_REACH_M, 0.55, 1.0))
    middle = float(shoulder[0]) + distance * reach
    top = float(shoulder[2]) + height * reach
    lift = max(_MIN_TABLE_M - top, 0.0)
    x, y, z = robot.base_from_root.xyz
    lifted = replace(robot.base_from_root, xyz=(x, y, z + lift))
    top = round(top + lift, 3)
    deep, inner = 0.07 * scale, round(max(0.20 * scale, 0.15), 3)
    aside = round(0.15 * scale + 0.03, 3)
    box = round(aside + _BOX_GAP_M + inner / 2, 3)
    near = round(middle - deep - _NEAR_M, 3)
    place = Workplace(
        table_height=top,
        table_near=near,
        table_size=(0.5, round(2 * (box + inner / 2 + 0.06), 3), 0.02),
        box_centre=(round(middle - 0.01, 3), box),
        box_inner=inner,
        box_height=_RIM_M,
        area_x=(round(middle - deep, 3), round(middle + deep, 3)),
        area_abs_y=(0.03, aside),
        eye=(round(middle + 0.68, 3), -0.70, round(top + 0.55, 3)),
        target=(round(middle - 0.05, 3), -0.12, round(top + 0.05, 3)),
    )
    return replace(robot, base_from_root=lifted, workplace=place)


def reach_share(robot: RobotDescription, grid: tuple[int, int] = (5, 7), seed: int = 0) -> float:
    """Return the share of a grid over the table's area and boxes where a hand comes down.

    Parameters
    ----------
    robot
        At its workplace.
    grid
        Points along x and along y of the area; the boxes' middles are added.
    seed
        Of the starts of inverse kinematics.
    """
    place = robot.workplace
    chains = {name: Chain.of(robot, name) for name in robot.arms}
    reached = []
    for x, y, height in _points(place, grid):
        side = 1 if y > 0 else -1
        arms = [arm for arm in robot.arms.values() if arm.side in (0, side)]
        target = np.array([x, y, place.table_height + height])
        reached.append(any(_comes_down(chains[arm.name], target, seed) for arm in arms))
    return float(np.mean(reached))


def _points(place: Workplace, grid: tuple[int, int]) -> Iterator[tuple[float, float, float]]:
    (_, far), rows = place.area_abs_y, grid[1]
    for x in np.linspace(*place.area_x, grid[0]):
        for y in np.linspace(-far, far, rows):
            yield float(x), float(y), _GRIP_M
    middle = sum(place.area_x) / 2
    yield middle, far, _CARRY_M
    yield middle, -far, _CARRY_M
    for sign in (-1, 1):
        x, y = place.box_centre
        yield x, sign * y, place.box_height + _CARRY_M


def _comes_down(chain: Chain, target: Floats, seed: int) -> bool:
    rng = np.random.default_rng((seed, 2))
    closing = np.array([0.0, 1.0, 0.0]) if chain.orients_freely else None
    goal = Goal(target, closing, _DOWN, chain.orients_freely)
    postures = solve_ik(chain, goal, rng)
    if not len(postures):
        return False
    rotation, _ = chain.tool_poses(postures)
    return bool((rotation[:, :, 2] @ _DOWN).max() >= math.cos(_STEEP))


def _with_cameras(robot: RobotDescription) -> RobotDescription:
    """Return the robot with its own camera if that sees the area, else with one on a stand."""
    own = {name: mount for name, mount in robot.cameras.items() if _sees(robot, name)}
    stand = standing_cameras(robot.root, robot.workplace, robot.base_from_root)
    if own:
        stand.pop("camera_depth")
    return replace(robot, cameras={**own, **stand})


def _sees(robot: RobotDescription, name: str) -> bool:
    """Tell whether a camera that no joint carries has the whole area in view."""
    mount = robot.cameras[name]
    if mount.parent != robot.root:
        return False
    place = robot.workplace
    corners = np.array(list(itertools.product(place.area_x, (-1, 1), [place.table_height])))
    corners[:, 1] *= place.area_abs_y[1]
    mount_from_base = np.linalg.inv(robot.base_from_root.matrix @ mount.pose.matrix)
    seen = corners @ mount_from_base[:3, :3].T + mount_from_base[:3, 3]  # x forward, y left, z up
    half = math.tan(mount.horizontal_fov / 2)
    high = half * mount.size[1] / mount.size[0]
    ahead = seen[:, 0] > mount.depth_range[0]
    inside = (np.abs(seen[:, 1]) < half * seen[:, 0]) & (np.abs(seen[:, 2]) < high * seen[:, 0])
    return bool((ahead & inside).all())


def home_postures(robot: RobotDescription, arm: Arm, seed: int = 0) -> Iterator[Floats]:
    """Yield postures (dof,) rad with the hand down beside the table's area, best first.

    They are free of collisions with table, boxes and the rest of the body, and out of the area that
    the camera sees.
    """
    space = ArmSpace(robot)
    chain = space.chains[arm.name]
    spheres = space.spheres(arm.name, 1.0)
    place = robot.workplace
    around = space.surroundings(arm.name, place.table_height, ())
    slack = spheres.slack(around, ALLOWED)
    reach, _ = _reach(robot, seed)
    _, positions = chain.link_frames((chain.lower + chain.upper)[None] / 2)
    shoulder = positions[0, min(1, chain.dof - 1)]
    for sign in (arm.side,) if arm.side else (-1, 1):
        for azimuth, distance, height in _HOMES:
            away = distance * reach * np.array([math.cos(azimuth), sign * math.sin(azimuth)])
            target = np.array([*(shoulder[:2] + away), place.table_height + height])
            rng = np.random.default_rng((seed, 3))
            must = chain.orients_freely
            for posture in solve_ik(chain, Goal(target, None, _DOWN, must), rng)[:4]:
                free = float(spheres.clearances(posture[None], around, slack)[0])
                if free >= _CLEAR_M and not _over_area(chain, posture, place):
                    yield posture


def _over_area(chain: Chain, posture: Floats, place: Workplace) -> bool:
    """Tell whether a joint or the tool is above the area of objects."""
    _, positions = chain.link_frames(posture[None])
    _, tool = chain.tool_poses(posture[None])
    points = np.concatenate([positions[0], tool])
    inside = (points[:, 0] > place.area_x[0]) & (np.abs(points[:, 1]) < place.area_abs_y[1])
    return bool(inside.any())
