"""Whether recorded attempts suffice to learn from: a cloned policy reaches and closes.

    python tests/benchmarks/learning/bench_cloning.py [--episodes 50] [--tables 40]

An arm clears tables with one box each. Its attempts that held are exported as a data set of LeRobot
and read back by pyarrow. A small policy learns joints, hand and the pose of the object -> commands,
until the hand has closed, and then drives the arm at fresh tables, with the pose that the robot
estimates there. A fixed lift follows; the box counts as held if it rose. At the same tables: the
recorded episode whose object lay most alike, the mean of all, and the policy taught with commands
of the row before, which is how data sets were written until actions led by a row.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

import rtask
from features.perception import Seen
from rtask.engine import Engine
from rtask.interop.episodes.episode import episodes_of
from rtask.interop.episodes.lerobot import write_lerobot
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from rtask.scratch import ScratchFolder
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.encounter import Encounter
from simulate.agent.messages import observation_message
from simulate.agent.second_look import look_at_side
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.agent.tracking import Tracker
from simulate.grasping.attempt.driving import ArmDrive
from simulate.motion.kinematics import follow_line
from simulate.motion.trajectory import time_path
from simulate.robots import describe
from simulate.world.objects import spec_of
from simulate.world.scene import Placement
from tests.benchmarks.learning.cloning import (
    Controller,
    Demonstration,
    Floats,
    mean_of,
    nearest_of,
    read_set,
    train,
)

_ROBOT, _PRODUCT, _NAME, _SIDE = "panda", "box-3", "panda-1", "right"
_SCALE = 1.7
"""Of the product: a box that leaves a hand which opens by 8 cm little room to be beside it."""
_RATE_HZ, _TICKS = 20, 5
_MOST_ROWS, _CLOSING_ROWS, _TURN_RAD = 160, 16, 0.6
_LIFT_M, _RISEN_M = 0.08, 0.02
_HELD = "SELECT ?attempt { ?attempt rt:hasOutcome/rt:success true }"
_POSE = f"""{PREFIXES}
SELECT ?x ?y ?z ?qx ?qy ?qz ?qw {{ ?estimate rt:poseOf <THING> ; rt:estimatedPose ?pose .
  ?pose rt:atTime ?time ; rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ;
    rt:qw ?qw }} ORDER BY DESC(?time) LIMIT 1"""


class Graph:
    """The graph as an agent calls it, in this process."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def __getattr__(self, operation: str) -> Callable[..., Any]:
        access = Access(_NAME, "robot")
        return lambda **asked: self._engine.call(operation, asked, access).as_json()


def _table(rng: np.random.Generator, folder: Path, noise: tuple[int, ...]) -> SimulatedBody:
    place = describe(_ROBOT).workplace
    where = rng.uniform(*place.area_x), -rng.uniform(*place.area_abs_y)
    placed = Placement(spec_of(_PRODUCT).scaled(_SCALE), *where, rng.uniform(-_TURN_RAD, _TURN_RAD))
    conditions = Conditions(_ROBOT, "fast", noise_seed=noise, pictures=folder / "pictures")
    return SimulatedBody([placed], folder, conditions)


def _name(encounter: Encounter, seen: Seen) -> None:
    encounter.name = _PRODUCT


def record(kb: rtask.KnowledgeBase, engine: Engine, folder: Path, count: int) -> Path:
    """Let the robot clear tables until so many attempts held; return their data set."""
    rng, graph = np.random.default_rng(1), Graph(engine)
    number = held = 0
    while held < count:
        body = _table(rng, folder, (1, number))
        if not number:
            graph.register_robot(**body.robot.describe(_NAME))
        agent = Agent(body, graph, AgentConfig(max_attempts=1, seed=number), on_sight=_name)
        met = agent.clear_table()
        body.close()
        number, held = number + 1, held + sum(one.held for one in met)
    write_lerobot(kb, episodes_of(kb, query=_HELD), folder / "set", _RATE_HZ)
    print(f"{held} of {number} attempts held, and were recorded", flush=True)
    return folder / "set"


