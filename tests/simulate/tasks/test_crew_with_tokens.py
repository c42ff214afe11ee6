"""Robots with tokens of their own, each a process: claims, handovers, and one that is killed."""

from __future__ import annotations

import json
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import RemoteUnavailableError, RtaskError
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Executor
from tests.commands import start_command
from tests.rtask.tasks.conftest import BASE, CUP, LAB, LEFT, NAO, PANDA, PEN, RIGHT
from tests.servers import running_server
from tests.simulate.tasks.crew_robot import CrewRobot
from tests.simulate.tasks.site import PATIENCE_S, KillsServer, Site, ended

pytestmark = pytest.mark.slow

GOAL = "every cup into the left box; every pen into the right box"


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    data, folder = tmp_path / "store", tmp_path / "lab"
    folder.mkdir()
    with rtask.open(data, base=BASE) as kb:
        kb.update(LAB)
    with running_server(data) as server:
        made = Site(server, data, folder, (NAO, PANDA))
        with made.person:
            yield made


def test_each_robot_is_a_command_of_its_own(site: Site) -> None:
    """Nobody shares memory or files: each knows by the graph alone what the other has done."""
    site.person.call("store_plan", goal=GOAL)
    words = ("simulate", "tasks", "--server", site.url, "--json", "--robot")
    started = {
        robot: start_command(
            *words, robot.rpartition("/")[2],
            environment={**os.environ, "RTASK_TOKEN": site.tokens[robot]},
        )
        for robot in (NAO, PANDA)
    }  # fmt: skip
    turns = {}
    for robot, process in started.items():
        assert process.stdout is not None
        assert process.stderr is not None
        with process.stdout, process.stderr:
            printed, errors = process.stdout.read(), process.stderr.read()
        assert process.wait(PATIENCE_S) == 0, errors
        turns[robot] = [turn for turn in json.loads(printed)["turns"] if turn["result"] == "done"]
    (plan,) = site.person.call("list_plans", state="all")["plans"]
    assert plan["state"] == "done"
    assert sum(map(len, turns.values())) == len(plan["steps"])
    assert all(turns.values()), "the cup is handed over: each has something to do"


@pytest.mark.parametrize("dies_after", ["put", pytest.param("pick", marks=pytest.mark.deep)])
def test_a_crew_of_which_one_is_killed_does_all_and_nothing_twice(
    site: Site, dies_after: str
) -> None:
    task = site.person.call("store_plan", goal=GOAL)["task"]
    nao, killed = site.start(NAO), site.start(PANDA, dies_after)
    assert ended(killed) == -signal.SIGKILL
    assert nao.is_alive()
    before = site.truth["done"]
    assert before[-1][:2] == [PANDA, dies_after]
    again = site.start(PANDA)
    assert (ended(again), ended(nao)) == (0, 0)

    truth = site.truth
    assert (truth["where"][CUP], truth["where"][PEN]) == (LEFT, RIGHT)
    deeds = Counter((action, item) for _, action, item in truth["done"])
    assert deeds["pick", CUP] == deeds["put", CUP] == 2, "handed over: once by each robot"
    assert {robot for robot, _, item in truth["done"] if item == CUP} == {NAO, PANDA}
    assert deeds["pick", PEN] == deeds["put", PEN] == 1
    (plan,) = [p for p in site.person.call("list_plans", state="all")["plans"] if p["task"] == task]
    assert plan["state"] == "done"
    assert {step["state"] for step in plan["steps"]} == {"done"}
    rows = site.person.query(f"""{PREFIXES}SELECT ?graph (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{
  GRAPH ?graph {{ ?attempt a rt:GraspAttempt }} }} GROUP BY ?graph""")
    stored = {str(row["graph"]).rpartition("/")[2]: int(row["n"]) for row in rows}
    picks = Counter(
        robot.rpartition("/")[2] for robot, action, _ in truth["done"] if action == "pick"
    )
    unseen = {"panda-1": int(dies_after == "pick")}  # its program ended before it could report
    assert stored == {name: n - unseen.get(name, 0) for name, n in picks.items() if n}


def work(robot: Executor) -> None:
    while robot.turn().result != "idle":
        pass


@pytest.mark.parametrize("action", ["pick", pytest.param("put", marks=pytest.mark.deep)])
def test_what_a_robot_did_while_its_server_was_killed_is_said_to_the_next_one(
    tmp_path: Path, action: str
) -> None:
    data, folder = tmp_path / "store", tmp_path / "lab"
    folder.mkdir()
    with rtask.open(data, base=BASE) as kb:
        kb.update(LAB)
    with running_server(data) as server:
        site = Site(server, data, folder, (NAO, PANDA))
        with site.person, rtask.connect(server.url, token=site.tokens[PANDA]) as graph:
            site.person.call("store_plan", goal="every pen into the right box")
            body = CrewRobot(folder, PANDA, site.reach, site.hands)
            robot = Executor(graph, KillsServer(body, server, action))
            with pytest.raises(RemoteUnavailableError):
                work(robot)
    with running_server(data) as again, rtask.connect(again.url, token=site.tokens[PANDA]) as graph:
        robot.graph, robot.body = graph, body
        work(robot)
        (plan,) = graph.call("list_plans", state="all")["plans"]
        assert {step["state"] for step in plan["steps"]} == {"done"}
        deeds = [(deed, item) for _, deed, item in site.truth["done"]]
        assert deeds == [("pick", PEN), ("put", PEN)]
        rows = graph.query(f"""{PREFIXES}
SELECT (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{ ?attempt a rt:GraspAttempt }}""")
        assert int(rows[0]["n"]) == 1


def test_a_robots_token_claims_and_ends_steps_of_that_robot_alone(site: Site) -> None:
    site.person.call("store_plan", goal="every pen into the right box")
    nao = rtask.connect(site.url, token=site.tokens[NAO])
    panda = rtask.connect(site.url, token=site.tokens[PANDA])
    with nao, panda:
        assert not nao.call("claim_step")["claimed"]
        step = panda.call("claim_step")
        assert step["claimed"]
        for call in (
            {"operation": "claim_step"},
            {"operation": "end_step", "task": step["task"], "result": "done"},
        ):
            with pytest.raises(RtaskError, match="cannot act for 'panda-1'") as refused:
                nao.call(call.pop("operation"), robot="panda-1", **call)
            assert refused.value.answer_status == 403


def test_a_robot_goes_on_when_its_step_was_ended_behind_its_back(site: Site) -> None:
    site.person.call("store_plan", goal="every pen into the right box")
    with (
        rtask.connect(site.url, token=site.tokens[PANDA]) as panda,
        rtask.connect(site.url, token=site.tokens[PANDA]) as twin,
    ):
        body = CrewRobot(site.folder, PANDA, site.reach, site.hands)

        def end_it(text: str) -> bool:
            (plan,) = twin.call("list_plans", state="open")["plans"]
            (step,) = (step for step in plan["steps"] if step["state"] == "claimed")
            twin.call("end_step", task=step["task"], result="failed", comment="by the other one")
            return True

        assert Executor(panda, body, may=end_it).turn().result == "lost"
        assert Executor(panda, body).turn().result == "idle"
