"""ROS 2 by DDS: bytes and hashes of Jazzy, and two processes on the loopback interface."""

from __future__ import annotations

import json
import queue
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rtask
from features.codec import decode
from rtask.cli.ros.schema import engine_schema
from rtask.errors import UsageError
from rtask.interop.ros.dds.calling import read_header, with_header
from rtask.interop.ros.dds.types import RosTypes, dds_name, full_type
from tests.commands import run_command
from tests.rtask.interop.ros.conftest import running
from tests.rtask.interop.ros.dds.conftest import ADD, HAND, command

STRING, CLOUD = "std_msgs/msg/String", "sensor_msgs/msg/PointCloud2"
# What real rclpy of Jazzy says of the same types and messages.
HASHES = {
    STRING: "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    CLOUD: "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    ADD: "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a",
    f"{ADD}_Request": "000c5fd92d6b2e1a05949348f584d6d652adea1e92d691792011ac2273508302",
}
CLOUD_CDR = (
    "0001000001000000020000000400000063616d0001000000020000000100000002000000780000000000000007"
    "0000000100000000000000040000000800000008000000010203040506070801"
)


@pytest.mark.parametrize("type_", HASHES)
def test_hashes_are_those_of_jazzy(types, type_):
    assert types.hash(type_) == f"RIHS01_{HASHES[type_]}"


def test_hashes_of_the_package_are_those_that_the_tools_of_jazzy_made_of_the_same_definitions():
    made = json.loads(Path(__file__).parents[1].joinpath("jazzy_hashes.json").read_text("utf-8"))
    types = RosTypes()
    add = {"msg": types.add_message, "srv": types.add_service, "action": types.add_action}
    for path, text in made["definitions"].items():
        add[path.partition("/")[0]](f"rtask_msgs/{path.rpartition('.')[0]}", text)
    assert types.hashes() == made["hashes"]
    kinds = ("msg/", "srv/", "action/")
    assert all(any(kind in name for name in made["hashes"]) for kind in kinds)


def test_every_message_and_service_of_the_package_has_a_hash_of_its_own(types):
    services = [f"rtask_msgs/srv/{service.name}" for service in engine_schema().services.values()]
    messages = [f"rtask_msgs/msg/{name}" for name in engine_schema().records]
    hashes = {types.hash(type_) for type_ in (*services, *messages)}
    assert len(hashes) == len(services) + len(messages)


def test_a_text_has_the_bytes_of_jazzy(types):
    message = types.make(STRING)
    message.data = "hello"
    assert types.encode(message, STRING).hex() == "000100000600000068656c6c6f00"
    assert types.decode(types.encode(message, STRING), STRING).data == "hello"


def test_a_cloud_has_the_bytes_of_jazzy_both_ways(types):
    cloud = types.make(CLOUD)
    cloud.header.stamp.secs, cloud.header.stamp.nsecs = 1, 2
    cloud.header.frame_id, cloud.height, cloud.width = "cam", 1, 2
    field = types.make("sensor_msgs/PointField")
    field.name, field.datatype, field.count = "x", 7, 1
    cloud.fields, cloud.point_step, cloud.row_step = [field], 4, 8
    cloud.data, cloud.is_dense = bytes(range(1, 9)), True
    assert types.encode(cloud, CLOUD).hex() == CLOUD_CDR
    again = types.decode(bytes.fromhex(CLOUD_CDR), CLOUD)
    assert (again.header.stamp.nsecs, again.fields[0].name, again.data) == (2, "x", cloud.data)


def test_a_request_has_the_bytes_of_jazzy_behind_its_header(types):
    request = types.make(f"{ADD}_Request")
    request.a, request.b = 3, 4
    cdr = types.encode(request, f"{ADD}_Request")
    assert cdr.hex() == "0001000003000000000000000400000000000000"
    assert with_header(cdr, 7, 9).hex() == (
        "00010000" "0700000000000000" "0900000000000000" "0300000000000000" "0400000000000000"
    )  # fmt: skip
    assert read_header(with_header(cdr, 7, 9)) == (7, 9, cdr)
    big = b"\0\0\0\0" + (7).to_bytes(8, "big") + (9).to_bytes(8, "big")
    assert read_header(big)[:2] == (7, 9)


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\x7fabc"])
def test_what_is_no_cdr_of_its_type_is_refused(types, data):
    with pytest.raises(UsageError, match="no sensor_msgs/msg/PointCloud2"):
        types.decode(data, CLOUD)
    with pytest.raises(UsageError, match="expected at least 20"):
        read_header(data)


def test_names_of_types_are_those_of_dds():
    assert dds_name("rtask_msgs/srv/WhereIs_Request") == "rtask_msgs::srv::dds_::WhereIs_Request_"
    assert full_type("geometry_msgs/Pose") == "geometry_msgs/msg/Pose"
    with pytest.raises(UsageError, match="no type of ROS 2"):
        full_type("Pose")


@pytest.mark.slow
def test_an_operation_is_a_service_and_its_commit_a_message(served, robot, types):
    changes = queue.Queue()
    robot.subscribe("rtask/changes", "rtask_msgs/msg/Change", changes.put)
    client = robot.client("rtask/register_robot", "rtask_msgs/srv/RegisterRobot")
    request = client.make()
    request.name, request.model = "nao-1", "nao"
    hand = types.make("rtask_msgs/EndEffector")
    for name, value in HAND.items():
        setattr(hand, name, value)
    request.end_effectors = [hand]
    response = client.call(request, 30)
    assert response.refused == ""
    assert response.robot.endswith("robot/nao-1")
    with rtask.connect(served.url) as direct:
        for number in range(50):  # until the topic is discovered
            direct.register_robot(name=f"r-{number}", model="m", end_effectors=[HAND])
            try:
                change = types.decode(changes.get(timeout=0.5), "rtask_msgs/msg/Change")
                break
            except queue.Empty:
                pass
    assert change.commit > 0
    assert change.added > 0