def _met(
    kb: rtask.KnowledgeBase, graph: Graph, body: SimulatedBody, thing: str
) -> tuple[str, Floats]:
    """Return what stands on the table, as the robot stores it: the single thing and its pose."""
    _, base_from_camera, view = look_at_side(body, Tracker(), None, _SIDE)
    observed = observation_message(view.objects[0], view, base_from_camera, body.base_frame)
    hand = {"gripper_id": body.gripper_ids[_SIDE], "object": thing}
    (stored,) = graph.insert_object(objects=[{**observed, **hand}])["objects"]
    (row,) = kb.select(_POSE.replace("THING", thing)).to_dicts()
    pose = [float(str(row[name])) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    return str(stored["thing"]), np.array(pose)


def drive(body: SimulatedBody, command: Controller) -> bool:
    """Let a controller reach and close, lift, and return whether the object rose."""
    robot, world = body.robot, body.world
    arm = robot.arm(_SIDE).name
    motion = ArmDrive(world, robot, arm, lambda phase: None)
    motion.start_at_home()
    motion.open(1.0)
    target, closed = robot.arm_joints(arm), 0
    for row in range(_MOST_ROWS):
        measured = np.append(robot.arm_joints(arm), robot.finger_opening(arm))
        wanted = command(row, measured)
        opening = float(np.clip(wanted[-1], 0.0, 1.0))
        hand = robot.arm(arm)
        effort = hand.close_effort if opening < measured[-1] else hand.open_effort
        robot.move_fingers(arm, opening, effort)
        step = (wanted[:-1] - target) / _TICKS
        for _ in range(_TICKS):
            target = target + step
            robot.command_arm(arm, target, step * _RATE_HZ * _TICKS)
            world.step(1 / _RATE_HZ / _TICKS)
        closed = closed + 1 if opening < 0.5 else 0
        if closed >= _CLOSING_ROWS:
            break
    before = _height(body)
    chain = robot.chains[arm]
    line = follow_line(chain, robot.arm_joints(arm), np.array([0.0, 0.0, _LIFT_M]))
    if line is not None:
        motion.follow(time_path(line, 0.3 * chain.velocity))
    return line is not None and _height(body) - before > _RISEN_M


def _height(body: SimulatedBody) -> float:
    position, _ = body.world.client.getBasePositionAndOrientation(body.laid[0].body)
    return float(position[2])


def _one_row_late(shown: list[Demonstration]) -> list[Demonstration]:
    """Return the episodes with the commands that had led to each row."""
    late = [np.vstack([one.states[:1], one.actions[:-1]]) for one in shown]
    return [
        Demonstration(one.states, actions, one.pose)
        for one, actions in zip(shown, late, strict=True)
    ]


def compare(
    kb: rtask.KnowledgeBase, engine: Engine, shown: list[Demonstration], folder: Path, tables: int
) -> dict[str, list[bool]]:
    """Return for each way whether it held the box, table by table."""
    first = episodes_of(kb)[0]
    (grasp,) = kb.select(f"{PREFIXES} SELECT ?g {{ <{first.attempt}> rt:executesGrasp ?g }}")
    told = {"object": first.thing, "grasp": grasp.value("g")}
    learnt, late, mean = train(shown, 1), train(_one_row_late(shown), 1), mean_of(shown)
    ways: dict[str, Callable[[Floats], Controller]] = {
        "the cloned policy": learnt,
        "the nearest episode": partial(nearest_of, shown),
        "the mean episode": lambda pose: mean,
        "cloned, commands a row late": late,
    }
    held: dict[str, list[bool]] = {way: [] for way in ways}
    graph = Graph(engine)
    for number in range(tables):
        for way, controller in ways.items():
            # The same table and the same noise for each of them.
            rng = np.random.default_rng([2, number])
            body = _table(rng, folder, (2, number))
            met, pose = _met(kb, graph, body, str(first.thing))
            is_held = drive(body, controller(pose))
            held[way].append(is_held)
            # As after any attempt: what is reported ends the estimate of where the box stands.
            reason = "ok" if is_held else "missed"
            report = {**told, "thing": met, "success": is_held, "reason": reason}
            graph.report_outcome(gripper_id=body.gripper_ids[_SIDE], **report)
            body.close()
        print(number, {way: sum(each) for way, each in held.items()}, flush=True)
    return held


def main() -> None:
    """Record, read back, learn, and print what each way held, with intervals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--tables", type=int, default=40)
    options = parser.parse_args()
    started = time.process_time()
    with (
        ScratchFolder("cloning") as folder,
        rtask.open(folder / "store") as kb,
        Engine(kb) as engine,
    ):
        data = record(kb, engine, folder, options.episodes)
        shown = read_set(data, _CLOSING_ROWS)
        held = compare(kb, engine, shown, folder, options.tables)
    for way, each in held.items():
        share = binomtest(sum(each), len(each)).proportion_ci(method="wilson")
        print(f"{way}: {sum(each)} of {len(each)} [{share.low:.2f}, {share.high:.2f}]")
    print(f"{time.process_time() - started:.0f} s of CPU")


if __name__ == "__main__":
    main()
