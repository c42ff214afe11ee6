"""The simulated Nao in ROS, driven by a robot's node as a real one would be.

Beside the tests of the node, because they share its master.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from features.codec.types import Cloud
from features.imaging.recordings import views_of
from grasp.spatial.frames import matrix_from_pose
from simulate.motion.collision import link_poses
from simulate.robots import describe
from tests.commands import run_command
from tests.rtask.interop.ros.conftest import running
from tests.rtask.interop.ros.test_node import ABORTED, HAND, PREEMPTED, SUCCEEDED

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[4]
NAO = describe("nao")
ARM = NAO.arm("right")
ACTION = "/right_arm_controller/follow_joint_trajectory"


@pytest.fixture(scope="module")
def body(start_node, node):
    child = start_node(
        "simulate", "ros", "--preset", "fast", "--objects", "2", "--frames-hz", "1", "--unpaced",
        "camera/depth_registered/points:=/camera/points",
    )  # fmt: skip
    with running(child):
        child.expect("ready /body: nao, 2 objects")
        yield child


def test_tf_gives_the_camera_as_the_joints_say(robot, body):
    told = robot("camera", frame="camera_depth_optical_frame")
    move, turn = told["pose"]["translation"], told["pose"]["rotation"]
    by_tf = matrix_from_pose(
        np.array([move[a] for a in "xyz"]), np.array([turn[a] for a in "xyzw"])
    )  # fmt: skip
    parent, optical = NAO.frames["camera_depth_optical_frame"]
    root_from_parent = link_poses(NAO.root, NAO.path(parent), told["joints"])[parent]
    by_joints = NAO.base_from_root.matrix @ root_from_parent @ optical.matrix
    # 64-bit numbers through a quaternion and back.
    np.testing.assert_allclose(by_tf, by_joints, atol=1e-9)


_TICKS = """
from types import SimpleNamespace
import numpy as np
from rtask.interop.ros.find import use_ros
use_ros()
import rospy
from simulate.robots import describe
from simulate.ros.rospy_front import RospyFront
from simulate.ros.sensors import Rates, Sensors

published = {}

class Publisher:
    def __init__(self, name, *unused, **options):
        self.messages = published.setdefault(name, [])
    def publish(self, message):
        self.messages.append(message)
    def get_num_connections(self):
        return 1

rospy.Publisher = Publisher
rospy.set_param = lambda name, value: None
Sensors._publish_frame = lambda self, stamp: frames.append(stamp)
frames, nao = [], describe("nao")
world = SimpleNamespace(time=0.0, client=SimpleNamespace(ER_TINY_RENDERER=0), place_boxes={})
joints = {joint.name: 0.0 for joint in nao.moving_joints()}
robot = SimpleNamespace(
    description=nao, world=world, joint_values=lambda: joints, world_from_base=np.eye(4)
)
sensors = Sensors(RospyFront(), robot, Rates(joints_hz=20.0, frames_hz=5.0), is_clock=True)
for step in range(100):
    world.time = 0.01 * step
    sensors.tick()
stamps = [str(one.transforms[0].header.stamp) for one in published["/tf"]]
print(len(frames), {str(stamp) for stamp in frames} <= set(stamps), len(stamps), len(set(stamps)))
"""


def test_each_transform_has_each_stamp_once_and_each_frame_has_its_own():
    run = subprocess.run(
        [sys.executable, "-c", _TICKS], capture_output=True, text=True, timeout=100, check=False
    )
    assert run.returncode == 0, run.stderr
    frames, has_transforms, sent, stamps = run.stdout.split()
    assert (int(frames) >= 4, has_transforms) == (True, "True")
    assert sent == stamps


def test_what_the_robot_sees_is_cut_and_asked_about(robot, body, node):
    now = robot("camera", frame="camera_depth_optical_frame")["time"]
    robot.call("/rtask/register_robot", name="sim", model="nao", end_effectors=[HAND])
    seen = robot("see", goal={"gripper_id": "hand"}, since=now)
    assert seen["state"] == SUCCEEDED, seen["text"]
    assert seen["result"]["status"] == "ok"
    assert len(seen["result"]["objects"]) >= 1
    frames = {one["header"]["frame_id"] for one in seen["result"]["objects"]}
    assert frames == {"base_footprint"}


KEPT = {
    "/camera/points": "sensor_msgs/PointCloud2",
    "/camera/rgb/image_raw/compressed": "sensor_msgs/CompressedImage",
    "/camera/rgb/camera_info": "sensor_msgs/CameraInfo",
}


def test_the_camera_has_the_topics_of_the_thesis(robot, body):
    space = "/CameraDepth3_frame"
    topics = {
        f"{space}/rgb/image_raw": "Image",
        f"{space}/depth/image_raw": "Image",
        f"{space}/depth/points": "PointCloud2",
        f"{space}/rgb/camera_info": "CameraInfo",
        f"{space}/depth/camera_info": "CameraInfo",
    }
    for topic, kind in topics.items():
        robot("listen", topic=topic, type=f"sensor_msgs/{kind}")
    heard = {topic: robot("hear", topic=topic) for topic in topics}
    for topic, message in heard.items():
        assert message["header"]["frame_id"] == "camera_depth_optical_frame", topic
        assert (message["height"], message["width"]) == (480, 640), topic
    assert heard[f"{space}/rgb/image_raw"]["encoding"] == "rgb8"
    assert heard[f"{space}/depth/image_raw"]["encoding"] == "32FC1"
    assert heard[f"{space}/depth/camera_info"]["K"][0] == pytest.approx(467.74, abs=0.01)


def record(bag, roscore):
    """Record the kept topics for some seconds with ROS's own program."""
    done = subprocess.run(
        ["/usr/bin/python3", "/usr/bin/rosbag", "record", "-O", str(bag), "--duration=5", *KEPT],
        env=roscore.environment, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert bag.is_file(), done.stderr


def both(topic, bag, heard):
    """Return how many messages of a topic are in the bag and were heard by a node as well."""
    with AnyReader([bag]) as reader:
        # rospy numbers a latched message anew for each subscriber; the number comes first.
        mine = {bytes(raw)[4:] for c, _, raw in reader.messages() if c.topic == topic}
    wire = {file.read_bytes()[4:] for file in heard.glob(f"{list(KEPT).index(topic)}-*.msg")}
    return len(wire & mine)


def test_what_rosbag_records_is_read_back_bit_by_bit(robot, body, roscore, tmp_path):
    heard = tmp_path / "heard"
    heard.mkdir()
    robot("keep", folder=str(heard), topics=KEPT)
    # On a busy machine each subscriber loses messages of its own: record until they share one.
    for number in range(6):
        bag = tmp_path / f"out-{number}.bag"
        record(bag, roscore)
        shared = [both(topic, bag, heard) for topic in KEPT]
        if all(shared):
            break
    assert all(shared), dict(zip(KEPT, shared, strict=True))
    found = [seen for seen in views_of(bag) if isinstance(seen, Cloud)]
    with AnyReader([bag]) as reader:
        clouds = [
            reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()
            if c.topic == "/camera/points"
        ]  # fmt: skip
    # Other nodes of this master may show theirs on the topic too.
    assert (480, 640) in [seen.shape for seen in found]
    for seen, cloud in zip(found, clouds, strict=True):
        assert seen.shape == (cloud.height, cloud.width)
        xyz = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_step // 4)[:, :3]
        whole = np.isfinite(xyz).all(axis=1)
        np.testing.assert_array_equal(seen.positions, xyz[whole])
        if "rgb" not in [one.name for one in cloud.fields]:
            assert seen.colours is None
            continue
        colour = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_step)[whole, 12:15]
        np.testing.assert_array_equal(seen.colours, colour[:, ::-1])


