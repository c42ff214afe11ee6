"""A server or a robot that is killed at any call of a plan: nothing is done twice, all is done."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.errors import RemoteUnavailableError
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Executor
from tests.rtask.tasks.conftest import BASE, CUP, LAB, LEFT, NAO, PANDA, PEN, RIGHT
from tests.servers import running_server
from tests.simulate.tasks.crew_robot import IDLE_S, CrewRobot
from tests.simulate.tasks.test_crew_with_tokens import GOAL, Site

# Two instants of each are in test_crew_with_tokens, for every run.
pytestmark = [pytest.mark.slow, pytest.mark.deep]

_FORK = multiprocessing.get_context("fork")
_FLIGHT_S = 0.006
"""After which a request is under way, and may be in a commit."""
_MAX_TURNS = 3000


class Struck:
    """A client of which one call, counted from 0, meets a blow: just before it, or during it."""

    def __init__(self, graph: Any, at: int, when: str, strike: Callable[[], object]) -> None:
        self._graph, self._at, self._when, self._strike = graph, at, when, strike
        self.number = 0

    def call(self, operation: str, timeout_s: float | None = None, /, **fields: Any) -> Any:
        self._meet()
        return self._graph.call(operation, timeout_s, **fields)

    def query(self, sparql: str) -> list[dict[str, Any]]:
        self._meet()
        return self._graph.query(sparql)

    def _meet(self) -> None:
        number, self.number = self.number, self.number + 1
        if number == self._at and self._when == "before":
            self._strike()
        elif number == self._at:
            threading.Timer(_FLIGHT_S, self._strike).start()


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A store with the lab, and beside it a folder for the truth of the lab."""
    folder = tmp_path / "lab"
    folder.mkdir()
    with rtask.open(tmp_path / "store", base=BASE) as kb:
        kb.update(LAB)
    return tmp_path


@pytest.mark.parametrize("when", ["before", "during"])
@pytest.mark.parametrize("at", range(0, 16, 3))
def test_a_server_that_is_killed_at_any_call_goes_on_where_it_was(
    data: Path, when: str, at: int
) -> None:
    robots: dict[str, Executor] = {}
    site: Site | None = None
    blows: list[str] = []
    for _ in range(3):
        with ExitStack() as stack:
            server = stack.enter_context(running_server(data / "store"))
            if site is None:
                site = Site(server, data / "store", data / "lab", (NAO, PANDA))
                stack.enter_context(site.person).call("store_plan", goal=GOAL)

            def strike(server: Any = server) -> None:
                blows.append(when)
                server.stop(signal.SIGKILL)

            for name in (PANDA, NAO):
                client = rtask.connect(server.url, token=site.tokens[name])
                graph: Any = stack.enter_context(client)
                if name == PANDA and not blows:
                    graph = Struck(graph, at, when, strike)
                if name in robots:
                    robots[name].graph = graph
                else:
                    body = CrewRobot(data / "lab", name, site.reach, site.hands)
                    robots[name] = Executor(graph, body)
            person = stack.enter_context(rtask.connect(server.url, token=site.admin))
            try:
                _take_turns(robots, person)
            except RemoteUnavailableError:
                continue
            _require_done_once(site, person)
            return
    pytest.fail("the robots did not come to an end")


def _take_turns(robots: dict[str, Executor], person: Any) -> None:
    for _ in range(_MAX_TURNS):
        results = [robot.turn().result for robot in robots.values()]
        if set(results) == {"idle"} and not person.call("list_plans", state="open")["plans"]:
            return
    pytest.fail("the plan does not end")


@pytest.mark.parametrize("when", ["before", "during"])
@pytest.mark.parametrize("at", range(16))
def test_a_robot_that_is_killed_at_any_call_goes_on_where_it_was(
    data: Path, when: str, at: int
) -> None:
    with running_server(data / "store") as server:
        site = Site(server, data / "store", data / "lab", (NAO, PANDA))
        with site.person as person:
            person.call("store_plan", goal=GOAL)
            nao, first = _started(site, NAO), _started(site, PANDA, at, when)
            first.join(240.0)
            again = _started(site, PANDA)
            for process in (again, nao):
                process.join(240.0)
                assert process.exitcode == 0
            assert first.exitcode in (-signal.SIGKILL, 0)
            _require_done_once(site, person, may_be_unseen=True)


def _started(site: Site, robot: str, at: int = -1, when: str = "") -> Any:
    body = CrewRobot(site.folder, robot, site.reach, site.hands)
    process = _FORK.Process(target=_run, args=(site.url, site.tokens[robot], body, at, when))
    process.start()
    return process


def _run(url: str, token: str, body: CrewRobot, at: int, when: str) -> None:
    with rtask.connect(url, token=token) as client:
        graph = Struck(client, at, when, lambda: os.kill(os.getpid(), signal.SIGKILL))
        robot = Executor(graph, body)
        while robot.turn().result != "idle" or graph.call("list_plans", state="open")["plans"]:
            time.sleep(IDLE_S)


def _require_done_once(site: Site, person: Any, *, may_be_unseen: bool = False) -> None:
    """Fail unless all is where it is to be, done and stored once, and no claim is left."""
    truth = site.truth
    assert (truth["where"][CUP], truth["where"][PEN]) == (LEFT, RIGHT)
    deeds = Counter((action, item) for _, action, item in truth["done"])
    assert deeds == {("pick", CUP): 2, ("put", CUP): 2, ("pick", PEN): 1, ("put", PEN): 1}
    (plan,) = person.call("list_plans", state="all")["plans"]
    assert plan["state"] == "done"
    assert {step["state"] for step in plan["steps"]} == {"done"}
    rows = person.query(
        f"{PREFIXES}SELECT (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{ ?attempt a rt:GraspAttempt }}"
    )
    assert 3 - may_be_unseen <= int(rows[0]["n"]) <= 3
