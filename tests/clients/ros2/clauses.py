"""Clauses on the operations, on views and on the states of the node."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import queue
import subprocess
import threading

import numpy as np

from tests.clients.ros2 import without_ros
from tests.clients.ros2.programs import NAMESPACE, ROOT, WAIT_S, Program
from tests.clients.ros2.registry import ABORTED, CANCELED, HAND, SUCCEEDED, clause
from tests.clients.ros2.robot import latched, sensor, set_fields
from tests.clients.ros2.views import keep_publishing, show, since, time_fields

SIGNATURES = ROOT / "tests/rtask/ros2/rclpy_signatures.txt"


@clause("the methods of rclpy that the node calls take what it passes")
def _(shell):
    import importlib
    import inspect

    for line in SIGNATURES.read_text("utf-8").splitlines():
        module, _, rest = line.partition(" ")
        name, _, names = rest.partition("(")
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        own = list(inspect.signature(found).parameters)
        lacking = [n for n in names.rstrip(")").split(", ") if n and n not in own]
        assert not lacking or "kwargs" in own, f"{line}: {own}"


@clause("the node starts by one command in a namespace and with remaps, and is in the graph")
def _(shell):
    shell.node = shell.start_node("--gripper", "hand", "--outbox", str(shell.folder / "outbox"),
                                  ros=("-p", "table_height:=0.27"))  # fmt: skip
    shell.wait_for(
        lambda: ("rtask_node", NAMESPACE) in shell.robot.node.get_node_names_and_namespaces(),
        "rtask_node in the graph",
    )


@clause("every operation is a service of its type")
def _(shell):
    contract = json.loads(shell.contract)
    expected = {
        f"{NAMESPACE}/rtask/{name}": [f"rtask_msgs/srv/{service['name']}"]
        for name, service in contract["schema"]["services"].items()
    }
    own = shell.robot.node

    def offered():
        return dict(own.get_service_names_and_types_by_node("rtask_node", NAMESPACE))

    shell.wait_for(lambda: expected.items() <= offered().items(), "services of all operations")
    return f"{len(expected)} services"


@clause("an operation is answered")
def _(shell):
    answer = shell.robot.operation(
        "register_robot", name="nao-1", model="nao", end_effectors=[HAND]
    )
    assert (answer.refused, answer.robot.rpartition("/")[2]) == ("", "nao-1")
    shell.gripper = f"{answer.robot}/hand"


@clause("what was refused is answered with its reason on one line")
def _(shell):
    answer = shell.robot.operation("report_outcome")
    assert "missing" in answer.refused, answer.refused
    assert "\n" not in answer.refused


@clause("two values in a field for at most one are refused by the node itself")
def _(shell):
    answer = shell.robot.operation("report_outcome", success=[True, False])
    assert "success: 2 values; expected one" in answer.refused, answer.refused


@clause("commits are messages while somebody subscribes")
def _(shell):
    from rtask_msgs.msg import Change

    heard = shell.robot.hear(f"{NAMESPACE}/rtask/changes", Change, 100)
    for number in range(60):  # until the node follows
        shell.robot.operation("register_robot", name=f"r-{number}", model="m", end_effectors=[HAND])
        with contextlib.suppress(queue.Empty):
            change = heard.get(timeout=0.5)
            break
    assert change.commit > 0
    assert change.added > 0
    assert change.graphs[0].rpartition("/")[2].startswith("r-")


@clause("a goal without a view is aborted, and names the topics after remapping")
def _(shell):
    status, result, _ = shell.robot.see()
    assert status == ABORTED, status
    assert "on /camera/points within 5 s: nobody publishes it" in result.refused, result.refused


@clause("rtask/see recognises what was taught, with feedback for each object")
def _(shell):
    cloud = {"sensor_pose": shell.view.pose}
    message = shell.view.cloud(100.0)
    cloud["cloud"] = {
        "height": message.height, "width": message.width, "point_step": message.point_step,
        "row_step": message.row_step, "is_bigendian": False, "is_dense": True,
        "fields": [{"name": f.name, "offset": f.offset, "datatype": f.datatype, "count": f.count}
                   for f in message.fields],
        "data": base64.b64encode(bytes(message.data)).decode(),
    }  # fmt: skip
    crops = [entry["cloud"] for entry in shell.perceive(cloud)["objects"]]
    assert len(crops) == 2
    for name, crop in zip(("soap", "tea"), crops, strict=True):
        stored = shell.robot.operation("insert_object", objects=[{
            "data": base64.b64decode(crop), "name": name, "gripper_id": shell.gripper,
            "class_description": "box", "task_id": f"task-{name}"}])  # fmt: skip
        assert (stored.refused, stored.stored) == ("", 1), stored.refused
    show(shell, 100.0)
    status, result, numbers = shell.robot.see_again(
        header=since(100.0), gripper_id=shell.gripper, propose=True
    )
    assert (status, result.refused, result.status) == (SUCCEEDED, "", "ok"), result
    shell.seen = result
    answered = [(entry.name, entry.error) for entry in result.objects]
    assert sorted(answered) == [("soap", ""), ("tea", "")], answered
    assert {entry.header.stamp.sec for entry in result.objects} == {100}
    assert {entry.header.frame_id for entry in result.objects} == {"base_footprint"}
    assert all(abs(entry.pose.position.z - 0.30) < 0.02 for entry in result.objects)
    assert numbers in ([1], [2], [1, 2]), numbers


@clause("the best grasp is latched: a late subscriber hears it")
def _(shell):
    from moveit_msgs.msg import Grasp

    grasp = shell.robot.hear(f"{NAMESPACE}/rtask/grasps", Grasp, latched()).get(timeout=WAIT_S)
    assert grasp.grasp_pose.header.frame_id == "base_footprint"
    assert grasp.id in {g.id for entry in shell.seen.objects for g in entry.grasps}


@clause("markers are latched: a box and a name for each object")
def _(shell):
    from visualization_msgs.msg import Marker, MarkerArray

    shown = shell.robot.hear(f"{NAMESPACE}/rtask/objects", MarkerArray, latched())
    markers = shown.get(timeout=WAIT_S).markers
    assert [m.action for m in markers] == [Marker.DELETEALL, *[Marker.ADD] * 4]
    assert {m.text.partition(" ")[0] for m in markers if m.text} == {"soap", "tea"}


@clause("the planning scene is latched: the table, and each object by its IRI")
def _(shell):
    from moveit_msgs.msg import PlanningScene

    heard = shell.robot.hear(f"{NAMESPACE}/rtask/planning_scene", PlanningScene, latched())
    scene = heard.get(timeout=WAIT_S)
    boxes = {box.id: box for box in scene.world.collision_objects}
    assert scene.is_diff
    assert set(boxes) == {*(entry.object for entry in shell.seen.objects), "rtask/table"}
    for entry in shell.seen.objects:
        size = [entry.size.x, entry.size.y, entry.size.z]
        assert list(boxes[entry.object].primitives[0].dimensions) == size


@clause("a cancelled goal ends as cancelled at its first feedback")
def _(shell):
    show(shell, 101.0)
    assert shell.robot.see_again(header=since(101.0), gripper_id=shell.gripper)[0] == SUCCEEDED
    status, _, numbers = shell.robot.see(header=since(101.0), gripper_id=shell.gripper, cancel_at=1)
    assert status == CANCELED, status
    assert numbers[0] == 1


@clause("a newer goal ends its predecessor")
def _(shell):
    statuses = []

    def newer(handle):
        statuses.append(shell.robot.see(header=since(101.0), gripper_id=shell.gripper)[0])

    status, *_ = shell.robot.see(header=since(500.0), settle=newer)
    assert (statuses, status) == ([SUCCEEDED], ABORTED)


@clause("the pose of the camera is that of the view's stamp, never of another time")
def _(shell):
    show(shell, 200.0, tf_stamp=150.0)
    status, result, _ = shell.robot.see(header=since(200.0), gripper_id=shell.gripper)
    assert status == ABORTED, status
    words = "no transform from camera_optical to base_footprint at 200.000 s"
    assert words in result.refused, result.refused


@clause("depth with colour and camera info stand for a cloud; a latched camera info is heard")
def _(shell):
    depth, image, info = shell.view.images(210.0)
    shell.robot.publish("/camera/camera_info", info, latched())
    transform = shell.view.transform(210.0)
    keep_publishing(
        shell, ("/tf", transform, 100), ("/camera/image", image, sensor()),
        ("/camera/depth", depth, sensor()),
    )  # fmt: skip
    status, result, _ = shell.robot.see_again(header=since(210.0), gripper_id=shell.gripper)
    assert status == SUCCEEDED, result.refused
    assert sorted(entry.name for entry in result.objects) == ["soap", "tea"]


@clause("a publisher of clouds may be reliable as well as best effort")
def _(shell):
    shell.end_camera()
    shell.robot.forget_publishers("/camera/points")
    show(shell, 220.0, reliable=True)
    status, result, _ = shell.robot.see_again(header=since(220.0), gripper_id=shell.gripper)
    assert status == SUCCEEDED, result.refused


@clause("rtask/segment cuts a cloud into the clouds of its objects")
def _(shell):
    from rtask_msgs.srv import SegmentCloud

    cloud = shell.view.cloud(220.0)
    answer = shell.robot.call(
        "rtask/segment", SegmentCloud, lambda request: setattr(request, "cloud", cloud)
    )
    assert (answer.refused, answer.status, len(answer.segments)) == ("", "ok", 2)
    assert abs(answer.table_height - 0.27) < 0.005
    assert min(segment.cloud.width for segment in answer.segments) > 500
    cloud.header.stamp.sec = 900
    answer = shell.robot.call(
        "rtask/segment", SegmentCloud, lambda request: setattr(request, "cloud", cloud)
    )
    assert "no transform" in answer.refused


@clause("what robot_description and TF say to be the robot is no object")
def _(shell):
    from geometry_msgs.msg import TransformStamped
    from rtask_msgs.srv import SegmentCloud
    from std_msgs.msg import String
    from tf2_msgs.msg import TFMessage

    cloud, place = shell.view.cloud(220.0), {"x": 0.27, "y": 0.09, "z": 0.31}
    made = TransformStamped(child_frame_id="bin")
    made.header.frame_id = "base_footprint"
    set_fields(made.transform.translation, place)
    shell.robot.publish("/tf_static", TFMessage(transforms=[made]), latched())

    def count(model):
        shell.robot.publish(f"{NAMESPACE}/robot_description", String(data=model), latched())
        answer = shell.robot.call(
            "rtask/segment", SegmentCloud, lambda request: setattr(request, "cloud", cloud)
        )
        assert (answer.refused, answer.status) == ("", "ok")
        return len(answer.segments)

    box = "<geometry><box size='0.05 0.07 0.08'/></geometry>"
    part = f"<link name='bin'><collision>{box}</collision></link>"
    # Services and topics are not in one order: the model may come after the cloud.
    shell.wait_for(lambda: count(f"<robot name='r'>{part}</robot>") == 1, "one object")
    shell.wait_for(lambda: count("<robot name='r'/>") == 2, "two objects")
    mesh = f"<mesh filename='file://{write_box(shell.folder)}' scale='0.001 0.001 0.001'/>"
    part = part.replace("<box size='0.05 0.07 0.08'/>", mesh)
    shell.wait_for(lambda: count(f"<robot name='r'>{part}</robot>") == 1, "one beside a mesh")
    shell.wait_for(lambda: count("<robot name='r'/>") == 2, "two objects again")


def write_box(folder):
    """Write the first box of the view as a mesh, mm; return its file."""
    corners = np.array(list(itertools.product((-25, 25), (-35, 35), (-40, 40))), dtype="<f4")
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    table = np.zeros(len(faces), kind)
    table["corners"] = corners[np.array(faces)]
    file = folder / "box.stl"
    file.write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + table.tobytes())
    return file


@clause("parameters are declared with their meaning; the token is none of them")
def _(shell):
    from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters

    node = f"{NAMESPACE}/rtask_node"
    names = shell.robot.call(f"{node}/list_parameters", ListParameters).result.names
    assert {"url", "frame", "gripper_id", "table_height", "min_confidence"} <= set(names)
    assert not [name for name in names if "token" in name]

    def ask(request):
        request.names = ["table_height"]

    values = shell.robot.call(f"{node}/get_parameters", GetParameters, ask).values
    assert values[0].double_value == 0.27
    described = shell.robot.call(f"{node}/describe_parameters", DescribeParameters, ask)
    assert "m; NaN: as seen" in described.descriptors[0].description


@clause("lifecycle: inactive it refuses, active again it answers")
def _(shell):
    from lifecycle_msgs.srv import ChangeState, GetState

    node = f"{NAMESPACE}/rtask_node"

    def go(transition):
        answer = shell.robot.call(
            f"{node}/change_state", ChangeState,
            lambda request: setattr(request.transition, "id", transition),
        )  # fmt: skip
        return answer.success, shell.robot.call(f"{node}/get_state", GetState).current_state.label

    assert go(4) == (True, "inactive")
    assert shell.robot.operation("where_is", name="soap").refused == "the node is not active"
    assert go(2) == (True, "unconfigured")
    assert go(1) == (True, "inactive")
    assert go(3) == (True, "active")
    answer = shell.robot.operation("recall_grasps", object=shell.seen.objects[0].object)
    assert answer.refused == ""


@clause("another node with the same services refuses to start, or says so in its log")
def _(shell):
    second = Program([
        *shell.options.node.split(), "--server", shell.url, "--name", "second",
        "--ros-args", "-r", f"__ns:={NAMESPACE}",
    ])  # fmt: skip
    words = f"service {NAMESPACE}/rtask/where_is is offered by another node"
    if second.expect(rf"(Error: )?{words}")[1]:
        assert second.process.wait(60) == 2
        return ""
    second.end()
    return "discovered after its 2 s, on a busy machine: said in its log"


@clause("with use_sim_time it waits for /clock, and says so when none comes")
def _(shell):
    silent = Program([
        *shell.options.node.split(), "--server", shell.url, "--wait", "1", "--ros-args",
        "-r", "__ns:=/sim", "-p", "use_sim_time:=true",
    ])  # fmt: skip
    silent.expect("Error: use_sim_time is set and nobody published /clock within 1 s")
    assert silent.process.wait(60) == 3
    from rosgraph_msgs.msg import Clock

    ended = threading.Event()
    clock = shell.robot.node.create_publisher(Clock, "/clock", 10)

    def tick():
        seconds = 50
        while not ended.wait(0.05):
            seconds += 1
            clock.publish(set_fields(Clock(), {"clock": time_fields(seconds)}))

    ticking = threading.Thread(target=tick, daemon=True)
    ticking.start()
    try:
        shell.start_node(ros=("-p", "use_sim_time:=true"), namespace="/sim").end()
    finally:
        ended.set()
        ticking.join()
        shell.robot.node.destroy_publisher(clock)


@clause("rtask ros2 doctor names the node and finds nothing of it broken; hashes agree")
def _(shell):
    token = {**os.environ, "RTASK_SERVER": shell.url}
    done = subprocess.run(
        [*shell.options.rtask.split(), "ros2", "doctor", "--json", "--wait", "5"], env=token,
        capture_output=True, text=True, check=False, timeout=180,
    )  # fmt: skip
    assert done.stdout, done.stderr[-600:]
    found = {entry["name"]: entry for entry in json.loads(done.stdout)}
    judged = ("rclpy", "rmw", "topics", "rtask node", "camera", "clock", "server", "rtask_msgs")
    details = {name: (found[name]["state"], found[name]["detail"]) for name in judged}
    assert {state for state, _ in details.values()} == {"ok"}, details
    assert f"{NAMESPACE}/rtask_node is active" in details["rtask node"][1]
    assert "/camera/points" in details["camera"][1]
    assert "qos" not in found, found["qos"]
    return details["rtask_msgs"][1]


@clause("rtask ros2 doctor tells which publisher the node does not hear")
def _(shell):
    from rclpy.qos import QoSProfile, QoSReliabilityPolicy
    from tf2_msgs.msg import TFMessage

    policy = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    wrong = shell.robot.node.create_publisher(TFMessage, "/tf", policy)
    try:
        done = subprocess.run(
            [*shell.options.rtask.split(), "ros2", "doctor", "--json", "--wait", "5"],
            capture_output=True, text=True, check=False, timeout=180,
        )  # fmt: skip
        assert (done.returncode, bool(done.stdout)) == (1, True), done.stderr[-600:]
        words = f"{NAMESPACE}/rtask_node does not hear /contract_robot on /tf: "
        reasons = [
            entry["detail"].partition(words)[2]
            for entry in json.loads(done.stdout)
            if entry["name"] == "qos" and words in entry["detail"]
        ]
        assert reasons, done.stdout
        return reasons[0]
    finally:
        shell.robot.node.destroy_publisher(wrong)


@clause("rtask ros2 dds: a node without ROS 2 is seen, heard and, by Cyclone, called")
def _(shell):
    return without_ros.check(shell)
