"""One pile or one cluttered table: laid out, picked from by the arm, judged by the truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

import rtask
from features.geometry import FloatArray
from features.perception import Seen
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.scoring.holding import assumed_mass
from rtask.engine.perception.clutter import plan_in_view
from rtask.scratch import ScratchFolder
from simulate.agent.agent import Agent, AgentConfig, Server
from simulate.agent.encounter import Encounter
from simulate.agent.simulated_body import RobotAtTable
from simulate.grasping.clearing import clear_clutter
from simulate.grasping.clutter import hand_of, look_at_clutter, pick_from
from simulate.grasping.executor import Workcell
from simulate.grasping.floating.execution import spawn_parts
from simulate.robots import RobotDescription, describe
from simulate.study.clutter.picture import draw_grasps
from simulate.study.quality.objects import GraspObject, fits, generated
from simulate.world.camera import Lighting
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise
from simulate.world.objects import Friction, ObjectSpec, sample_products
from simulate.world.piles import close_gaps, drop, touching_pairs
from simulate.world.scene import arrange, lay
from simulate.world.seeds import mix_seed, stream

__all__ = ["ARM", "Table", "clear_trial", "laid_table", "pile_trial"]

ARM = "panda_arm"
"""Of the Panda, which alone picks by rules; the NAO's arms take no full poses."""

_OBJECTS, _PLACE, _LIGHT, _NOISE, _CHOICE, _COLOUR = range(60, 66)
_PANDA = "panda"
_MIDDLE, _HALF_M, _OF = (0.46, 0.0), 0.07, 6
_NUMBERS = 100_000
_FRICTION = (0.35, 0.8)
_HEAVIEST_KG = 0.5
_LIFTED_M, _IN_BOX_M = 0.02, 0.03
_MOVES_EACH = 3


@dataclass(eq=False)
class Table:
    """A robot at a table with things on it.

    Parameters
    ----------
    cell
        World, robot, executor.
    contents
        By body.
    touching
        Pairs of things that touch.
    lifted
        Bodies that the hand held at the end of the latest pick's hold, with their heights before.
    """

    cell: Workcell
    contents: Mapping[int, GraspObject | ObjectSpec]
    touching: int
    lifted: set[int] = field(default_factory=set)
    _before: dict[int, float] = field(default_factory=dict)

    def watch(self, phase: str, arm: str = ARM) -> None:
        """Note at the ends of a pick's phases what an arm has lifted."""
        world = self.cell.world
        if phase == "pregrasp":
            self.lifted = set()
            self._before = {body: world.object_pose(body).z for body in self.contents}
        if phase == "hold":
            fewest = 2 if self.cell.robot.arm(arm).cup is None else 1
            self.lifted = {
                body
                for body, before in self._before.items()
                if world.object_pose(body).z - before > _LIFTED_M
                and self.cell.robot.touch(arm, body).links >= fewest
            }

    def empty_boxes(self) -> int:
        """Take everything out of the boxes and the world; return how many things it was."""
        world, gone = self.cell.world, []
        for body in self.contents:
            pose = world.object_pose(body)
            for box in world.place_boxes.values():
                (x0, x1), (y0, y1) = box.x_range, box.y_range
                inside = x0 - _IN_BOX_M < pose.x < x1 + _IN_BOX_M
                if inside and y0 - _IN_BOX_M < pose.y < y1 + _IN_BOX_M:
                    gone.append(body)
                    break
        for body in gone:
            world.remove(body)
        self.contents = {b: item for b, item in self.contents.items() if b not in gone}
        return len(gone)


@contextmanager
def laid_table(settings: Mapping[str, Any], number: int) -> Iterator[Table]:
    """Lay out the things of one trial in front of the robot."""
    seed = int(settings["seed"])
    with (
        ScratchFolder("pile") as folder,
        Workcell(_robot(settings), str(settings["preset"])) as cell,
    ):
        cell.executor.eyes = Eyes(
            cell.robot, Lighting.sample(stream(seed, _LIGHT, number)), SensorNoise(),
            (seed, _NOISE, number),
        )  # fmt: skip
        lay_out = _groups if settings.get("robot") else _heap
        contents = lay_out(cell, settings, number, folder)
        yield Table(cell, contents, touching_pairs(cell.world, list(contents)))


def _robot(settings: Mapping[str, Any]) -> RobotDescription:
    hand = settings.get("hand")
    return describe(str(settings.get("robot", _PANDA)), **({"hand": str(hand)} if hand else {}))


