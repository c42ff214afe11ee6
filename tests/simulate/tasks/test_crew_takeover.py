"""Robots, each a process with a token, take over what one that is slow or killed has not begun."""

from __future__ import annotations

import json
import multiprocessing
import signal
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import RemoteUnavailableError
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Executor
from tests.rtask.tasks.conftest import BASE, LEFT, NAO, PANDA
from tests.rtask.tasks.queue.idle_lab import GOAL, OTHER, idle_lab, reach_of, thing
from tests.servers import running_server
from tests.simulate.tasks.crew_robot import CrewRobot
from tests.simulate.tasks.site import PATIENCE_S, KillsServer, Site, ended

pytestmark = pytest.mark.slow

_ROBOTS = (NAO, OTHER, PANDA)
_FORK = multiprocessing.get_context("fork")
_OVERLAPS = f"""{PREFIXES} SELECT ?a ?b WHERE {{
  ?a rt:claimsExemplar ?thing ; prov:startedAtTime ?begun ; prov:endedAtTime ?ended .
  ?b rt:claimsExemplar ?thing ; prov:startedAtTime ?other
  FILTER(?a != ?b && ?begun <= ?other && ?other < ?ended) }}"""


def prepared(folder: Path, cups: int) -> Path:
    """Return a store of a lab in which the Panda gets all of a plan."""
    (folder / "lab").mkdir()
    with rtask.open(folder / "store", base=BASE) as kb:
        kb.update(idle_lab(cups))
        kb.tasks.store(kb.tasks.plan(GOAL))
        kb.update(reach_of(NAO, OTHER))
    return folder / "store"


@pytest.fixture
def site(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Site]:
    data = prepared(tmp_path, getattr(request, "param", 4))
    with running_server(data) as server:
        made = Site(server, data, tmp_path / "lab", _ROBOTS)
        with made.person:
            yield made


def count_done(site: Site) -> int:
    """Return how many steps ended as done, as the graph has it."""
    (plan,) = site.person.call("list_plans", state="all")["plans"]
    picked = 1  # by the robot that was killed before it could say so
    return picked + sum(step["state"] == "done" for step in plan["steps"])


def test_the_rest_of_a_robot_that_is_killed_with_a_claim_is_done_by_others_and_nothing_twice(
    site: Site,
) -> None:
    killed = site.start(PANDA, "pick")
    assert ended(killed) == -signal.SIGKILL
    [[_, _, held]] = site.truth["done"]
    naos = [site.start(robot) for robot in (NAO, OTHER)]
    until = time.monotonic() + PATIENCE_S
    while count_done(site) < 7 and time.monotonic() < until:
        time.sleep(0.05)
    assert count_done(site) == 7
    assert all(nao.is_alive() for nao in naos), "one thing is in a hand, and waits for its robot"

    again = site.start(PANDA)
    assert [ended(process) for process in (again, *naos)] == [0, 0, 0]
    truth = site.truth
    assert set(truth["where"].values()) == {LEFT}
    deeds = Counter((action, item) for _, action, item in truth["done"])
    assert deeds == {(act, thing(n)): 1 for act in ("pick", "put") for n in range(4)}
    who = {item: robot for robot, action, item in truth["done"] if action == "put"}
    assert [item for item, robot in who.items() if robot == PANDA] == [held]
    (plan,) = site.person.call("list_plans", state="all")["plans"]
    assert plan["state"] == "done"
    assert all(step["taken_from"] == [PANDA] for step in plan["steps"] if step["robots"] != [PANDA])
    assert site.person.query(_OVERLAPS) == []


@pytest.mark.deep
def test_what_was_taken_over_before_the_server_was_killed_is_done_once(tmp_path: Path) -> None:
    data = prepared(tmp_path, 2)
    with running_server(data) as server:
        site = Site(server, data, tmp_path / "lab", _ROBOTS)
        with site.person, rtask.connect(server.url, token=site.tokens[NAO]) as graph:
            with rtask.connect(server.url, token=site.tokens[PANDA]) as panda:
                assert panda.call("claim_step")["claimed"]
            body = CrewRobot(tmp_path / "lab", NAO, site.reach, site.hands)
            robot = Executor(graph, KillsServer(body, server, "pick"))
            with pytest.raises(RemoteUnavailableError):
                robot.turn()
    with (
        running_server(data) as again,
        rtask.connect(again.url, token=site.tokens[NAO]) as graph,
        rtask.connect(again.url, token=site.tokens[PANDA]) as theirs,
    ):
        other = Executor(theirs, CrewRobot(tmp_path / "lab", PANDA, site.reach, site.hands))
        turn = other.turn()
        assert any("nao-1 has it: taken over from panda-1" in text for text in turn.taken)
        assert (turn.result, other.turn().taken) == ("done", ()), "told once"
        assert other.turn().result == "idle"
        robot.graph, robot.body = graph, body
        assert [robot.turn().result for _ in range(3)] == ["done", "done", "idle"]
        deeds = Counter((action, item) for _, action, item in site.truth["done"])
        assert deeds == {(act, thing(n)): 1 for act in ("pick", "put") for n in range(2)}


def claim_at_once(url: str, token: str, barrier: object, robot: str, folder: Path) -> None:
    """Claim when the others do, do it, and claim again; write what was claimed."""
    got = []
    with rtask.connect(url, token=token) as graph:
        while True:
            barrier.wait(PATIENCE_S)
            step = graph.call("claim_step")
            if not step["claimed"]:
                break
            for _ in range(2):
                got.append(step["task"])
                place = step["arguments"]["hand" if step["action"].endswith("Grasp") else "place"]
                graph.call("end_step", task=step["task"], result="done", place=place)
                if len(got) % 2:
                    step = graph.call("claim_step")
    (folder / f"{robot.rpartition('/')[2]}.json").write_text(json.dumps(got))


@pytest.mark.deep
@pytest.mark.parametrize("site", [24], indirect=True)
def test_robots_that_claim_at_once_never_get_one_thing(site: Site) -> None:
    """The Panda has begun with nothing: all is taken over, by two at a time."""
    barrier = _FORK.Barrier(2)
    racers = [
        _FORK.Process(
            target=claim_at_once, args=(site.url, site.tokens[robot], barrier, robot, site.folder)
        )
        for robot in (NAO, OTHER)
    ]  # fmt: skip
    for racer in racers:
        racer.start()
    assert [ended(racer) for racer in racers] == [0, 0]
    got = [json.loads((site.folder / f"{name}.json").read_text()) for name in ("nao-1", "nao-2")]
    assert len(set(got[0]) | set(got[1])) == len(got[0]) + len(got[1])
    assert min(map(len, got)) >= 2 * 8
    assert site.person.query(_OVERLAPS) == []
