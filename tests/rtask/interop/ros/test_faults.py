"""Faults around the node: each is an error that says what and where."""

from __future__ import annotations

import time

import pytest

from rtask.interop.ros.find import use_ros
from rtask.interop.ros.master import Master
from tests.rtask.interop.ros.conftest import Robot, RosMaster, free_port, running
from tests.rtask.interop.ros.test_node import ABORTED, SUCCEEDED

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_without_a_master_the_node_ends_after_its_wait(start_node):
    uri = f"http://127.0.0.1:{free_port()}"
    child = start_node("ros", "node", "--server", "http://127.0.0.1:1", "--wait", "1",
                       ROS_MASTER_URI=uri)  # fmt: skip
    with running(child):
        child.expect(f"rtask: no ROS master answers at {uri}")
        assert child.finish() == 3


def test_a_name_that_is_taken_and_services_that_are_offered_are_refused(start_node, node):
    for options, words in (
        ((), "rtask: a node /rtask_node runs already, at http://"),
        (("--name", "other"), "rtask: service /rtask/"),
        (("--name", "rtask"), "rtask: a node called /rtask would mix"),
    ):
        with running(
            start_node("ros", "node", "--server", "http://127.0.0.1:1", *options)
        ) as child:
            child.expect(words)
            assert child.finish() == 2


def test_two_robots_share_a_master_in_namespaces_and_parameters_name_the_server(
    start_node, node, robot, ros_server
):
    child = start_node("ros", "node", "__ns:=/nao2", f"_url:={ros_server.url}", "--name", "graph")
    with running(child):
        child.expect(f"ready /nao2/graph for {ros_server.url}")
        assert "wanted" in robot.call("/nao2/rtask/resolve_request")
        assert child.end() == 0


def test_a_wrong_parameter_is_named(start_node, node):
    child = start_node("ros", "node", "__ns:=/nao3", "--server", "http://127.0.0.1:1",
                       "_table_height:=high")  # fmt: skip
    with running(child):
        child.expect("rtask: parameter /nao3/rtask_node/table_height: expected a float, got 'high'")
        assert child.finish() == 2


def test_a_server_that_is_gone_is_an_error_of_the_service_and_never_a_hang(start_node, robot):
    child = start_node("ros", "node", "__ns:=/lost", "--server", "http://127.0.0.1:1",
                       "--timeout", "1")  # fmt: skip
    with running(child):
        child.expect("ready")
        said = robot.call("/lost/rtask/resolve_request", wanted="cup")
        assert "ws://127.0.0.1:1/rosbridge cannot be reached" in said


@pytest.fixture
def own_master(tmp_path):
    master = RosMaster(tmp_path)
    master.start()
    yield master
    master.kill()


def test_a_master_that_comes_back_hears_of_the_node_again(own_master, start_node, ros_server):
    use_ros()
    child = start_node("ros", "node", "--server", ros_server.url, **own_master.environment)
    with running(child):
        child.expect("ready")
        robot = Robot(own_master)
        with running(robot.child):
            assert "wanted" in robot.call("/rtask/resolve_request")
            own_master.kill()
            own_master.start()
            deadline = time.monotonic() + 60.0  # it takes a second, and longer on a busy machine
            asking = Master(own_master.uri)
            while not (known := asking.ask("getSystemState"))[2] or "/rtask_node" not in str(known):
                assert time.monotonic() < deadline, known
                time.sleep(0.1)  # a master tells nobody of registrations of nodes
            services = {name for name, _ in asking.ask("getSystemState")[2]}
        robot = Robot(own_master)
        with running(robot.child):
            assert "wanted" in robot.call("/rtask/resolve_request")
            robot("listen", topic="/rtask/grasps", type="moveit_msgs/Grasp")
            assert robot("connect", topic="/rtask/grasps") is True
        assert any(name.startswith("/rtask/") for name in services)


def test_a_clock_that_nobody_publishes_is_named(own_master, start_node):
    Master(own_master.uri).ask("setParam", "/use_sim_time", True)
    child = start_node("ros", "node", "--server", "http://127.0.0.1:1", "--wait", "1",
                       **own_master.environment)  # fmt: skip
    with running(child):
        child.expect("rtask: /use_sim_time is set and nobody published /clock within 1 s")
        assert child.finish() == 3


def test_what_was_seen_before_time_jumped_back_is_forgotten(own_master, start_node, ros_server):
    Master(own_master.uri).ask("setParam", "/use_sim_time", True)
    robot = Robot(own_master)
    with running(robot.child):
        robot("tick", seconds=100.0)
        child = start_node("ros", "node", "--server", ros_server.url, "--gripper", "none",
                           "~points:=/camera/points", **own_master.environment)  # fmt: skip
        with running(child):
            child.expect("ready /rtask_node")
            robot("show", stamp=100.0, tf_stamp=100.0)
            assert robot("see", goal={}, since=100.0)["state"] == SUCCEEDED
            robot("tick", seconds=50.0)
            # Others print after it, such as a timer of rospy that the jump ends.
            assert "the time jumped back by 50.0 s" in child.expect("[WARN]")
            seen = robot("see", goal={})
            assert seen["state"] == ABORTED, seen["text"]
            assert "no cloud since" in seen["text"]
            # TF keeps ten seconds: the pose of second 50 would be refused beside that of 100.
            robot("show", stamp=50.0, tf_stamp=50.0)
            seen = robot("see", goal={}, since=50.0)
            assert seen["state"] == SUCCEEDED, seen["text"]


def test_a_node_whose_name_another_takes_ends_and_says_why(own_master, start_node, ros_server):
    child = start_node("ros", "node", "--server", ros_server.url, **own_master.environment)
    with running(child):
        child.expect("ready")
        thief = Master(own_master.uri, caller="/rtask_node")
        thief.ask("registerPublisher", "/x", "std_msgs/String", "http://127.0.0.1:9/")
        line = child.expect("rtask: ROS ended the node /rtask_node: ")
        assert "new node registered with same name" in line
        assert child.finish() == 3