def goal_of(home, offset):
    return [value + offset * (k == 1) for k, value in enumerate(home)]


def test_an_arm_follows_a_trajectory_in_any_order_of_its_joints(robot, body):
    names, wanted = list(ARM.joints)[::-1], goal_of(ARM.home, 0.2)[::-1]
    done = robot("follow", action=ACTION, names=names, positions=wanted, seconds=1.0, cancel=False)
    assert (done["state"], done["code"]) == (SUCCEEDED, 0), done
    assert done["feedback"] >= 5
    joints = robot("camera", frame="camera_depth_optical_frame")["joints"]
    assert abs(joints[ARM.joints[1]] - (ARM.home[1] + 0.2)) < 0.05


def test_goals_that_cannot_be_followed_are_aborted_with_their_code(robot, body):
    def follow(**changed):
        given = {"names": list(ARM.joints), "positions": list(ARM.home), "seconds": 1.0}
        return robot("follow", action=ACTION, cancel=False, **{**given, **changed})

    wrong = follow(names=["elbow"], positions=[0.0])
    assert (wrong["state"], wrong["code"]) == (ABORTED, -2)
    assert "joints elbow: expected RShoulderPitch" in wrong["words"]
    far = follow(seconds=0.0, positions=goal_of(ARM.home, 1.0))
    assert (far["state"], far["code"]) == (ABORTED, -1)
    assert "rad from the measured pose" in far["words"]
    beyond = follow(positions=goal_of(ARM.home, -3.0), seconds=0.5)
    assert (beyond["state"], beyond["code"]) == (ABORTED, -5)
    assert "RShoulderRoll ended" in beyond["words"]


def test_a_cancelled_goal_stops_the_arm(robot, body):
    wanted = goal_of(ARM.home, 0.2)
    done = robot("follow", action=ACTION, names=list(ARM.joints), positions=wanted, seconds=60.0,
                 cancel=True)  # fmt: skip
    assert done["state"] == PREEMPTED
    assert done["feedback"] < 500


def test_the_act_service_reaches_and_keeps_the_arm_until_home(robot, body):
    reached = robot("act", action="reach", position=[0.15, -0.10, 0.305])
    assert (reached["success"], reached["reason"], reached["arm"]) == (1, "ok", "right_arm")
    refused = robot("follow", action=ACTION, names=list(ARM.joints), positions=list(ARM.home),
                    seconds=1.0, cancel=False)  # fmt: skip
    assert (refused["state"], refused["code"]) == (ABORTED, -1)
    assert "the act service has the arm" in refused["words"]
    home = robot("act", action="home", position=[])
    assert home["reason"] == "ok"
    said = robot("act", action="dance", position=[])
    assert "action_type: unknown value 'dance'" in said


def test_a_planned_motion_is_executed_by_a_driver_and_back(robot, body, roscore, start_node):
    assert robot("act", action="home", position=[])["reason"] == "ok"
    home = robot("follow", action=ACTION, names=list(ARM.joints), positions=list(ARM.home),
                 seconds=1.0, cancel=False)  # fmt: skip
    assert home["state"] == SUCCEEDED, home
    reach = ("simulate", "ros-reach", "--json", "--back", "--", "0.15", "-0.10", "0.305")
    done = run_command(*reach, environment=roscore.environment, folder=ROOT)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["arm"], told["is_home"]) == ("right_arm", True)
    assert told["seconds"] > 0
    away = goal_of(ARM.home, 0.2)
    robot(
        "follow", action=ACTION, names=list(ARM.joints), positions=away, seconds=1.0, cancel=False
    )
    with running(start_node(*reach)) as child:
        child.expect("rtask: RShoulderRoll is 0.2")
        assert child.finish() == 3
