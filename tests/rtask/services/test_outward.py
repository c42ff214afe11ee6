"""Workers without a network: what they may say, and what happens when they fall silent or late."""

from __future__ import annotations

import queue
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from rtask.errors import (
    CancelledError,
    QueueFullError,
    ServiceError,
    ServiceFailedError,
    UsageError,
    WorkerDiedError,
)
from rtask.services import ServiceHost
from rtask.services.call import Invocation
from rtask.services.definition import define
from rtask.services.description import described
from rtask.services.outward.announced import announced
from rtask.services.outward.frames import pack, plain, unpack
from rtask.services.outward.seats import SILENCE_S, Outward
from rtask.services.registry import Registry
from tests.rtask.services.farm import Barn, Field
from tests.rtask.services.lab import Arm

LONG_S = 60.0
NUMBER = {"type": "number"}
DOUBLE = {
    "request": {"properties": {"value": NUMBER}, "required": ["value"]},
    "answer": {"properties": {"value": NUMBER}, "required": ["value"]},
    "effect": "reads",
}


class FakeLink:
    """A worker whose messages the test writes itself."""

    name = "worker fake"

    def __init__(self) -> None:
        self.sent: queue.Queue[dict[str, Any]] = queue.Queue()
        self.refused: list[str] = []

    def send(self, message: Mapping[str, Any], args: BaseModel | None) -> None:
        self.sent.put({**message, "args": None if args is None else plain(args)})

    def refuse(self, words: str) -> None:
        self.refused.append(words)

    def next(self) -> dict[str, Any]:
        return self.sent.get(timeout=LONG_S)


def description(**methods: Any) -> dict[str, Any]:
    return {"name": "farm/Plough", "version": "1.0.0", "methods": methods or {"double": DOUBLE}}


def test_a_call_is_checked_sent_and_its_answer_checked():
    with ServiceHost() as host:
        link = FakeLink()
        host.outward.join(link, description(), 1)
        with pytest.raises(UsageError, match="value: expected a finite number, got 'x'"):
            host.call("farm/Plough", "double", {"value": "x"})
        for values, outcome in (({"value": 4}, 4.0), ({"value": "no"}, None)):
            task = host.submit(Invocation("farm/Plough", "double", {"value": 2}))
            asked = link.next()
            assert (asked["op"], asked["args"]) == ("call_service", {"value": 2.0})
            host.outward.take(
                link, {"op": "action_feedback", "id": asked["id"], "values": {"progress": 0.5}}
            )
            assert task.call.fraction == 0.5
            reply = {"op": "service_response", "id": asked["id"], "result": True}
            host.outward.take(link, {**reply, "values": values})
            if outcome is None:
                with pytest.raises(ServiceFailedError, match="does not declare: value"):
                    task.result()
            else:
                assert task.result()["value"] == outcome


def test_no_more_calls_wait_for_a_worker_than_it_says():
    with ServiceHost() as host:
        link = FakeLink()
        host.outward.join(link, {**description(), "max_waiting": 3}, 1)
        tasks = [host.submit(Invocation("farm/Plough", "double", {"value": 1}))]
        link.next()  # the worker is busy with the first one
        tasks += [host.submit(Invocation("farm/Plough", "double", {"value": 1})) for _ in range(3)]
        with pytest.raises(QueueFullError, match="3 calls are waiting"):
            host.submit(Invocation("farm/Plough", "double", {"value": 1}))
        for task in tasks:
            task.cancel()
        with pytest.raises(UsageError, match="max_waiting: expected a whole number"):
            host.outward.join(link, {**description(), "max_waiting": 0}, 1)


@pytest.mark.parametrize(
    ("error", "kind"),
    [(None, ServiceError), ("service-failed", ServiceFailedError), ("what", ServiceFailedError)],
)
def test_the_reason_of_a_failure_reaches_the_caller(error, kind):
    with ServiceHost() as host:
        link = FakeLink()
        host.outward.join(link, description(), 1)
        task = host.submit(Invocation("farm/Plough", "double", {"value": 2}))
        reply = {"op": "service_response", "id": link.next()["id"], "result": False}
        host.outward.take(link, {**reply, "values": "too stony", "error": error})
        with pytest.raises(kind, match=r"^too stony$") as caught:
            task.result()
        assert type(caught.value) is kind


