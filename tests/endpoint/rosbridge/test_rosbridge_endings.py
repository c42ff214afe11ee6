"""Calls of services over rosbridge end as what was stored, whoever ends them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from endpoint.rosbridge.session import Bridge
from rtask.kb.commit.access import Access
from rtask.services import ServiceHost
from rtask.services.datasets.store import Datasets
from tests.endpoint.conftest import Robot, StandInEngine
from tests.rtask.services.endings.moments import Gate, Tally

WRITER = Access("nao-1", "robot")
STORE = "nao-1/Sum"
NAME = "/services/moments/Tally/add"


@pytest.fixture
def host() -> Iterator[ServiceHost]:
    with ServiceHost([Tally]) as opened:
        opened.datasets.create(STORE, access=WRITER)
        opened.datasets.put(STORE, {"sum": b"1"}, WRITER)
        yield opened


@pytest.fixture
def bridge(host: ServiceHost) -> Iterator[Bridge]:
    made = Bridge(StandInEngine(), host=host)
    yield made
    made.close()


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Gate:
    made = Gate(tmp_path)
    put = Datasets.put_together

    def stopping(*args: Any) -> None:
        put(*args)
        made.reach("stored")

    monkeypatch.setattr(Datasets, "put_together", stopping)
    return made


def total(host: ServiceHost) -> int:
    host.call("moments/Tally", "add", {"number": 0}, None, {"store": STORE})  # the one before ended
    return int(host.datasets.read(f"{STORE}@head", "sum"))


def cancel(robot: Robot) -> None:
    robot.say({"op": "cancel_action_goal", "id": "g", "action": NAME})


def leave(robot: Robot) -> None:
    robot.session.close()


@pytest.mark.parametrize(
    ("end", "moment", "status", "stored"),
    [
        (cancel, "after it wrote", 5, 1),
        (cancel, "stored", 4, 11),
        (leave, "after it wrote", None, 1),
        (leave, "stored", None, 11),
    ],
)
def test_the_result_of_a_goal_says_whether_it_was_stored(
    bridge: Bridge,
    host: ServiceHost,
    gate: Gate,
    tmp_path: Path,
    end: Callable[[Robot], None],
    moment: str,
    status: int | None,
    stored: int,
) -> None:
    gate.stop_at(moment)
    robot = Robot(bridge, WRITER)
    args = {"number": 10, "gate": str(tmp_path), "$data": {"store": STORE}}
    robot.say({"op": "send_action_goal", "id": "g", "action": NAME, "args": args})
    gate.wait()
    end(robot)
    gate.open()
    assert total(host) == stored
    if status is not None:
        assert [result(robot)["status"]] == [status]


@pytest.mark.parametrize(("moment", "stored"), [("after it wrote", 1), ("stored", 11)])
def test_a_call_whose_time_is_up_or_whose_caller_leaves_says_whether_it_was_stored(
    bridge: Bridge, host: ServiceHost, gate: Gate, tmp_path: Path, moment: str, stored: int
) -> None:
    gate.stop_at(moment)
    robot = Robot(bridge, WRITER)
    args = {"number": 10, "gate": str(tmp_path), "$data": {"store": STORE}}
    robot.say({"op": "call_service", "id": "c", "service": NAME, "args": args, "timeout": 60})
    gate.wait()
    for call in list(robot.session._own_calls):
        assert not call.leave(is_late=True), "the call itself answers"
    gate.open()
    assert total(host) == stored
    answer = result(robot)
    assert answer["result"] == (stored == 11)
    assert stored == 11 or answer["values"] == "no answer within 60 s"


def result(robot: Robot) -> dict[str, Any]:
    until = time.monotonic() + 60
    while not robot.heard:
        assert time.monotonic() < until
        time.sleep(0.002)
    (found,) = robot.heard
    return found