def _heap(
    cell: Workcell, settings: Mapping[str, Any], number: int, folder: Path
) -> dict[int, GraspObject]:
    """Drop generated things before a Panda and push them together; return them by body.

    They are things for jaws whatever the arm carries, so that all hands meet the same piles.
    """
    seed, count = int(settings["seed"]), int(settings["objects"])
    hand = hand_of(describe(_PANDA), ARM)
    assert isinstance(hand, ParallelGripper)
    rng, shade = stream(seed, _PLACE, number), stream(seed, _COLOUR, number)
    contents = {}
    for k, item in enumerate(_graspable_objects(seed, number, count, hand)):
        place = folder / str(k)
        place.mkdir()
        friction = Friction(lateral=float(rng.uniform(*_FRICTION)), rolling=0.0004)
        colour = (*shade.uniform(0.2, 0.9, 3).tolist(), 1.0)
        body = spawn_parts(
            cell.world, item.write(place), item.mass, friction=friction,
            seen=(item.write_whole(place), colour),
        )  # fmt: skip
        contents[body] = item
    drop(cell.world, list(contents), rng, _MIDDLE, _HALF_M * float(np.sqrt(count / _OF)))
    return contents


def _groups(
    cell: Workcell, settings: Mapping[str, Any], number: int, folder: Path
) -> dict[int, ObjectSpec]:
    """Stand plain products before each hand of another robot so that they touch, by body."""
    seed, count = int(settings["seed"]), int(settings["objects"])
    rng, place = stream(seed, _PLACE, number), cell.robot.description.workplace
    products = sample_products("plain", stream(seed, _OBJECTS, number), count)
    laid = lay(cell.world, arrange(products, rng, workplace=place), folder)
    x, y = (sum(area) / 2 for area in (place.area_x, place.area_abs_y))
    for side in (-1, 1):
        group = [one.body for one in laid if one.placement.y * side > 0]
        close_gaps(cell.world, group, (x, side * y))
    return {one.body: one.placement.spec for one in laid}


def _graspable_objects(
    seed: int, number: int, count: int, hand: ParallelGripper
) -> list[GraspObject]:
    """Return generated objects that the hand may hold, as heavy as wood, at most 500 g."""
    rng, drawn = stream(seed, _OBJECTS, number), list[GraspObject]()
    while len(drawn) < count:
        item = generated(seed, int(rng.integers(_NUMBERS)), hand)
        item = replace(item, mass=min(assumed_mass(item.mesh()), _HEAVIEST_KG))
        if fits(item, hand):
            drawn.append(item)
    return drawn


def pile_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Pick once from a pile; return what happened as JSON data."""
    choice = mix_seed(int(settings["seed"]), _CHOICE, number)
    with laid_table(settings, number) as table:
        result: dict[str, Any] = {"objects": len(table.contents), "touching": table.touching}
        cell = table.cell
        view = look_at_clutter(cell.executor)
        hand = hand_of(cell.robot.description, ARM)
        proposals = None if view is None else plan_in_view(view, hand)
        pick = None
        if view is not None and proposals is not None:
            result |= {"segments": len(view.segments), "candidates": len(proposals)}
            pick, refused = pick_from(view, proposals, cell.executor, ARM, choice)
            result["refused"] = list(refused)
            if settings.get("pictures") and isinstance(hand, ParallelGripper):
                frame, base_from_camera = cell.executor.eyes.look("ahead")
                chosen = None if pick is None else pick.candidate
                path = Path(str(settings["pictures"])) / f"pile-{number:03d}.png"
                draw_grasps(path, frame, base_from_camera, proposals.candidates, hand, chosen)
        if pick is None:
            reason = "no_table" if proposals is None else proposals.reason or "out_of_reach"
            return {**result, "reason": reason, "lifted": False, "placed": False, "moved": 0,
                    "says": reason}  # fmt: skip
        before = {body: cell.world.object_pose(body).position for body in table.contents}
        run = cell.executor.begin(pick.plan, table.watch)
        reason = run.grasp()
        lifted = set(table.lifted)
        if reason == "ok":
            run.place_in_box()
        moved = sum(
            float(np.linalg.norm(cell.world.object_pose(body).position - place)) > 0.01
            for body, place in before.items()
            if body not in lifted
        )
        placed = table.empty_boxes() > 0
    candidate = pick.candidate
    return {
        **result, "reason": reason, "lifted": bool(lifted), "several": len(lifted) > 1,
        "placed": placed, "moved": moved, "rank": pick.rank, "kind": candidate.antipodal,
        "tilt_deg": round(float(np.degrees(pick.plan.tilt)), 1),
        "scores": {k: round(float(v), 4) for k, v in candidate.scores.items()},
        "says": f"{reason}, {'lifted' if lifted else 'not lifted'}",
    }  # fmt: skip


def clear_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Clear one cluttered table, by the robot's agent if asked; return what happened as JSON."""
    choice = mix_seed(int(settings["seed"]), _CHOICE, number)
    with laid_table(settings, number) as table:
        count = len(table.contents)
        result: dict[str, Any] = {"objects": count, "touching": table.touching}
        run = _by_agent if settings.get("agent") else _by_rules
        moves, cleared, ends = run(table, choice, count, bool(settings.get("pushes", True)))
        left = [item.name for item in table.contents.values()]
        why_left = [ends.get(body, "not_met") for body in table.contents]
        off = sum(
            table.cell.world.object_pose(body).z < table.cell.world.table_height - 0.05
            for body in table.contents
        )
    picks = sum(move["kind"] == "pick" for move in moves)
    pushes = sum(move["kind"] == "push" for move in moves)
    return {
        **result, "cleared": cleared, "left": left, "why_left": why_left, "off_table": off,
        "moves": moves,
        "picks": picks, "pushes": pushes,
        "says": f"{cleared} of {count} cleared, {picks} picks, {pushes} pushes",
    }  # fmt: skip


