"""Topics of ROS 2 by Zenoh, as far as that can be tried without ROS 2."""

from __future__ import annotations

import json
import os
import queue
import sys
from pathlib import Path

import numpy as np
import pytest

import rtask
from features.codec import decode
from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.zenoh.names import Endpoint, attachment, read_attachment, topic_key
from tests.rtask.interop.ros.conftest import Child, free_port, running
from tests.servers import running_server

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CLOUD = "sensor_msgs/msg/PointCloud2"


def test_a_token_of_the_published_design_text():
    talker = Endpoint(
        2, "8b20917502ee955ac4476e0266340d5c", 10, "MP", "talker", "/chatter",
        "std_msgs/msg/String", STRING_HASH,
    )  # fmt: skip
    assert talker.token == (
        "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
        f"std_msgs::msg::dds_::String_/{STRING_HASH}/::,7:,:,:,,"
    )
    assert len(talker.gid) == 16


def test_a_topic_in_a_namespace_keeps_its_slashes_in_keys_and_loses_them_in_tokens():
    key = topic_key(0, "/robot1/chatter", "std_msgs/msg/String", STRING_HASH)
    assert key == f"0/robot1/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    told = Endpoint(0, "ab", 1, "MS", "n", "/robot1/chatter", "std_msgs/msg/String", "H")
    assert "/%robot1%chatter/" in told.token


def test_an_attachment_is_33_bytes_in_little_endian():
    made = attachment(1, 2, bytes(range(16)))
    assert made == b"\1" + bytes(7) + b"\2" + bytes(7) + b"\x10" + bytes(range(16))
    assert read_attachment(made) == (1, 2, bytes(range(16)))
    with pytest.raises(UsageError, match="expected 33: is rmw_zenoh older"):
        read_attachment(made[:-1])


@pytest.mark.parametrize("topic", ["", "/", "a//b", "a*", "a b"])
def test_names_that_would_match_other_topics_are_refused(topic):
    with pytest.raises(UsageError, match="no name of a topic"):
        topic_key(0, topic, "std_msgs/msg/String", "H")


@pytest.fixture(scope="module")
def router():
    """A Zenoh router in this process, where ROS 2 has rmw_zenohd."""
    zenoh = pytest.importorskip("zenoh")
    address = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([address]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield address, session
    session.close()


def command(*arguments):
    return Child(
        [sys.executable, "-m", "rtask", "ros", "zenoh", *arguments],
        {**os.environ, "PYTHONUNBUFFERED": "1"},
    )


def test_without_a_router_the_error_says_how_to_start_one():
    from rtask.interop.ros.zenoh.node import ZenohNode

    with pytest.raises(RemoteUnavailableError, match="start one: ros2 run rmw_zenoh_cpp"):
        ZenohNode("rtask", f"tcp/127.0.0.1:{free_port()}", wait_s=0.2)


@pytest.mark.slow
def test_commits_are_published_with_token_hash_and_attachment(router):
    address, session = router
    key = topic_key(0, "/rtask/changes", "std_msgs/msg/String", STRING_HASH)
    heard = queue.Queue()
    session.declare_subscriber(key, heard.put)
    with running_server(None) as server:
        child = command("changes", "--server", server.url, "--router", address)
        with running(child), rtask.connect(server.url) as client:
            child.expect("experimental: not tested against ROS 2")
            child.expect("ready /rtask/changes")
            hand = {"name": "h", "gripper_type": "t", "max_opening": 0.1, "max_payload": 1.0}
            for number in range(20):  # until the follower has begun
                client.register_robot(name=f"r-{number}", model="m", end_effectors=[hand])
                try:
                    sample = heard.get(timeout=1)
                    break
                except queue.Empty:
                    pass
            tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**")]
    sequence, time_ns, gid = read_attachment(sample.attachment.to_bytes())
    assert (sequence, len(gid)) == (1, 16)
    assert time_ns > 1.7e18
    data = sample.payload.to_bytes()
    assert data[:4] == b"\0\1\0\0"  # CDR, little endian
    assert json.loads(data[8:].rstrip(b"\0"))["added"] > 0
    kinds = sorted(token.split("/")[5] for token in tokens)
    assert kinds == ["MP", "NN"]
    assert any(STRING_HASH in token for token in tokens)


@pytest.mark.slow
def test_a_cloud_of_a_topic_is_saved_as_it_was(router, tmp_path):
    from rtask.interop.ros.zenoh.node import ZenohNode

    address, session = router
    child = command("save", "/camera/points", str(tmp_path), "--router", address, "--json")
    points = np.random.default_rng(1).normal(size=(6, 3)).astype("<f4")
    with running(child), ZenohNode("camera", address) as node:
        publisher = node.publisher("/camera/points", CLOUD)
        child.expect("ready /camera/points")
        type_hash = node.types.hash_rihs01(CLOUD)
        session.put(topic_key(0, "/camera/points", CLOUD, type_hash), b"no CDR at all")
        publisher.publish(_cloud(node.types.types, points))
        child.expect("[")
        assert child.finish() == 0
    (file,) = json.loads("".join(child.said[child.said.index("[\n") :]))
    assert Path(file).parent == tmp_path
    np.testing.assert_array_equal(decode(Path(file).read_bytes()).positions, points)


def _cloud(types, points):
    fields = [types["sensor_msgs/msg/PointField"](a, 4 * k, 7, 1) for k, a in enumerate("xyz")]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "camera")
    data = np.frombuffer(points.tobytes(), np.uint8)
    return types[CLOUD](header, 1, len(points), fields, False, 12, data.size, data, True)
