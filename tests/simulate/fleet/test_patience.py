"""A server that is away for a while, and a robot that knows nothing about shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rtask
from rtask.client.base import Client
from rtask.errors import CallFailedError, RemoteUnavailableError
from simulate.agent import servers
from simulate.agent.servers import BlindServer, OutboxServer


class _Flaky(Client):
    """Answers, except while it is away; keeps what arrived."""

    def __init__(self, outbox: Path) -> None:
        super().__init__(outbox)
        self.away = 0
        self.absence: Exception = RemoteUnavailableError("nobody answers")
        self.arrived: list[tuple[str, dict[str, Any]]] = []

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        if self.away > 0:
            self.away -= 1
            raise self.absence
        self.arrived.append((operation, args))
        return {"objects": [{"object": "o:1"}]}

    def query(self, sparql: str) -> list[dict[str, Any]]: ...
    def ask(self, sparql: str) -> bool: ...
    def update(self, sparql: str) -> None: ...
    def follow(self, *args: Any, **more: Any) -> Any: ...
    def close(self) -> None: ...


def test_a_question_waits_and_what_is_told_meanwhile_arrives_once_and_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(servers, "_PAUSE_S", 0.0)
    client, waited = _Flaky(tmp_path / "outbox.jsonl"), []
    server = OutboxServer(client, 60.0, waited.append)
    client.away = 1
    told = server.insert_object(objects=[{"data": "x", "task_id": "t:1"}])
    assert told == {"objects": [{"object": ""}]}
    assert client.waiting == 1
    client.away = 2
    server.recognise_for_grasp(data="y")
    server.report_outcome(task_id="t:2", object="o:1", success=True)
    assert [(name, args.get("task_id")) for name, args in client.arrived] == [
        ("recognise_for_grasp", None), ("insert_object", None), ("report_outcome", "t:2"),
    ]  # fmt: skip
    assert client.arrived[1][1]["objects"][0]["task_id"] == "t:1"
    assert waited == ["insert_object", "recognise_for_grasp", "recognise_for_grasp"]
    assert client.waiting == 0


@pytest.mark.parametrize("status", [503, 504])
def test_a_busy_server_is_waited_for_like_one_that_is_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    monkeypatch.setattr(servers, "_PAUSE_S", 0.0)
    client, waited = _Flaky(tmp_path / "outbox.jsonl"), []
    client.absence = CallFailedError("no answer in 30 s", http_status=status, transient=True)
    server = OutboxServer(client, 60.0, waited.append)
    client.away = 3
    server.register_robot(name="nao")
    assert waited == ["register_robot"] * 3
    client.away = 1
    assert server.report_outcome(task_id="t:1", object="o:1", success=True) == {}
    assert client.waiting == 1
    server.recognise_for_grasp(data="y")
    assert client.waiting == 0
    assert [args.get("task_id") for _, args in client.arrived] == [None, None, "t:1"]


def test_patience_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(servers, "_PAUSE_S", 0.0)
    client = _Flaky(tmp_path / "outbox.jsonl")
    client.away = 10**9
    with pytest.raises(RemoteUnavailableError):
        OutboxServer(client, 0.0).recognise_for_grasp(data="y")


def test_a_refusal_is_no_absence(tmp_path: Path) -> None:
    with (
        rtask.open(":memory:", reason=False) as kb,
        rtask.connect(kb, agent="robot") as client,
        pytest.raises(rtask.errors.UsageError),
    ):
        OutboxServer(client, 60.0).recognise_for_grasp(colour="red")


class _Graph:
    """Remembers one grasp that held twice of three, one that never did."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.told: list[tuple[str, dict[str, Any]]] = []

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]:
        self.asked.append(request)
        shape = {"x": 0.15, "y": -0.1, "yaw": 0.5, "length": 0.06, "width": 0.03, "height": 0.05,
                 "support_height": 0.27}  # fmt: skip
        memory = [("lost", 0, 2), ("held", 2, 3)]
        grasps = [
            {"id": i, "source": "memory", "statistics": {"successes": s, "attempts": n}}
            for i, s, n in memory
        ]
        return {"shape": shape, "grasps": grasps}

    def insert_object(self, **request: Any) -> dict[str, Any]:
        self.told.append(("insert_object", request))
        return {}

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        self.told.append(("report_outcome", request))
        return {}


_LOOK = {"data": "d", "sensor_pose": {}, "frame_id": "base", "support_height": 0.27}


def test_a_robot_without_geometry_tries_what_held_before_then_anything_over_the_box() -> None:
    graph = _Graph()
    server = BlindServer(graph, np.random.default_rng(1), 0.05)
    grasps = server.recognise_for_grasp(propose=True, **_LOOK)["grasps"]
    assert graph.asked[0]["propose"] is False
    assert [g["source"] for g in grasps] == ["memory"] + ["blind"] * 10
    assert grasps[0]["id"] == "held"
    for grasp in grasps[1:]:
        away = np.array([grasp["x"] - 0.15, grasp["y"] + 0.1])
        along = np.array([np.cos(0.5), np.sin(0.5)])
        assert abs(away @ along) <= 0.03 + 1e-9
        assert abs(away @ [-along[1], along[0]]) <= 0.015 + 1e-9
        assert 0 <= grasp["theta"] < np.pi
    assert len({round(g["theta"], 3) for g in grasps[1:]}) > 3


def test_a_blind_grasp_of_a_known_object_is_told_with_the_look_that_places_it() -> None:
    graph = _Graph()
    server = BlindServer(graph, np.random.default_rng(1), 0.05)
    grasps = server.recognise_for_grasp(**_LOOK)["grasps"]
    server.report_outcome(object="o:1", grasp=grasps[1], task_id="t:1")
    server.report_outcome(object="o:1", grasp=grasps[0], task_id="t:2")
    (first, inserted), (second, reported) = graph.told
    assert (first, second) == ("insert_object", "report_outcome")
    assert inserted["objects"] == [{**_LOOK, "object": "o:1", "grasp": grasps[1], "task_id": "t:1"}]
    assert reported["task_id"] == "t:2"
