"""A robot's own node: calls services, listens, publishes clouds, sends goals, as it is told.

Reads one JSON object from each line of standard input, and answers on standard output.
"""

from __future__ import annotations

import importlib
import io
import json
import sys
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.engine.operations.table import OPERATIONS
from rtask.interop.ros.convert import fill, make_message, mapping_of
from rtask.interop.ros.declared import declared_schema
from rtask.interop.ros.find import use_ros
from rtask.interop.ros.package import load_messages
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, view

WAIT_S = 60.0
load_messages(declared_schema(OPERATIONS.values()), use_ros())

# Importable from here on only, which is the reason of each E402 below.
import actionlib  # noqa: E402
import rospy  # noqa: E402
import tf2_msgs.msg  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2  # noqa: E402

from rtask.interop.ros.clouds import cloud_message  # noqa: E402


def class_of(type_: str, kind: str = "msg") -> Any:
    package, _, name = type_.partition("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


class Robot:
    """Robot that obeys one command a method."""

    def __init__(self) -> None:
        self.heard: dict[str, list[Any]] = {}
        self.came = threading.Condition()
        self.topics: dict[str, Any] = {}
        self.see_clients: dict[str, Any] = {}
        self.clouds = rospy.Publisher("/camera/points", PointCloud2, queue_size=1, latch=True)
        self.tf = rospy.Publisher("/tf", tf2_msgs.msg.TFMessage, queue_size=10, latch=True)

    def call(self, service: str, fields: dict[str, Any]) -> Any:
        name = service.rpartition("/")[2]
        kind = "SegmentCloud" if name == "segment" else "".join(
            part.capitalize() for part in name.split("_")
        )  # fmt: skip
        kind = class_of(f"rtask_msgs/{kind}", "srv")
        try:
            rospy.wait_for_service(service, WAIT_S)
            request = filled(kind._request_class(), fields)
            return plain(rospy.ServiceProxy(service, kind)(request))
        except (rospy.ServiceException, rospy.ROSException) as error:
            return str(error)

    def listen(self, topic: str, type: str) -> Any:
        def take(message: Any) -> None:
            with self.came:
                self.heard[topic].append(message)
                self.came.notify_all()

        self.heard[topic] = []
        self.topics[topic] = rospy.Subscriber(topic, class_of(type), take)
        return None

    def hear(self, topic: str, count: int = 1, wait_s: float = WAIT_S) -> Any:
        """Return the newest message when so many have come; None if they did not."""
        with self.came:
            if not self.came.wait_for(lambda: len(self.heard[topic]) >= count, wait_s):
                return None
            return plain(self.heard[topic][-1])

    def keep(self, folder: str, topics: dict[str, str]) -> Any:
        """Write each message of some topics to a file as it came over the wire, until the end."""
        for number, (topic, type_) in enumerate(topics.items()):

            def take(message: Any, number: int = number) -> None:
                name = f"{number}-{message.header.seq}-{message.header.stamp.to_nsec()}.msg"
                message.serialize(kept := io.BytesIO())
                Path(folder, name).write_bytes(kept.getvalue())

            self.topics[topic] = rospy.Subscriber(topic, class_of(type_), take)
        return None

    def connect(self, topic: str) -> Any:
        """Wait for a publisher of a topic that is listened to."""
        for _ in range(int(WAIT_S * 20)):
            if self.topics[topic].get_num_connections():
                return True
            rospy.rostime.wallsleep(0.05)
        return False

    def show(self, stamp: float, tf_stamp: float | None = None, colour: bool = True) -> Any:
        """Publish the view, and where the camera is, at their times."""
        if tf_stamp is not None:
            self.tf.publish(tf2_msgs.msg.TFMessage([transform(tf_stamp)]))
            rospy.rostime.wallsleep(0.5)  # nothing tells when the node has it
        frame = view()
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = rospy.Time.from_sec(stamp), frame.frame_id
        rgb = frame.rgb if colour else None
        self.clouds.publish(cloud_message(frame.points(), rgb, header))
        return None

    def photograph(
        self, depth_stamp: float, image_stamp: float, tf_stamp: float, compressed: bool = False
    ) -> Any:
        """Publish the view as depth, in mm, with a colour image and the camera beside it."""
        self.tf.publish(tf2_msgs.msg.TFMessage([transform(tf_stamp)]))
        rospy.rostime.wallsleep(0.5)  # nothing tells when the node has it
        frame = view()
        assert frame.rgb is not None
        depth = np.rint(frame.depth_m * 1000).astype("<u2")
        lens = frame.intrinsics
        info = CameraInfo(width=lens.width, height=lens.height)
        info.K = [lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0]
        images: list[Any] = [image_of(depth, "16UC1"), image_of(frame.rgb, "rgb8")]
        if compressed:
            picture = cv2.imencode(".png", np.ascontiguousarray(frame.rgb[..., ::-1]))[1]
            images[1] = CompressedImage(format="png", data=picture.tobytes())
        for one, topic, stamp in zip(
            (info, *images),
            ("/camera/info", "/camera/depth", "/camera/packed" if compressed else "/camera/image"),
            (depth_stamp, depth_stamp, image_stamp),
            strict=True,
        ):
            one.header.stamp, one.header.frame_id = rospy.Time.from_sec(stamp), frame.frame_id
            if topic not in self.topics:
                self.topics[topic] = rospy.Publisher(topic, type(one), queue_size=1, latch=True)
            self.topics[topic].publish(one)
        return None

    def segment(self, stamp: float, tf_stamp: float, node: str = "") -> Any:
        """Call the service that cuts the view; return its answer without the points."""
        self.tf.publish(tf2_msgs.msg.TFMessage([transform(tf_stamp)]))
        rospy.rostime.wallsleep(0.5)
        frame = view()
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = rospy.Time.from_sec(stamp), frame.frame_id
        kind = class_of("rtask_msgs/SegmentCloud", "srv")
        cloud = cloud_message(frame.points(), frame.rgb, header)
        found = rospy.ServiceProxy(f"{node}/rtask/segment", kind)(cloud)
        sizes = [one.cloud.width for one in found.segments]
        poses = [mapping_of(one.pose)["position"] for one in found.segments]
        return {"status": found.status, "points": sizes, "positions": poses,
                "table": found.table_height, "frame": found.header.frame_id}  # fmt: skip

    def search(self, stamp: float) -> Any:
        """Search for the whole view, sent as a PointCloud2."""
        frame = view()
        header = make_message("std_msgs/Header")
        header.stamp, header.frame_id = rospy.Time.from_sec(stamp), frame.frame_id
        kind = class_of("rtask_msgs/SearchObject", "srv")
        request = kind._request_class()
        request.data_cloud = [cloud_message(frame.points(), frame.rgb, header)]
        return plain(rospy.ServiceProxy("/rtask/search_object", kind)(request))

    def see(
        self, goal: dict[str, Any], since: float = 0.0, cancel: bool = False, node: str = ""
    ) -> Any:
        """Send a goal for a view since a time; perhaps cancel it at its first feedback."""
        if node not in self.see_clients:
            made = actionlib.SimpleActionClient(
                f"{node}/rtask/see", class_of("rtask_msgs/SeeAction")
            )
            assert made.wait_for_server(rospy.Duration(WAIT_S))
            self.see_clients[node] = made
        client = self.see_clients[node]
        told: list[Any] = []

        def feedback(one: Any) -> None:
            told.append(one.number)
            if cancel:
                client.cancel_goal()

        message = filled(make_message("rtask_msgs/SeeGoal"), goal)
        message.header.stamp = rospy.Time.from_sec(since)
        client.send_goal(message, feedback_cb=feedback)
        done = client.wait_for_result(rospy.Duration(60))
        result = client.get_result()
        return {
            "done": done,
            "state": client.get_state(),
            "feedback": told,
            "text": client.get_goal_status_text(),
            "result": plain(result),
        }

    def see_newer(self, goal: dict[str, Any], since: float, newer_since: float) -> Any:
        """Send a goal, and another while it is under way; return the states of both."""
        clients = []
        for first in (since, newer_since):
            client = actionlib.SimpleActionClient("/rtask/see", class_of("rtask_msgs/SeeAction"))
            assert client.wait_for_server(rospy.Duration(WAIT_S))
            message = filled(make_message("rtask_msgs/SeeGoal"), goal)
            message.header.stamp = rospy.Time.from_sec(first)
            client.send_goal(message)
            clients.append(client)
            for _ in range(int(WAIT_S * 20)):
                if client.get_state() != actionlib.GoalStatus.PENDING:
                    break
                rospy.rostime.wallsleep(0.05)
        assert all(client.wait_for_result(rospy.Duration(60)) for client in clients)
        return [client.get_state() for client in clients]

    def place(self, link: str, position: list[float]) -> Any:
        """Publish where a link of the robot is, for all times; what was placed before stays."""
        made = TransformStamped(child_frame_id=link)
        made.header.frame_id, made.transform.rotation.w = "base_footprint", 1.0
        where = made.transform.translation
        where.x, where.y, where.z = position
        if "static" not in self.topics:
            kind = tf2_msgs.msg.TFMessage
            self.topics["static"] = rospy.Publisher("/tf_static", kind, queue_size=1, latch=True)
        self.topics["static"].publish(tf2_msgs.msg.TFMessage([made]))
        return None

    def move_group(self, scene: dict[str, Any]) -> Any:
        """Offer a planning scene, as MoveIt does; an empty one ends the offer."""
        if "moveit" in self.topics:
            self.topics.pop("moveit").shutdown()
        if scene:
            kind = class_of("moveit_msgs/GetPlanningScene", "srv")
            made = filled(make_message("moveit_msgs/PlanningScene"), scene)
            answer = kind._response_class(scene=made)
            self.topics["moveit"] = rospy.Service("/get_planning_scene", kind, lambda asked: answer)
        return None

    def sample(self, name: str, node: str = "") -> Any:
        """Ask for grasps as a stage of the MoveIt Task Constructor does."""
        action = f"{node}/rtask/sample_grasp_poses"
        client = actionlib.SimpleActionClient(action, class_of("rtask_msgs/SampleGraspPosesAction"))
        assert client.wait_for_server(rospy.Duration(WAIT_S))
        told: list[Any] = []
        goal = make_message("rtask_msgs/SampleGraspPosesGoal")
        goal.action_name = name
        client.send_goal(goal, feedback_cb=told.append)
        client.wait_for_result(rospy.Duration(60))
        result = client.get_result()
        return {
            "state": client.get_state(),
            "grasp_state": result.grasp_state,
            "feedback": [plain(each) for each in told],
        }

    def follow(
        self, action: str, names: list[str], positions: list[float], seconds: float, cancel: bool
    ) -> Any:
        """Have an arm follow a trajectory of one point; perhaps cancel it at its feedback."""
        client = actionlib.SimpleActionClient(
            action, class_of("control_msgs/FollowJointTrajectoryAction")
        )
        assert client.wait_for_server(rospy.Duration(WAIT_S))
        told: list[Any] = []

        def feedback(one: Any) -> None:
            told.append(one)
            if cancel and len(told) == 2:
                client.cancel_goal()

        goal = make_message("control_msgs/FollowJointTrajectoryGoal")
        point = make_message("trajectory_msgs/JointTrajectoryPoint")
        point.positions, point.time_from_start = positions, rospy.Duration.from_sec(seconds)
        goal.trajectory.joint_names, goal.trajectory.points = names, [point]
        client.send_goal(goal, feedback_cb=feedback)
        client.wait_for_result(rospy.Duration(60))
        result = client.get_result()
        return {
            "state": client.get_state(),
            "feedback": len(told),
            "code": result.error_code,
            "words": result.error_string,
        }

    def act(self, action: str, position: list[float]) -> Any:
        """Call the act service with a goal pose over the table."""
        kind = class_of("rtask_msgs/Act", "srv")
        request = kind._request_class(action_type=action)
        if position:
            pose = make_message("geometry_msgs/Pose")
            pose.position.x, pose.position.y, pose.position.z = position
            pose.orientation.w = 1.0
            request.goal_pose = [pose]
        try:
            rospy.wait_for_service("/act", WAIT_S)
            return plain(rospy.ServiceProxy("/act", kind)(request))
        except rospy.ServiceException as error:
            return str(error)

    def camera(self, frame: str) -> Any:
        """Return the pose of a camera by TF at the time of the joints, and the joints."""
        import tf2_ros

        buffer = tf2_ros.Buffer()
        kept = tf2_ros.TransformListener(buffer)
        kind = class_of("sensor_msgs/JointState")
        for _ in range(int(WAIT_S * 20)):
            state = rospy.wait_for_message("/joint_states", kind, WAIT_S)
            rospy.rostime.wallsleep(0.05)  # nothing tells when TF is as far
            if buffer.can_transform("base_footprint", frame, state.header.stamp):
                break
        found = buffer.lookup_transform("base_footprint", frame, state.header.stamp)
        kept.unregister()
        return {
            "pose": mapping_of(found.transform),
            "time": rospy.Time.now().to_sec(),
            "joints": dict(zip(state.name, state.position, strict=True)),
        }

    def tick(self, seconds: float) -> Any:
        self.topics.setdefault("clock", rospy.Publisher("/clock", Clock, queue_size=1, latch=True))
        self.topics["clock"].publish(Clock(rospy.Time.from_sec(seconds)))
        return None


def image_of(pixels: NDArray[Any], encoding: str) -> Any:
    """Return a sensor_msgs/Image."""
    height, width = pixels.shape[:2]
    step = pixels[0].nbytes
    return Image(height=height, width=width, encoding=encoding, step=step, data=pixels.tobytes())


def filled(message: Any, fields: dict[str, Any]) -> Any:
    """Fill in a message from JSON; text in a field of bytes is hexadecimal."""
    for name, type_ in zip(message.__slots__, message._slot_types, strict=True):
        if name not in fields:
            continue
        base, is_list, _ = type_.partition("[")
        value = fields[name]
        if base == "uint8" and is_list:
            setattr(message, name, bytes.fromhex(value))
        elif "/" in base and is_list:
            setattr(message, name, [filled(make_message(base), one) for one in value])
        else:
            fill(message, {name: value}, make_message)
    return message


def plain(message: Any) -> Any:
    return json.loads(json.dumps(mapping_of(message), default=str).replace("NaN", "null"))


def transform(stamp: float) -> Any:
    from grasp.messages import pose_message

    made = TransformStamped()
    made.header.stamp, made.header.frame_id = rospy.Time.from_sec(stamp), "base_footprint"
    made.child_frame_id = "camera_optical"
    pose = pose_message(np.asarray(BASE_FROM_CAMERA))
    fill(made.transform.translation, pose["position"], make_message)
    fill(made.transform.rotation, pose["orientation"], make_message)
    return made


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> None:
    rospy.init_node("robot", argv=["robot"], disable_signals=True)
    robot = Robot()
    say("robot ready")
    for line in sys.stdin:
        told = json.loads(line)
        answer = getattr(robot, told.pop("do"))(**told)
        say("answer " + json.dumps(answer))
    rospy.signal_shutdown("told all")


if __name__ == "__main__":
    main()