def test_a_seat_whose_call_goes_on_after_its_cancellation_is_given_no_other():
    with ServiceHost() as host:
        slow, other = FakeLink(), FakeLink()
        host.outward.join(slow, description(), 1)
        task = host.submit(Invocation("farm/Plough", "double", {"value": 1}))
        first = slow.next()
        task.cancel()
        with pytest.raises(CancelledError):
            task.result()
        assert slow.next()["op"] == "cancel_action_goal"
        host.outward.join(other, description(), 1)
        again = host.submit(Invocation("farm/Plough", "double", {"value": 1}))
        reply = {"op": "service_response", "result": True, "values": {"value": 2}}
        host.outward.take(other, {**reply, "id": other.next()["id"]})
        assert again.result()["value"] == 2.0
        assert slow.sent.empty()
        host.outward.take(slow, {**reply, "id": first["id"]})


def test_a_full_queue_of_a_worker_refuses_and_loses_nothing():
    reply = {"op": "service_response", "result": True}
    with ServiceHost() as host:
        link = FakeLink()
        host.outward.join(link, description(), 1)
        tasks = [host.submit(Invocation("farm/Plough", "double", {"value": 0}))]
        asked = [link.next()]  # the worker has this one; a hundred may wait behind it
        refused = 0
        for value in range(1, 200):
            try:
                tasks.append(host.submit(Invocation("farm/Plough", "double", {"value": value})))
            except QueueFullError:
                refused += 1
        assert (len(tasks), refused) == (101, 99)
        for _ in tasks:
            one = asked.pop() if asked else link.next()
            values = {"value": 2 * one["args"]["value"]}
            host.outward.take(link, {**reply, "id": one["id"], "values": values})
        assert [task.result()["value"] for task in tasks] == [2.0 * k for k in range(101)]
        again = host.submit(Invocation("farm/Plough", "double", {"value": 7}))
        one = link.next()
        host.outward.take(link, {**reply, "id": one["id"], "values": {"value": 14}})
        assert again.result()["value"] == 14.0


def test_a_worker_that_falls_silent_loses_its_calls():
    now = [0.0]
    registry = Registry()
    changed: list[str] = []
    outward = Outward(registry, changed.append, clock=lambda: now[0])
    link = FakeLink()
    definition = outward.join(link, description(), 2)
    now[0] += SILENCE_S
    outward.drop_silent()
    assert outward.count(definition.exact) == 2
    outward.heard(link)
    now[0] += SILENCE_S + 0.1
    outward.drop_silent()
    assert outward.count(definition.exact) == 0
    assert outward.is_empty
    assert "nothing heard for 30 s" in link.refused[0]
    assert changed == ["farm/Plough@1.0.0"] * 2


def test_a_call_of_a_worker_that_leaves_is_repeated_unless_it_writes():
    writing = {**DOUBLE, "effect": "writes"}
    with ServiceHost() as host:
        first, second = FakeLink(), FakeLink()
        host.outward.join(first, description(double=DOUBLE, write=writing), 1)
        task = host.submit(Invocation("farm/Plough", "double", {"value": 1}))
        first.next()
        host.outward.join(second, description(double=DOUBLE, write=writing), 1)
        host.outward.leave(first)
        reply = {"op": "service_response", "result": True, "values": {"value": 2}}
        host.outward.take(second, {**reply, "id": second.next()["id"]})
        assert task.result()["value"] == 2.0
        task = host.submit(Invocation("farm/Plough", "write", {"value": 1}))
        second.next()
        host.outward.leave(second)
        with pytest.raises(WorkerDiedError, match="left before it answered"):
            task.result()


def test_workers_of_one_version_agree_and_join_the_servers_own():
    other = {**DOUBLE, "request": {"properties": {"value": {"type": "string"}}}}
    with ServiceHost([Field]) as host:
        one, two = FakeLink(), FakeLink()
        host.outward.join(one, description(), 1)
        with pytest.raises(UsageError, match="give this one a new version"):
            host.outward.join(two, description(double=other), 1)
        host.outward.leave(one)  # nobody serves it: it may be described anew
        host.outward.join(two, description(double=other), 1)
        own = described(define(Field), [], "")
        assert host.outward.join(two, own, 3) is host.registry.find("farm/Field")
        assert host.outward.count("farm/Field@1.0.0") == 3


