"""A program that is killed while a whole arm carries something, and the next one that goes on."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.arms.bench import Bench
from simulate.tasks.arms.body import ArmBody
from simulate.tasks.arms.introducing import introduce, survey
from simulate.tasks.arms.layouts import own_table
from simulate.tasks.arms.resuming import is_away
from simulate.tasks.executor import Executor
from simulate.world.objects import spec_of
from simulate.world.scene import Placement
from tests.servers import running_server

pytestmark = pytest.mark.slow

GOAL = "every can into the right box"
STEPS_ON_THE_WAY = 60
"""Control steps after the thing is held: the arm is on its way to the box."""
_FORK = multiprocessing.get_context("fork")
_PATIENCE_S = 240.0


def _bench(folder: Path) -> Bench:
    layout = own_table("panda-1", "panda")
    at = layout.area("right half")
    spot = Placement(spec_of("can-81"), sum(at.x) / 2, sum(at.y) / 2, 0.3)
    return Bench(layout, [spot], folder, preset="fast")


def _again(bench: Bench, graph, body: ArmBody) -> ArmBody:
    """Return the body of a program that knows what its configuration says, and no more."""
    [station] = bench.stations.values()
    return ArmBody(station, graph, dict(body._arms), dict(body.places), seed=7)


def test_a_hand_at_home_is_not_closed_to_find_out_what_it_holds(tmp_path):
    bench = _bench(tmp_path)
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            [body] = introduce(planner, bench).bodies.values()
            [(hand, arm)] = body._arms.items()
            before = bench.world.moment
            assert not is_away(body.robot, arm)
            assert not body.sees("https://example.org/anything", hand)
            assert bench.world.moment == before
    finally:
        bench.close()


def _work_and_die(url: str, folder: Path, told: Path) -> None:
    """Pick a thing up and be killed on the way to the box; what is real lives on in a fork."""
    bench = _bench(folder)
    graph = rtask.connect(url)
    crew = introduce(graph, bench)
    survey(graph, bench, crew)
    [(robot, body)] = crew.bodies.items()
    graph.call("store_plan", goal=GOAL)
    assert Executor(graph, body, robot).turn().result == "done"
    walk, left = bench.world.step, [STEPS_ON_THE_WAY]

    def die_on_the_way(seconds: float) -> None:
        left[0] -= 1
        if left[0] > 0:
            walk(seconds)
        elif os.fork():
            os.kill(os.getpid(), signal.SIGKILL)
        else:
            bench.world.step = walk
            _go_on(url, bench, robot, body, told)

    bench.world.step = die_on_the_way
    Executor(graph, body, robot).turn()


def _go_on(url: str, bench: Bench, robot: str, body: ArmBody, told: Path) -> None:
    """Be the program that is started next, and end."""
    with suppress(BaseException):
        graph = rtask.connect(url)
        executor = Executor(graph, _again(bench, graph, body), robot)
        turns = [executor.turn() for _ in range(2)]
        truly = bench.area_of(bench.laid[0].body)
        said = {"turns": [turn.result for turn in turns], "truly": truly}
        part = told.with_suffix(".part")
        part.write_text(json.dumps(said))
        part.rename(told)
    os._exit(0)


@pytest.mark.deep
def test_a_program_killed_while_it_carries_something_is_followed_by_one_that_puts_it_down(tmp_path):
    """The server hears of the pick and of one put; nothing is done or stored twice."""
    told = tmp_path / "told.json"
    with rtask.open(tmp_path / "kb"):
        pass
    with running_server(tmp_path / "kb") as server:
        read, write = os.pipe()  # both programs hold its end: it closes when the second one ends
        first = _FORK.Process(target=_work_and_die, args=(server.url, tmp_path / "assets", told))
        (tmp_path / "assets").mkdir()
        first.start()
        os.close(write)
        first.join(_PATIENCE_S)
        assert first.exitcode == -signal.SIGKILL
        assert os.read(read, 1) == b"", "the second program has ended"
        os.close(read)
        assert json.loads(told.read_text()) == {"turns": ["done", "idle"], "truly": "right box"}
        with rtask.connect(server.url) as graph:
            (plan,) = graph.call("list_plans", state="all")["plans"]
            assert [step["state"] for step in plan["steps"]] == ["done", "done"]
            rows = graph.query(f"""{PREFIXES}
SELECT (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{ ?attempt a rt:GraspAttempt }}""")
            assert int(rows[0]["n"]) == 1


@pytest.mark.deep
def test_a_program_that_lost_what_it_carried_says_so_after_its_restart(tmp_path):
    """The thing has fallen from the hand meanwhile: the hand is felt to be empty, and goes home."""
    bench = _bench(tmp_path)
    try:
        with rtask.open(":memory:") as kb, Engine(kb) as engine:
            planner = rtask.connect(engine)
            crew = introduce(planner, bench)
            [thing] = survey(planner, bench, crew)
            [(robot, body)] = crew.bodies.items()
            planner.call("store_plan", goal=GOAL)
            assert Executor(planner, body, robot).turn().result == "done"
            [(hand, arm)] = body._arms.items()
            x, y, _ = bench.world.object_pose(bench.laid[0].body).position
            bench.put(bench.laid[0].body, float(x), float(np.clip(-y, -0.2, 0.2)))
            again = _again(bench, planner, body)
            turn = Executor(planner, again, robot).turn()
            assert turn.result == "failed"
            assert not is_away(again.robot, arm)
            assert not again.sees(thing, hand)
    finally:
        bench.close()