@pytest.mark.slow
def test_a_refused_operation_is_answered_with_its_reason(served, robot):
    client = robot.client("rtask/report_outcome", "rtask_msgs/srv/ReportOutcome")
    response = client.call(client.make(), 30)
    assert response.refused.startswith("gripper_id is missing")
    assert "\n" not in response.refused


@pytest.mark.slow
def test_the_node_is_seen_by_name_and_its_endpoints_have_hashes(served, robot, types):
    names, seen = set(), threading.Event()

    def hear(heard):
        names.update(heard)
        if "/nao1/rtask_node" in names:
            seen.set()

    robot.watch_nodes(hear)
    assert seen.wait(60), names


@pytest.mark.slow
def test_a_late_reader_of_a_latched_topic_hears_all_who_write_it(robot, types):
    """As of /tf_static, which each driver writes once; the last message of one hid the others'."""
    topic, heard, missing = "rtask/static", queue.Queue(), set("abcdefgh")
    for text in sorted(missing):
        message = types.make(STRING)
        message.data = text
        robot.publisher(topic, STRING, is_latched=True).publish(message)
    robot.subscribe(topic, STRING, heard.put, is_latched=True)
    while missing:
        missing.discard(types.decode(heard.get(timeout=60), STRING).data)


@pytest.mark.slow
def test_a_call_from_a_shell_prints_the_response(served, network):
    run = run_command(
        "ros2", "dds", "call", "register_robot",
        json.dumps({"name": "nao-2", "model": "nao", "end_effectors": [HAND]}),
        "--namespace", "/nao1", "--domain", network, "--wait", "30",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["robot"].endswith("robot/nao-2")


@pytest.mark.slow
def test_what_a_shell_asks_for_in_vain_ends_with_exit_code_3(served, network, tmp_path):
    report = {"object": "urn:x", "gripper_id": "of-nobody", "success": [True]}
    asked = {
        ("call", "report_outcome", json.dumps(report), "--namespace", "/nao1", "--wait", "30"):
            "of-nobody",
        ("save", "/silent", str(tmp_path), "--wait", "0.2"): "nothing came on /silent",
    }  # fmt: skip
    for arguments, message in asked.items():
        run = run_command("ros2", "dds", *arguments, "--domain", network)
        assert (run.returncode, message in run.stderr) == (3, True), run.stderr


@pytest.mark.slow
def test_a_cloud_of_a_topic_is_saved_as_it_was(network, robot, types, tmp_path):
    points = np.random.default_rng(1).normal(size=(6, 3)).astype("<f4")
    cloud = types.make(CLOUD)
    cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, 6, 12, 72
    cloud.fields = [types.make("sensor_msgs/PointField") for _ in range(3)]
    for k, field in enumerate(cloud.fields):
        field.name, field.offset, field.datatype, field.count = "xyz"[k], 4 * k, 7, 1
    cloud.data, cloud.is_dense = points.tobytes(), True
    publisher = robot.publisher("/camera/points", CLOUD)
    with running(
        command("dds", "save", "/camera/points", str(tmp_path), "--domain", network, "--json")
    ) as child:
        child.expect("ready /camera/points")
        pause = threading.Event()
        for _ in range(500):
            if publisher.subscribers:
                break
            pause.wait(0.02)
        publisher.publish(cloud)
        child.expect("[")
        assert child.finish() == 0
    np.testing.assert_array_equal(decode((tmp_path / "0000.pcd").read_bytes()).positions, points)


def test_requests_of_another_dds_are_refused_with_the_reason(caplog):
    pytest.importorskip("cyclonedds")
    from rtask.interop.ros.dds.node import is_of_cyclone

    def reader(vendor):
        key = SimpleNamespace(bytes=vendor + bytes(14))
        writer = SimpleNamespace(participant_key=key)
        return SimpleNamespace(get_matched_publication_data=lambda handle: writer)

    sample = SimpleNamespace(sample_info=SimpleNamespace(publication_handle=1))
    assert is_of_cyclone(reader(b"\x01\x10"), sample, "/s")
    assert not is_of_cyclone(reader(b"\x01\x0f"), sample, "/s")
    assert "services work only with Cyclone as the peer's RMW" in caplog.text
    gone = SimpleNamespace(get_matched_publication_data=lambda handle: None)
    assert not is_of_cyclone(gone, sample, "/s")
    assert "its sender is gone" in caplog.text


def test_a_caller_of_another_dds_is_named_once_before_any_request_of_it_is_read(caplog):
    pytest.importorskip("cyclonedds")
    from rtask.interop.ros.dds.node import CallerWatch

    vendors = {1: b"\x01\x10", 2: b"\x01\x0f"}

    def data(handle):
        if handle not in vendors:
            return None  # it has left in the meantime
        key = SimpleNamespace(bytes=vendors[handle] + bytes(14))
        return SimpleNamespace(participant_key=key)

    matched = []
    reader = SimpleNamespace(
        get_matched_publications=lambda: matched, get_matched_publication_data=data
    )
    watch = CallerWatch()
    watch.add(reader, "/s")
    watch.look()
    matched += [1, 3]
    watch.look()
    assert caplog.records == []
    matched.append(2)
    watch.look()
    watch.look()
    [warning] = caplog.records
    assert warning.message.startswith("/s: requests of a caller are refused, because services work")


@pytest.mark.slow
def test_the_doctor_hears_its_own_message(network):
    run = run_command("ros2", "doctor", "--domain", network, "--wait", "0.2")
    assert run.returncode == 0, run.stderr
    assert "a message was sent and heard" in run.stdout
