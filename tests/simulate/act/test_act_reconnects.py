"""The act service announces itself again however often its connection is lost; without a server."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

from websockets.exceptions import ConnectionClosedError
from websockets.sync import client

from simulate.act import provider as act


class Line:
    """A connection that is lost while the robot announces itself, or at the first wait."""

    def __init__(self, is_lost_at_once: bool) -> None:
        self.is_lost_at_once, self.is_closed = is_lost_at_once, False
        self.sent: list[dict[str, Any]] = []

    def __enter__(self) -> Line:
        return self

    def __exit__(self, *raised: object) -> None:
        self.is_closed = True

    def send(self, text: str) -> None:
        if self.is_lost_at_once:
            raise ConnectionClosedError(None, None)
        self.sent.append(json.loads(text))

    def recv(self, timeout: float) -> str:
        raise ConnectionClosedError(None, None)


def test_a_connection_lost_while_the_robot_announces_itself_is_opened_again(monkeypatch):
    robot = SimpleNamespace(arms={"arm": None}, joint_values=dict)
    service = SimpleNamespace(cell=SimpleNamespace(robot=robot), act=dict, has_the_arm=False)
    provider = act.ActProvider(service, "http://127.0.0.1:1", "panda-1")
    lines = [Line(False), Line(True), Line(True), Line(False)]
    coming = iter(lines)

    def connect(*_: Any, **__: Any) -> Line:
        line = next(coming)
        if line is lines[-1]:
            provider.stop()
        return line

    monkeypatch.setattr(client, "connect", connect)
    monkeypatch.setattr(act, "_AGAIN_S", 0.0)
    provider.serve()
    assert [line.is_closed for line in lines] == [True] * 4
    first, last = ([{**one, "msg": None} for one in line.sent] for line in (lines[0], lines[3]))
    assert last == first  # but for the time in the state of the joints
    assert {one["op"] for one in lines[3].sent} >= {"advertise_service", "advertise_action"}
