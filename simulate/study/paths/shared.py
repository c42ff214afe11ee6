"""Trajectories that one robot stored, followed by others through the graph (Kehoe 2014, 1.2).

A robot plans its ways at some tables and reports each with its joints. Another one asks the graph
for them: one of the same body, one that follows with its other arm, and one of another body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import rtask
from rtask.engine.engine import Engine
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.arm_space import ALLOWED
from simulate.motion.collision import Obstacle
from simulate.motion.remembered import PathMemory
from simulate.motion.shared_paths import (
    following_joints,
    mirror_signs,
    path_of,
    way_before_closing,
)
from simulate.motion.trajectory import join
from simulate.robots.description import Arm, Floats, RobotDescription
from simulate.study.paths.trial import (
    BEFORE,
    Cell,
    LaidTable,
    cell_of,
    lay_table,
    plan_item,
    ways_of,
)
from simulate.world.seeds import mix_seed, stream

__all__ = ["PAIRS", "run_trial"]

_OTHER_BODY = {"panda": "nao", "nao": "panda"}
PAIRS = ("panda, the same body", "nao, the same arm", "nao, the other arm")
"""Who follows whose movements; they take turns."""
_FRESH, _TAUGHT = 84, 85
_RATE_HZ = 20.0
_OPEN, _CLOSED = 1.0, 0.0
_TEACHER, _FOLLOWER, _STRANGER = "teacher-1", "follower-1", "stranger-1"
_MIRROR = np.array([1.0, -1.0, 1.0])
_AT_THE_MIDDLE = {"in_object": {"x": 0.0, "y": 0.0, "z": 0.0, "theta": 0.0}}
_TOUCH_M = 0.002
"""Samples lie up to so much off a way that was planned: a twentieth of a second apart, rounded."""


@dataclass(frozen=True)
class _Taught:
    """A way that the first robot planned, and what stood around."""

    plan: PlannedGrasp
    around: Sequence[Obstacle]


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Let one robot store its movements and another one use them at a fresh table.

    Returns
    -------
    ``stored``, ``offered`` and ``refused``: movements; ``said``: reasons of the refusals.
    ``astray_m``: how far the follower's hand is from that of the first robot, or from its mirror
    image, at most; ``free``: of the offered ways, those that the follower finds free where they
    were made. ``things``: work at a fresh table as in :mod:`simulate.study.paths.trial`.
    ``strange``: movements offered to a robot of another body.
    """
    pair = PAIRS[number % len(PAIRS)]
    robot, seed = pair.partition(",")[0], int(settings["seed"])
    is_mirrored = pair.endswith("other arm")
    cell = cell_of(robot)
    taught = _taught(robot, seed, int(settings["before"]), int(settings["things"]))
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
        for name in (_TEACHER, _FOLLOWER):
            _register(engine, name, cell.robot)
        _register(engine, _STRANGER, _stranger(robot))
        sources = _store(kb, engine, cell.robot, taught)
        answered = [
            motion
            for arm in cell.robot.arms.values()
            for motion in _recall(engine, cell, arm, is_mirrored)
        ]
        hand = next(iter(_stranger(robot).arms.values())).end_effector
        asked = {"gripper_id": hand}
        strange = engine.call("recall_motions", asked, Access(_STRANGER, "robot")).as_json()
    offered = [motion for motion in answered if motion["fit"] != "other_body"]
    followed = [
        _followed(cell, motion, sources[motion["object"]], is_mirrored) for motion in offered
    ]
    return {
        "kind": pair, "stored": len(taught), "offered": len(offered),
        "fits": sorted({motion["fit"] for motion in offered}),
        "astray_m": max((astray for astray, _ in followed), default=0.0),
        "free": sum(is_free for _, is_free in followed),
        "strange": len(strange["motions"]),
        "said": sorted({motion["why_not"] for motion in strange["rejected"]}),
        "things": _at_a_fresh_table(cell, offered, settings, number),
    }  # fmt: skip


def _stranger(robot: str) -> RobotDescription:
    return cell_of(_OTHER_BODY[robot]).robot


@lru_cache(maxsize=2)
def _taught(robot: str, seed: int, before: int, count: int) -> Sequence[_Taught]:
    """Return the ways that the first robot plans at tables with boards."""
    cell = cell_of(robot)
    cell.space.memory = None
    taught = []
    for number in range(before):
        table = lay_table(cell, stream(seed, _TAUGHT, number), count, "boards")
        for item in range(len(table.things)):
            ways = ways_of(cell, table, item, mix_seed(seed, BEFORE, number, item))
            if ways is not None:
                taught.append(_Taught(ways[0], (*_others(table, item), table.obstacles[item])))
    return taught


def _others(table: LaidTable, item: int) -> Sequence[Obstacle]:
    return [*table.boards, *(o for k, o in enumerate(table.obstacles) if k != item)]


def _register(engine: Engine, name: str, robot: RobotDescription) -> None:
    hands = [
        {"name": arm.end_effector, "gripper_type": arm.gripper_type, "kind": arm.kind,
         "max_opening": arm.mouth, "max_payload": arm.max_payload}
        for arm in robot.arms.values()
    ]  # fmt: skip
    request = {"name": name, "model": robot.model, "simulated": True, "end_effectors": hands}
    engine.call("register_robot", request, Access(name, "robot"))