@pytest.mark.parametrize("service", [Field, Barn, Arm])
def test_a_description_is_read_back_as_what_it_describes(service):
    told = described(define(service), ["1.0.0"], "ready")
    again = described(announced(told), ["1.0.0"], "ready")
    for name, one in told["methods"].items():
        for part in ("summary", "scope", "output", "output_type", "effect", "only_reads"):
            assert again["methods"][name][part] == one[part], (name, part)
        assert again["methods"][name]["request"].get("properties") == one["request"].get(
            "properties"
        )
    assert again["resources"] == told["resources"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("x", "description: expected an object"),
        ({**description(), "name": "Plough"}, "expected <namespace>/<name>"),
        ({**description(), "version": "1"}, "expected 1.2.3"),
        ({**description(), "methods": {}}, "1 to 100 methods"),
        ({**description(), "timeout_s": -1}, "timeout_s: expected seconds"),
        (description(double={**DOUBLE, "scope": "all"}), "scope: expected one of read"),
        (description(double={"request": {"properties": {"a": {"type": "x"}}}}), "a: type 'x'"),
        (description(double={"request": {"properties": {"_a": NUMBER}}}), "cannot have this name"),
        (description(double={"request": []}), "expected the JSON Schema of an object"),
        (description(double={"request": {"properties": {"a": {"enum": [[]]}}}}), "cannot be read"),
        (description(double={"request": {"properties": {"a": NUMBER}, "required": 1}}), "read"),
        (
            {**description(), "resources": {"graph": {"type": "graph"}}},
            "resources.graph: a worker can have type binary only",
        ),
    ],
)
def test_a_description_that_cannot_be_read_says_where(given, words):
    with pytest.raises(UsageError, match=words):
        announced(given)


@pytest.mark.parametrize("slots", [0, 257, "2", True, None])
def test_slots_are_a_whole_number(slots):
    with ServiceHost() as host, pytest.raises(UsageError, match="slots: expected a whole number"):
        host.outward.join(FakeLink(), description(), slots)


def test_what_a_call_writes_must_be_to_its_own_data():
    with ServiceHost() as host:
        host.datasets.create("farm/Sums")
        link = FakeLink()
        host.outward.join(link, described(define(Barn), [], ""), 1)
        before = host.datasets.find("farm/Sums@head").digest
        asked = Invocation("farm/Barn", "add", {"number": 1}, data={"store": "farm/Sums"})
        for written, is_stored in (
            ({"other": {"sum": b"1"}}, False),
            ({"store": {"sum": b"1"}}, True),
        ):
            task = host.submit(asked)
            call = link.next()
            assert call["data"] == {"store": "farm/Sums@head"}
            reply = {"op": "service_response", "id": call["id"], "result": True}
            host.outward.take(link, {**reply, "values": {"total": 1}, "written": written})
            if is_stored:
                assert task.result()["total"] == 1
            else:
                with pytest.raises(ServiceFailedError, match="wrote to 'other', which it may not"):
                    task.result()
            assert (host.datasets.find("farm/Sums@head").digest != before) is is_stored


def test_frames_carry_arrays_of_every_shape():
    values = {
        "flat": np.arange(5.0),
        "table": np.ones((2, 3)),
        "none": np.zeros((0, 3)),
        "b": b"\0",
    }
    back = unpack(pack(values))
    for name in ("flat", "table", "none"):
        np.testing.assert_array_equal(back[name], values[name])
        assert back[name].shape == values[name].shape
    assert back["b"] == b"\0"


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"\xff",
        b"\x01",
        b"\xa1\x01\x02",
        b"\xa1\x61a\xd8\x28\x82\x82\x05\x05\xd8\x56\x48" + 8 * b"\0",
        b"\xa1\x61a\xd8\x56\x43abc",
        b"\xa1\x61a" + 100 * b"\x81" + b"\0",
        b"\xa1\x61a\xd9\xff\xff\x01",
    ],
)
def test_a_frame_that_cannot_be_read_is_refused(frame):
    with pytest.raises(UsageError):
        unpack(frame)


def test_what_cbor_cannot_carry_is_refused():
    with pytest.raises(UsageError, match="object has no form in CBOR"):
        pack({"a": object()})