def _by_rules(
    table: Table, choice: int, count: int, pushes: bool
) -> tuple[list[dict[str, Any]], int, dict[int, str]]:
    """Clear the table by looking, picking and pushing.

    Returns
    -------
    list, int, dict
        The moves, how many things are cleared, and how the last attempt at each body ended, as far
        as that is known.
    """
    moves, cleared = [], 0
    for move in clear_clutter(
        table.cell.executor, ARM, choice, _MOVES_EACH * count, on_phase=table.watch, pushes=pushes
    ):
        lifted = bool(table.lifted) if move.kind == "pick" else False
        cleared += table.empty_boxes()
        moves.append({
            "kind": move.kind, "reason": move.reason, "lifted": lifted,
            "placed": move.placed, "segments": move.segments,
        })  # fmt: skip
        if not table.contents:
            break
    return moves, cleared, {}


class _NeverPushes(RobotAtTable):
    """The robot with no way to push anything, for comparison."""

    def push(
        self, points: FloatArray, others: Sequence[FloatArray], height: float, side: str, seed: int
    ) -> str:
        """Find no way."""
        return ""


def _by_agent(
    table: Table, choice: int, count: int, pushes: bool
) -> tuple[list[dict[str, Any]], int, dict[int, str]]:
    """Let the robot's agent clear the table with an empty graph; return the same."""
    body = (RobotAtTable if pushes else _NeverPushes)(table.cell.executor)
    body.watch = lambda plan: partial(table.watch, arm=plan.arm)
    moves: list[dict[str, Any]] = []
    cleared = 0
    first_sight: dict[int, int] = {}
    ends: dict[int, str] = {}

    def on_sight(encounter: Encounter, seen: Seen) -> None:
        bodies, counts = np.unique(body.eyes.labels[seen.mask], return_counts=True)
        first_sight[encounter.number] = int(bodies[np.argmax(counts)])

    def on_event(name: str, data: dict[str, Any]) -> None:
        nonlocal cleared
        if name == "push":
            moves.append({
                "kind": "push", "reason": data["reason"], "lifted": False, "object": data["object"],
            })  # fmt: skip
        if name != "attempt":
            return
        cleared += table.empty_boxes()
        how = data["place_reason"] if data["reason"] == "ok" else data["reason"]
        ends[first_sight.get(data["object"], -1)] = how
        moves.append({
            "kind": "pick" if data["physical"] else "none", "reason": data["reason"],
            "lifted": bool(table.lifted) and data["physical"], "placed": data["placed"],
            "source": data["source"], "object": data["object"], "evidence": data["evidence"],
        })  # fmt: skip

    config = AgentConfig(max_looks=_MOVES_EACH * count, seed=choice)
    with rtask.open(":memory:", reason=False) as kb, rtask.connect(kb, agent="robot") as client:
        client.call("register_robot", **body.robot.describe("robot"))
        Agent(body, cast(Server, client), config, on_event, on_sight).clear_table()
    return moves, cleared, ends