def _store(
    kb: rtask.KnowledgeBase, engine: Engine, robot: RobotDescription, taught: Sequence[_Taught]
) -> dict[str, _Taught]:
    """Report each way as an attempt that held; return the ways by the IRIs of their objects."""
    sources = {}
    for number, way in enumerate(taught):
        thing = f"{kb.base}object/{number + 1}"
        kb.update(
            f"{PREFIXES} INSERT DATA {{ <{thing}> a rt:ManipulableObject ; "
            f"rt:objectId 'taught/{number + 1}' }}"
        )
        sources[thing] = way
        motion = _motion(way.plan, robot)
        outcome = {"success": True, "reason": "ok", "preset": "fast", "motion": motion}
        request = {"object": thing, "grasp": _AT_THE_MIDDLE, "outcome": outcome,
                   "gripper_id": robot.arm(way.plan.arm).end_effector}  # fmt: skip
        engine.call("report_outcome", request, Access(_TEACHER, "robot"))
    return sources


def _motion(plan: PlannedGrasp, robot: RobotDescription) -> dict[str, Any]:
    """Return the way to the thing and the closing of the hand as a robot records them."""
    arm, way = robot.arm(plan.arm), join([plan.free, plan.approach])
    times = np.append(np.arange(0.0, way.duration, 1 / _RATE_HZ), way.duration)
    rows = np.array([np.append(way.at(time)[0], _OPEN) for time in times])
    closed = np.append(rows[-1, :-1], _CLOSED)
    flat = np.concatenate([rows.ravel(), closed]).tolist()
    return {
        "joints": [*arm.joints, arm.end_effector], "positions": flat, "commands": flat,
        "times": [*times.tolist(), way.duration + 1 / _RATE_HZ],
    }  # fmt: skip


def _recall(engine: Engine, cell: Cell, arm: Arm, is_mirrored: bool) -> list[dict[str, Any]]:
    """Ask for the movements that an arm can follow: its own kind's, or those of the other arm."""
    chain = cell.space.chains[arm.name]
    joints = following_joints(chain)
    if is_mirrored:
        other = cell.space.chains[_other(cell.robot, arm).name]
        joints = following_joints(chain, other.names, mirror_signs(other, chain))
    request = {"gripper_id": arm.end_effector, "joints": joints, "max_motions": 50,
               "max_samples": 1000}  # fmt: skip
    answer = engine.call("recall_motions", request, Access(_FOLLOWER, "robot"))
    return list(answer.as_json()["motions"])


def _other(robot: RobotDescription, arm: Arm) -> Arm:
    return next(other for other in robot.arms.values() if other.name != arm.name)


def _followed(
    cell: Cell, motion: Mapping[str, Any], source: _Taught, is_mirrored: bool
) -> tuple[float, bool]:
    """Return how far the hand is off, m, at most, and whether the way is free where it was made."""
    arm = next(arm for arm in cell.robot.arms.values() if arm.end_effector in motion["joints"])
    chain = cell.space.chains[arm.name]
    way = way_before_closing(motion, arm.joints, arm.end_effector)
    there = np.array([source.plan.free.at(time)[0] for time in motion["times"][: len(way)]])
    _, here = chain.tool_poses(way)
    _, taught = cell.space.chains[source.plan.arm].tool_poses(there)
    is_free_way = np.array(motion["times"][: len(way)]) <= source.plan.free.duration
    image = taught * _MIRROR if is_mirrored else taught
    astray = np.linalg.norm(here - image, axis=1)[is_free_way]
    around = [_mirrored(obstacle) for obstacle in source.around] if is_mirrored else source.around
    return float(astray.max()), _is_free(cell, arm, source.plan, way[is_free_way], around)


def _is_free(
    cell: Cell, arm: Arm, plan: PlannedGrasp, way: Floats, around: Sequence[Obstacle]
) -> bool:
    """Return whether an arm hits nothing on a way, with the hand open as it was."""
    spheres = cell.space.spheres(arm.name, plan.opening)
    surroundings = cell.space.surroundings(arm.name, plan.request.table_height, around)
    slack = spheres.slack(surroundings, ALLOWED)
    return bool((spheres.clearances(way, surroundings, slack) >= -_TOUCH_M).all())


def _mirrored(obstacle: Obstacle) -> Obstacle:
    """Return an obstacle's image in the plane y = 0."""
    yaw = float(np.arctan2(obstacle.rotation[1, 0], obstacle.rotation[0, 0]))
    size = 2 * obstacle.half
    return Obstacle.box(obstacle.name, (obstacle.centre * _MIRROR).tolist(), size.tolist(), -yaw)


def _at_a_fresh_table(
    cell: Cell, offered: Sequence[Mapping[str, Any]], settings: Mapping[str, Any], number: int
) -> list[dict[str, Any]]:
    """Plan all ways at a table that no robot has seen, anew and with the offered movements."""
    seed = int(settings["seed"])
    table = lay_table(cell, stream(seed, _FRESH, number), int(settings["things"]), "boards")
    rows = []
    for item in range(len(table.things)):
        key, memory = mix_seed(seed, _FRESH, number, item), PathMemory()
        for motion in offered:
            for arm in cell.robot.arms.values():
                path = path_of(motion, arm.joints, arm.end_effector)
                if path is not None:
                    memory.add(cell.space.version(arm.name), path)
        rows.append({
            "anew": plan_item(cell, table, item, key, PathMemory(recalls=False)),
            "recalled": plan_item(cell, table, item, key, memory),
        })  # fmt: skip
    return rows
