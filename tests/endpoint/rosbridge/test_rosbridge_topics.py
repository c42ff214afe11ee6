"""Topics: whoever publishes reaches every subscriber."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from endpoint.rosbridge.session import Bridge
from endpoint.rosbridge.topics import Subscriber, Topics
from rtask.errors import UsageError

Connect = Callable[..., Any]


def test_a_message_reaches_every_subscriber_once_the_sender_included(connect: Connect) -> None:
    sender, listener, stranger = connect(), connect(), connect()
    for robot in (sender, listener):
        robot.say({"op": "subscribe", "topic": "/t", "id": "a"})
        robot.say({"op": "subscribe", "topic": "/t", "id": "b"})
    sender.say({"op": "publish", "topic": "/t", "msg": {"n": 1}})
    expected = [{"op": "publish", "topic": "/t", "msg": {"n": 1}}]
    assert sender.heard == expected
    assert listener.heard == expected
    assert stranger.heard == []


def test_unsubscribing_one_id_keeps_the_other(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "subscribe", "topic": "/t", "id": "a"})
    robot.say({"op": "subscribe", "topic": "/t", "id": "b"})
    robot.say({"op": "unsubscribe", "topic": "/t", "id": "a"})
    robot.say({"op": "publish", "topic": "/t", "msg": {}})
    robot.say({"op": "unsubscribe", "topic": "/t"})
    robot.say({"op": "publish", "topic": "/t", "msg": {}})
    assert len(robot.heard) == 1


def test_a_latched_message_goes_to_who_subscribes_later(connect: Connect) -> None:
    sender, late = connect(), connect()
    sender.say({"op": "publish", "topic": "/map", "msg": {"n": 1}, "latch": True})
    sender.say({"op": "publish", "topic": "/map", "msg": {"n": 2}, "latch": True})
    late.say({"op": "subscribe", "topic": "/map"})
    assert [message["msg"] for message in late.heard] == [{"n": 2}]


def test_a_topic_that_is_advertised_as_latched_is_latched(connect: Connect) -> None:
    sender, late = connect(), connect()
    sender.say({"op": "advertise", "topic": "/map", "type": "a/B", "latch": True})
    sender.say({"op": "publish", "topic": "/map", "msg": {"n": 1}})
    late.say({"op": "subscribe", "topic": "/map"})
    assert [message["msg"] for message in late.heard] == [{"n": 1}]


def test_the_first_advertiser_fixes_the_type(connect: Connect) -> None:
    first, second = connect(), connect()
    first.say({"op": "advertise", "topic": "/t", "type": "std_msgs/String"})
    status = second.ask({"op": "advertise", "topic": "/t", "type": "std_msgs/Bool"})
    assert status["msg"] == "topic /t has type std_msgs/String, not std_msgs/Bool"


def test_the_lowest_throttle_of_a_session_wins() -> None:
    subscriber = Subscriber(lambda text, topic: None, {"a": 1_000.0, "b": 100.0})
    times_s = [0.0, 0.05, 0.11, 0.15, 0.25]
    assert [subscriber.is_due(now) for now in times_s] == [True, False, True, False, True]


def test_nothing_is_left_of_a_topic_that_nobody_uses() -> None:
    topics = Topics()
    topics.advertise(1, "/t", "std_msgs/String")
    topics.subscribe(2, "/u", None, 0, lambda text, topic: None)
    topics.publish(1, "/v", {})
    topics.leave(1)
    topics.leave(2)
    assert topics.listing() == []


def test_a_session_advertises_a_bounded_number_of_topics() -> None:
    topics = Topics()
    for number in range(200):
        topics.advertise(1, f"/t{number}", "std_msgs/Empty")
    with pytest.raises(UsageError, match="more than 200 topics"):
        topics.advertise(1, "/one-too-many", "std_msgs/Empty")
    topics.advertise(2, "/of-another", "std_msgs/Empty")


def test_the_server_announces_on_its_own_topics(bridge: Bridge, connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "subscribe", "topic": "/rtask/changes"})
    bridge.topics.announce("/rtask/changes", "rtask/Change", {"commit": 3})
    assert robot.heard == [{"op": "publish", "topic": "/rtask/changes", "msg": {"commit": 3}}]
    assert ("/rtask/changes", "rtask/Change") in bridge.topics.listing()


@pytest.mark.slow
def test_the_newest_message_of_a_pause_comes_when_it_ends(connect: Connect) -> None:
    """rosbridge protocol 2, 3.3.2: `queue_length` 0 keeps only the newest while throttled."""
    robot = connect()
    robot.say({"op": "subscribe", "topic": "/t", "throttle_rate": 1000})
    for number in range(5):
        robot.say({"op": "publish", "topic": "/t", "msg": {"n": number}})
    assert [message["msg"]["n"] for message in robot.heard] == [0]
    deadline = time.monotonic() + 60
    while len(robot.heard) < 2 and time.monotonic() < deadline:
        time.sleep(0.001)
    assert [message["msg"]["n"] for message in robot.heard] == [0, 4]


@pytest.mark.slow
def test_a_queue_keeps_as_many_as_were_asked_for(connect: Connect) -> None:
    robot = connect()
    robot.say({"op": "subscribe", "topic": "/t", "throttle_rate": 1000, "queue_length": 2})
    for number in range(5):
        robot.say({"op": "publish", "topic": "/t", "msg": {"n": number}})
    deadline = time.monotonic() + 60
    while len(robot.heard) < 3 and time.monotonic() < deadline:
        time.sleep(0.001)
    assert [message["msg"]["n"] for message in robot.heard] == [0, 3, 4]
