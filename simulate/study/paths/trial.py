"""One table: a robot plans all its ways with what it remembers from other tables, and without."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from simulate.grasping.placing import PlacePlan, PlaceSpot, plan_place
from simulate.grasping.planning import GraspPlanner
from simulate.grasping.rules import PlannedGrasp
from simulate.grasping.table_reach import requests_for
from simulate.motion.arm_space import ArmSpace
from simulate.motion.collision import Obstacle
from simulate.motion.remembered import PathMemory, RememberedPath
from simulate.robots import describe
from simulate.robots.description import RobotDescription
from simulate.world.objects import sample_products
from simulate.world.scene import Placement, arrange
from simulate.world.seeds import mix_seed, stream
from simulate.world.world import PlaceBox

__all__ = [
    "BEFORE", "TABLES", "Cell", "LaidTable", "cell_of", "lay_table", "plan_item", "run_trial",
    "ways_of",
]  # fmt: skip

TABLES = ("open", "boards")
"""Things on a table; the same with boards that stand on it, around which the arm has to go."""
_LAY, _PLAN, BEFORE = 81, 82, 83
_BOARDS = 7
_BOARD_M = ((0.010, 0.02), (0.10, 0.25), (0.6, 1.3))
"""Ranges of thickness and length, m, and of the height as a share of that of the hand at home."""
_CLEAR_M = 0.09
"""Between the middle of a thing and a board, for the hand."""
_SIDES = ("left", "right")


@dataclass(frozen=True)
class Cell:
    """A robot that plans at its table; nothing moves."""

    robot: RobotDescription
    boxes: Mapping[str, PlaceBox]
    planner: GraspPlanner

    @property
    def space(self) -> ArmSpace:
        return self.planner.space


@dataclass(frozen=True)
class LaidTable:
    """What stands on a table."""

    things: Sequence[Placement]
    obstacles: Sequence[Obstacle]
    """Of the things, in their order."""
    boards: Sequence[Obstacle]


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return the work for each thing of a fresh table, with memory and without.

    Kinds of tables take turns. What is remembered is from other tables of the same kind.
    """
    kind = TABLES[number % len(TABLES)]
    robot, seed = str(settings["robot"]), int(settings["seed"])
    cell, count = cell_of(robot), int(settings["things"])
    table = lay_table(cell, stream(seed, _LAY, number), count, kind)
    remembered = _paths_of(robot, seed, int(settings["before"]), count, kind)
    rows = []
    for item in range(len(table.things)):
        key = mix_seed(seed, _PLAN, number, item)
        both = {}
        for way, memory in (("anew", PathMemory(recalls=False)), ("recalled", _copy(remembered))):
            both[way] = plan_item(cell, table, item, key, memory)
        rows.append(both)
    stored = sum(len(paths) for paths in remembered.values())
    return {"kind": kind, "things": rows, "remembered": stored, "says": kind}


@lru_cache(maxsize=2)
def cell_of(name: str) -> Cell:
    robot = describe(name)
    place = robot.workplace
    boxes = {side: PlaceBox.at(place, side, place.table_height) for side in _SIDES}
    walls = [Obstacle.box("box", *wall) for box in boxes.values() for wall in box.walls()]
    return Cell(robot, boxes, GraspPlanner(ArmSpace(robot, walls)))


@lru_cache(maxsize=4)
def _paths_of(
    robot: str, seed: int, before: int, count: int, kind: str
) -> Mapping[str, Sequence[RememberedPath]]:
    """Return what the robot remembers after tables that no trial has, by version of its arms."""
    cell, memory = cell_of(robot), PathMemory()
    for number in range(before):
        table = lay_table(cell, stream(seed, BEFORE, TABLES.index(kind), number), count, kind)
        for item in range(len(table.things)):
            plan_item(cell, table, item, mix_seed(seed, BEFORE, number, item), memory)
    return memory.paths


def _copy(paths: Mapping[str, Sequence[RememberedPath]]) -> PathMemory:
    return PathMemory({version: list(known) for version, known in paths.items()})


