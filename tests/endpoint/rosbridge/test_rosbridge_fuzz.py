"""Random messages never end a session, never raise, and never reach another robot's account."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from endpoint.rosbridge.session import Bridge, Session
from rtask.kb.commit.access import Access

Connect = Callable[..., Any]

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=8,
)
OPS = st.sampled_from(
    ["call_service", "advertise", "unadvertise", "publish", "subscribe", "unsubscribe",
     "advertise_service", "unadvertise_service", "service_response", "advertise_action",
     "unadvertise_action", "send_action_goal", "cancel_action_goal", "action_feedback",
     "action_result", "fragment", "set_level", "auth", "search_object", "send_new_object"]
)  # fmt: skip
NAMES = st.sampled_from(
    ["/a", "b", "/rtask/search_object", "/rosapi/topics", "/rosapi/get_param", "/rosapi/set_param",
     "/rosapi/node_details", "/rosapi/service_request_details", "/walk", "", "/", "//", "/rtask/"]
)  # fmt: skip
IDS = st.sampled_from(["1", 1, None, "service_request:1", "action_goal:1", {}, []])
SOUND = {"service": NAMES, "topic": NAMES, "action": NAMES, "type": st.just("a/B"), "id": IDS}
FIELDS = {
    "service": NAMES | JSON,
    "topic": NAMES | JSON,
    "action": NAMES | JSON,
    "type": st.sampled_from(["a/B", "", "rtask/SearchObject"]) | JSON,
    "id": IDS | JSON,
    "args": JSON,
    "msg": JSON,
    "values": JSON,
    "result": JSON,
    "status": st.integers(-1, 9) | JSON,
    "feedback": JSON,
    "timeout": st.sampled_from([0.01, -1, 1e300]) | JSON,
    "throttle_rate": JSON,
    "queue_length": JSON,
    "fragment_size": st.sampled_from([1, 64, 10**30]) | JSON,
    "compression": st.sampled_from(["png", "cbor", "none"]) | JSON,
    "latch": JSON,
    "level": JSON,
    "num": st.integers(-1, 3) | JSON,
    "total": st.integers(-1, 3) | JSON,
    "data": JSON,
    "new_object": JSON,
}
# Mostly sound, so that the message gets somewhere before the wild fields are looked at.
WILD = st.lists(st.sampled_from(sorted(FIELDS)), max_size=2, unique=True).flatmap(
    lambda names: st.fixed_dictionaries({name: FIELDS[name] for name in names})
)
MESSAGES = st.builds(
    lambda op, sound, wild: {"op": op, **sound, **wild}, OPS, st.fixed_dictionaries(SOUND), WILD
)


@pytest.mark.slow
@settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(messages=st.lists(MESSAGES, min_size=1, max_size=8))
def test_random_messages_of_two_robots(bridge: Bridge, messages: list[dict[str, Any]]) -> None:
    frames: list[str | bytes] = []

    def hear(frame: str | bytes, topic: str = "") -> None:
        frames.append(frame)

    robots = [Session(bridge, hear, Access(name, "robot")) for name in ("nao-1", "nao-2")]
    try:
        for number, message in enumerate(messages):
            robots[number % 2].feed(json.dumps(message))
        before = len(frames)
        robots[0].feed('{"op": "set_level", "level": "error"}')
        robots[0].feed('{"op": "call_service", "id": "alive", "service": "/rosapi/get_time"}')
        last = [json.loads(frame) for frame in frames[before:] if isinstance(frame, str)]
        assert any(m.get("id") == "alive" and m.get("result") is True for m in last)
        told = [json.loads(frame) for frame in list(frames) if isinstance(frame, str)]
        unforeseen = [m for m in told if "unexpected error" in str(m.get("msg", m.get("values")))]
        # An engine that stands in knows no other fault than a missing list of objects.
        assert [m for m in unforeseen if m.get("op") == "status"] == []
    finally:
        for robot in robots:
            robot.close()
    assert not bridge.sessions
    assert not bridge.providers.listing()
    assert not bridge.actions._goals
