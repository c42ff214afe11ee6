"""A robot that gets no answer asks again, is stored once, and says that it waits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rtask.client.base import Client
from rtask.errors import CallFailedError, RemoteUnavailableError
from simulate.agent.servers import RetryingServer

TOLD = {"objects": [{"data": "x", "task_id": "t:1"}]}


class _Slow(Client):
    """Carries everything out, but some answers come too late; keeps what arrived and how long
    each call would have waited."""

    def __init__(self, outbox: Path, *late: Exception) -> None:
        super().__init__(outbox)
        self.late = list(late)
        self.arrived: list[tuple[str, Any, float | None]] = []

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        names = [item.get("task_id") for item in args.get("objects", [])]
        self.arrived.append((operation, names, timeout_s))
        if self.late:
            raise self.late.pop(0)
        return {"objects": [{"object": "o:1"}]}

    def query(self, sparql: str) -> list[dict[str, Any]]: ...
    def ask(self, sparql: str) -> bool: ...
    def update(self, sparql: str) -> None: ...
    def follow(self, *args: Any, **more: Any) -> Any: ...
    def close(self) -> None: ...


@pytest.mark.parametrize(
    "late",
    [
        RemoteUnavailableError("no answer within 30 s"),
        CallFailedError("no answer within 30 s", http_status=504, transient=True),
    ],
)
def test_a_slow_server_is_asked_again_for_longer_and_told_under_the_same_name(tmp_path, late):
    client, said = _Slow(tmp_path / "outbox.jsonl", late, late), []
    server = RetryingServer(client, said.append)
    assert server.insert_object(**TOLD) == {"objects": [{"object": "o:1"}]}
    assert {tuple(names) for _, names, _ in client.arrived} == {("t:1",)}
    assert client.arrived[0][2] < client.arrived[-1][2]
    assert said == ["insert_object"] * 2
    assert client.waiting == 0  # nothing is left in the outbox to tell once more


def test_a_question_is_asked_again_too(tmp_path):
    late = CallFailedError("busy", http_status=503, transient=True)
    client, said = _Slow(tmp_path / "outbox.jsonl", late), []
    assert RetryingServer(client, said.append).recognise_for_grasp(data="x")
    assert said == ["recognise_for_grasp"]


def test_a_refusal_is_no_slowness(tmp_path):
    client, said = (
        _Slow(tmp_path / "outbox.jsonl", CallFailedError("no such gripper")),
        [],
    )
    with pytest.raises(CallFailedError, match="no such gripper"):
        RetryingServer(client, said.append).recognise_for_grasp(data="x")
    assert said == []


def test_patience_ends_and_what_was_to_be_told_is_kept(tmp_path):
    client = _Slow(tmp_path / "outbox.jsonl", *[RemoteUnavailableError("gone")] * 9)
    with pytest.raises(RemoteUnavailableError, match="kept in"):
        RetryingServer(client, [].append, patience_s=-1.0).report_outcome(task_id="t:2")
    assert client.waiting == 1
