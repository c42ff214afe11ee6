"""Nothing that a robot tells is lost, whatever fails and whenever."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from rtask.client.base import Client
from rtask.client.outbox import Outbox
from rtask.client.remote import RemoteClient
from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    RemoteUnavailableError,
    UsageError,
)


class Flaky(Client):
    """A client whose server fails as it is told to; it remembers what arrived."""

    def __init__(self, path, failures=()):
        super().__init__(path)
        self.failures = list(failures)
        self.arrived: list[tuple[str, dict[str, Any]]] = []

    def _call(self, operation, args, timeout_s=None):
        failure = self.failures.pop(0) if self.failures else None
        if failure is not None:
            raise failure
        self.arrived.append((operation, args))
        return {"stored": 1}

    def query(self, sparql):
        return []

    def ask(self, sparql):
        return True

    def update(self, sparql):
        pass

    def follow(self, *pattern, **options):
        return iter(())

    def close(self):
        pass


AWAY = RemoteUnavailableError("nobody there")


def test_what_was_answered_leaves_nothing_behind(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl")
    client.report_outcome(task_id="t-1", success=True)
    assert (tmp_path / "outbox.jsonl").read_text() == ""


def test_what_found_nobody_is_kept_and_told_by_the_next_program(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY])
    with pytest.raises(RemoteUnavailableError, match=r"kept in .*outbox\.jsonl"):
        client.report_outcome(task_id="t-1", success=True)
    later = Flaky(tmp_path / "outbox.jsonl")
    assert later.deliver() == 1
    assert later.arrived == [("report_outcome", {"task_id": "t-1", "success": True})]
    assert later.deliver() == 0


def test_the_oldest_is_told_first_an_object_before_its_outcomes(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY, AWAY])
    with pytest.raises(RemoteUnavailableError):
        client.insert_object(objects=[{"data": "x", "task_id": "a"}])
    with pytest.raises(RemoteUnavailableError):
        client.report_outcome(task_id="b")
    client.report_outcome(task_id="c")
    ids = [args.get("task_id") or args["objects"][0]["task_id"] for _, args in client.arrived]
    assert ids == ["a", "b", "c"]


def test_a_refusal_is_raised_and_not_repeated(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [CallFailedError("no such object")])
    with pytest.raises(CallFailedError, match="no such object"):
        client.report_outcome(task_id="t-1")
    assert Outbox(tmp_path / "outbox.jsonl").pending() == []


def test_what_is_refused_when_told_again_is_put_aside_for_people(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY, CallFailedError("too late")])
    with pytest.raises(RemoteUnavailableError):
        client.report_outcome(task_id="t-1")
    client.report_outcome(task_id="t-2")
    assert [args["task_id"] for _, args in client.arrived] == ["t-2"]
    aside = json.loads((tmp_path / "outbox.jsonl.refused").read_text())
    assert (aside["args"]["task_id"], aside["reason"]) == ("t-1", "too late")


def test_what_waits_follows_a_question_that_was_answered(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY, AWAY])
    assert client.tell("report_outcome", task_id="a") is None
    assert client.tell("report_outcome", task_id="b") is None
    client.recall_grasps(object="urn:mug")
    assert [args.get("task_id") for _, args in client.arrived] == [None, "a", "b"]
    assert client.waiting == 0


def test_a_question_is_answered_although_what_waits_cannot_be_sent(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY, None, AWAY])
    assert client.tell("report_outcome", task_id="a") is None
    assert client.recall_grasps(object="urn:mug") == {"stored": 1}
    assert client.waiting == 1


def test_what_an_expired_token_could_not_tell_waits_for_a_new_one(tmp_path):
    expired = AuthenticationError("wants a valid token")
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY, expired, expired])
    assert client.tell("report_outcome", task_id="a") is None
    for task in ("b", "c"):
        with pytest.raises(AuthenticationError):
            client.tell("report_outcome", task_id=task)
    later = Flaky(tmp_path / "outbox.jsonl")
    assert later.deliver() == 3
    assert [args["task_id"] for _, args in later.arrived] == ["a", "b", "c"]
    assert not (tmp_path / "outbox.jsonl.refused").exists()


def test_a_line_cut_off_by_a_crash_is_dropped_and_the_rest_kept(tmp_path):
    box = Outbox(tmp_path / "outbox.jsonl")
    box.add("report_outcome", {"task_id": "whole"})
    with box.path.open("a") as file:
        file.write('{"id": "x", "operation": "report_ou')
    again = Outbox(box.path)
    assert [entry.args["task_id"] for entry in again.pending()] == ["whole"]


def test_every_told_item_carries_an_id_of_its_own(tmp_path):
    client = Flaky(None)
    client.insert_object(objects=[{"data": "x"}, {"data": "y", "task_id": "mine"}])
    client.report_outcome(success=True)
    (_, inserted), (_, reported) = client.arrived
    ids = [item["task_id"] for item in inserted["objects"]] + [reported["task_id"]]
    assert ids[1] == "mine"
    assert len(set(ids)) == 3


def test_questions_need_no_outbox(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY])
    with pytest.raises(RemoteUnavailableError, match=r"^nobody there$"):
        client.recognise_for_grasp(data="x", gripper_id="hand")
    assert client.deliver() == 0


def test_an_answer_that_may_change_keeps_what_was_told(tmp_path):
    busy = CallFailedError("busy: 8 calls running", http_status=503)
    client = Flaky(tmp_path / "outbox.jsonl", [busy])
    assert client.tell("report_outcome", task_id="t-1") is None
    assert client.waiting == 1
    assert client.deliver() == 1
    assert client.waiting == 0


def test_tell_raises_what_will_not_change(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [CallFailedError("no", http_status=422)])
    with pytest.raises(CallFailedError, match="no"):
        client.tell("report_outcome", task_id="t-1")
    assert client.waiting == 0


def test_bytes_are_kept_and_sent_as_base64(tmp_path):
    client = Flaky(tmp_path / "outbox.jsonl", [AWAY])
    client.tell("insert_object", objects=[{"data": b"xyz"}])
    client.deliver()
    assert client.arrived[0][1]["objects"][0]["data"] == "eHl6"


def test_a_number_that_json_lacks_is_refused_and_does_not_block_the_outbox(tmp_path, monkeypatch):
    client = RemoteClient("http://127.0.0.1:9", outbox=tmp_path / "outbox.jsonl")
    monkeypatch.setattr(client._socket, "_open", lambda patience: None)
    with client, pytest.raises(UsageError, match="the arguments are not JSON"):
        client.call("report_outcome", task_id="t-1", grasp_quality=math.nan)
    assert client.waiting == 0


def test_a_call_of_an_older_program_that_json_lacks_is_put_aside(tmp_path, monkeypatch):
    path = tmp_path / "outbox.jsonl"
    Outbox(path).add("report_outcome", {"grasp_quality": math.inf})
    client = RemoteClient("http://127.0.0.1:9", outbox=path)
    monkeypatch.setattr(client._socket, "_open", lambda patience: None)
    with client:
        assert (client.deliver(), client.waiting) == (1, 0)
    assert "are not JSON" in (tmp_path / "outbox.jsonl.refused").read_text()