def lay_table(cell: Cell, rng: np.random.Generator, count: int, kind: str) -> LaidTable:
    place = cell.robot.workplace
    things = arrange(sample_products("light", rng, count), rng, workplace=place)
    obstacles = [_standing(placement, place.table_height) for placement in things]
    boards: list[Obstacle] = []
    while kind == "boards" and len(boards) < _BOARDS:
        board = _board(cell, rng)
        middles = np.array([[p.x, p.y, place.table_height] for p in things])
        if _distances(board, middles).min() > _CLEAR_M:
            boards.append(board)
    return LaidTable(things, obstacles, boards)


def _standing(placement: Placement, floor: float) -> Obstacle:
    extent = placement.spec.extent
    centre = (placement.x, placement.y, floor + extent[2] / 2)
    return Obstacle.box("neighbour", centre, extent, placement.yaw)


def _board(cell: Cell, rng: np.random.Generator) -> Obstacle:
    """Draw a board that stands somewhere on the table."""
    place = cell.robot.workplace
    arm = next(iter(cell.robot.arms.values()))
    _, home = cell.space.chains[arm.name].tool_poses(np.array(arm.home)[None])
    thick, length, share = (float(rng.uniform(*span)) for span in _BOARD_M)
    height = share * max(float(home[0, 2]) - place.table_height, 0.1)
    x = float(rng.uniform(place.area_x[0], place.area_x[1] + 0.1))
    y = float(rng.uniform(-place.area_abs_y[1], place.area_abs_y[1]))
    centre = (x, y, place.table_height + height / 2)
    return Obstacle.box("neighbour", centre, (thick, length, height), float(rng.uniform(0, np.pi)))


def _distances(board: Obstacle, points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return the distances (n,) m of points (n, 3) m from a board, seen from above."""
    local = np.abs((points - board.centre) @ board.rotation)[:, :2]
    return np.asarray(np.linalg.norm(np.maximum(local - board.half[:2], 0.0), axis=1))


def plan_item(
    cell: Cell, table: LaidTable, item: int, seed: int, memory: PathMemory
) -> dict[str, Any]:
    """Plan how a thing gets into the box on its side; return the work and whether there is a way.

    ``checks``, ``of_first`` and ``shortening`` are postures of paths alone, ``work`` those of the
    whole planning, inverse kinematics included; ``way_s`` is how long the arm would be under way.
    """
    cell.space.memory = memory
    before, started = cell.space.work, time.process_time()
    way_s = _way_s(cell, table, item, seed)
    work = memory.work
    return {
        "reached": way_s is not None, "way_s": way_s, "origins": dict(work.origins),
        "checks": work.checks, "of_first": work.of_first, "shortening": work.shortening,
        "work": cell.space.work - before, "cpu_s": time.process_time() - started,
    }  # fmt: skip


def _way_s(cell: Cell, table: LaidTable, item: int, seed: int) -> float | None:
    ways = ways_of(cell, table, item, seed)
    if ways is None:
        return None
    plan, placed = ways
    return plan.free.duration + placed.transport.duration + placed.retreat.duration


def ways_of(
    cell: Cell, table: LaidTable, item: int, seed: int
) -> tuple[PlannedGrasp, PlacePlan] | None:
    """Plan the ways to a thing, into the box on its side and home; None if there are none."""
    placement, place = table.things[item], cell.robot.workplace
    mouth = max(arm.mouth for arm in cell.robot.arms.values())
    pose = (placement.x, placement.y, placement.yaw)
    around = [*table.boards, *(o for k, o in enumerate(table.obstacles) if k != item)]
    for request in requests_for(placement.spec, pose, place.table_height, mouth)[:2]:
        plan = cell.planner.plan(request, around, seed)
        if isinstance(plan, str):
            continue
        side = _SIDES[0] if placement.y > 0 else _SIDES[1]
        spot = PlaceSpot.in_box(cell.boxes[side], 0, max(placement.spec.extent[:2]))
        placed = plan_place(cell.space, plan, plan.lift.positions[-1], spot)
        if not isinstance(placed, str):
            return plan, placed
    return None
