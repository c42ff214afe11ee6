"""``rtask ros2 doctor`` without ROS 2: a prefix in its form, and surveys of a graph."""

from __future__ import annotations

import ast
import inspect
import json
import os
import stat
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.cli.ros.schema import engine_schema
from rtask.cli.ros2.environment import Sourced, examine_environment, examine_packages
from rtask.cli.ros2.graph import examine_graph, take_survey
from rtask.cli.ros2.package import PROVIDED
from rtask.client.base import RULES
from rtask.interop.ros.package import write_source
from rtask.ros2 import survey as survey_module
from rtask.ros2.contract import Contract
from tests.servers import running_server

pytest.importorskip("rosbags")

SIGNATURES = Path(__file__).with_name("rclpy_signatures.txt")
NODE = {
    "name": "/nao1/rtask_node", "services": ["/nao1/rtask/where_is"], "use_sim_time": False,
    "state": "active", "publishers": {"/camera/points": 1}, "lossy": [],
}  # fmt: skip
SURVEY = {
    "python": "3.12.1", "rmw": "rmw_fastrtps_cpp", "rclpy": "7.1.6", "heard": True,
    "nodes": ["/camera", "/nao1/rtask_node"], "clocks": 0, "ours": [NODE], "mismatches": [],
}  # fmt: skip


@pytest.fixture(scope="module")
def hashes() -> dict[str, str]:
    from rtask.interop.ros.dds.types import RosTypes

    return RosTypes(engine_schema()).hashes()


@pytest.fixture
def prefix(tmp_path: Path, hashes: dict[str, str]) -> Path:
    """A folder as colcon installs packages, with the hashes as rosidl writes them."""
    share = tmp_path / "ws/share"
    for name in (*PROVIDED, "rtask_ros2"):
        (share / name).mkdir(parents=True)
    (share / "rtask_msgs/package.xml").write_text("<name>rtask_msgs</name>")
    write_source(engine_schema(), share)
    for type_, value in hashes.items():
        file = share / f"{type_}.json"
        file.write_text(json.dumps({"type_hashes": [{"type_name": type_, "hash_string": value}]}))
    data = tmp_path / "ws/lib/python3.12/site-packages/rtask_ros2/ros2/contract.json"
    data.parent.mkdir(parents=True)
    data.write_text(json.dumps(Contract(engine_schema(), RULES).as_json()))
    return tmp_path / "ws"


def sourced(prefix: Path, **variables: str) -> Sourced:
    return Sourced({"AMENT_PREFIX_PATH": str(prefix), "ROS_DISTRO": "jazzy", **variables})


def packages(prefix: Path) -> dict[str, Any]:
    return {each.name: each for each in examine_packages(sourced(prefix), engine_schema())}


def test_packages_of_this_release_are_found_and_their_hashes_agree(prefix, hashes):
    found = packages(prefix)
    assert {each.state for each in found.values()} == {"ok"}
    assert f"{len(hashes)} hashes agree" in found["rtask_msgs"].detail


def test_messages_of_another_release_are_named_and_what_builds_them_anew(prefix):
    file = prefix / "share/rtask_msgs/srv/WhereIs.srv"
    file.write_text(file.read_text().replace("string name", "string word"))
    found = packages(prefix)["rtask_msgs"]
    assert (found.state, "srv/WhereIs.srv differ" in found.detail) == ("broken", True)
    assert "colcon build" in found.mend


def test_a_hash_that_differs_is_named(prefix):
    file = prefix / "share/rtask_msgs/srv/WhereIs_Response.json"
    file.write_text(file.read_text().replace("RIHS01_", "RIHS01_0"))
    found = packages(prefix)["rtask_msgs"]
    assert (found.state, "rtask_msgs/srv/WhereIs_Response" in found.detail) == ("broken", True)


def test_without_hashes_the_definitions_are_compared(prefix):
    for file in prefix.glob("share/rtask_msgs/*/*.json"):
        file.unlink()
    found = packages(prefix)["rtask_msgs"]
    assert (found.state, "no hashes to compare" in found.detail) == ("ok", True)


def test_a_node_of_another_release_and_missing_packages_are_named(prefix):
    contract = next(prefix.glob("lib/*/*/rtask_ros2/ros2/contract.json"))
    contract.write_text("{}")
    (prefix / "share/moveit_msgs").rmdir()
    found = packages(prefix)
    assert (found["rtask_ros2"].state, found["packages"].state) == ("broken", "broken")
    assert "ros-$ROS_DISTRO-moveit-msgs" in found["packages"].mend


def test_what_is_not_built_is_said_with_the_commands(tmp_path):
    found = packages(tmp_path)
    assert found["rtask_msgs"].state == "broken"
    assert "rtask ros messages" in found["rtask_msgs"].mend
    assert found["rtask_ros2"].state == "note"


@pytest.mark.parametrize(
    ("variables", "name", "state", "words"),
    [
        ({}, "distribution", "note", "no ROS 2 is sourced"),
        ({"ROS_VERSION": "1", "ROS_DISTRO": "noetic"}, "distribution", "broken", "noetic"),
        ({}, "discovery", "ok", "SUBNET"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "discovery", "note", "other machines"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "discovery", "broken", "no other node"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LAN"}, "discovery", "broken", "expected one of SUBNET"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "discovery", "note", "other machines"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.2"},
         "discovery", "ok", "10.0.0.2"),
        ({"CYCLONEDDS_URI": "file:///nowhere.xml"}, "profile", "broken", "/nowhere.xml"),
        ({"AMENT_PREFIX_PATH": "/nowhere", "RMW_IMPLEMENTATION": "rmw_x_cpp"}, "rmw", "broken",
         "not installed"),
    ],
)  # fmt: skip
def test_the_variables_of_a_shell_are_judged(variables, name, state, words):
    found = {each.name: each for each in examine_environment(Sourced(variables), 0)}[name]
    assert (found.state, words in found.detail) == (state, True), found
    assert found.state == "ok" or found.mend


def test_a_domain_whose_ports_may_be_taken_is_noted():
    found = {each.name: each.state for each in examine_environment(Sourced({}), 150)}
    assert found["domain"] == "note"


def test_a_graph_in_which_all_is_well_has_nothing_to_mend():
    assert {each.state for each in examine_graph(SURVEY)} == {"ok"}


MISMATCH = {"topic": "/camera/points", "publisher": "/camera", "subscriber": NODE["name"],
            "reason": "reliability"}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "node", "name", "state", "words"),
    [
        ({"error": "no rclpy"}, {}, "rclpy", "broken", "no rclpy"),
        ({"heard": False}, {}, "topics", "broken", "was not heard"),
        ({"ours": []}, {}, "rtask node", "note", "no node offers"),
        ({}, {"state": "inactive"}, "rtask node", "note", "refuses requests"),
        ({}, {"state": None}, "rtask node", "note", "does not say its state"),
        ({}, {"use_sim_time": True}, "clock", "broken", "nobody publishes /clock"),
        ({"clocks": 1}, {}, "clock", "note", "has the machine's clock"),
        ({}, {"publishers": {"/points": 0}}, "camera", "note", "nobody"),
        ({}, {"lossy": [{"topic": "/p", "is_reliable": True}]}, "clouds", "note", "/p by best"),
        ({"mismatches": [MISMATCH]}, {}, "qos", "broken", "on /camera/points: reliability"),
        ({"mismatches": [{**MISMATCH, "subscriber": "/x"}]}, {}, "qos", "note", "/x does not"),
    ],
)
def test_what_is_wrong_with_a_graph_is_said(change, node, name, state, words):
    survey = {**SURVEY, "ours": [{**NODE, **node}], **change}
    found = {each.name: each for each in examine_graph(survey)}[name]
    assert (found.state, words in found.detail) == (state, True), found


def test_two_nodes_with_the_same_services_are_named():
    ours = [NODE, {**NODE, "name": "/nao1/second"}]
    found = {each.name: each for each in examine_graph({**SURVEY, "ours": ours})}["services"]
    assert (found.state, "/nao1/rtask_node and /nao1/second" in found.detail) == ("broken", True)


class GraphOfTwo:
    """A node's view of a graph: a camera, and RTASK's node, which hears what ``ends`` say."""

    def __init__(self, publishers: list[Any], subscriptions: list[Any]) -> None:
        self._ends = publishers, subscriptions
        self._heard: Any = None

    def get_namespace(self) -> str:
        return "/"

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [("rtask_doctor", "/"), ("camera", "/"), ("rtask_node", "/nao1")]

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> list[Any]:
        return [("/nao1/rtask/where_is", [])] if node_name == "rtask_node" else []

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str
    ) -> list[Any]:
        planning = ("/monitored_planning_scene", ["moveit_msgs/msg/PlanningScene"])
        return [("/points", ["sensor_msgs/msg/PointCloud2"]), planning]

    def get_topic_names_and_types(self) -> list[Any]:
        return [("/points", [])]

    def get_publishers_info_by_topic(self, topic_name: str) -> list[Any]:
        return self._ends[0]

    def get_subscriptions_info_by_topic(self, topic_name: str) -> list[Any]:
        return self._ends[1]

    def count_publishers(self, topic_name: str) -> int:
        return len(self._ends[0]) if topic_name == "/points" else 0

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, qos_profile: Any
    ) -> None:
        self._heard = callback

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any) -> Any:
        return types.SimpleNamespace(publish=lambda message: self._heard(message))

    def create_client(self, srv_type: Any, srv_name: str) -> Any:
        values = [types.SimpleNamespace(bool_value=True)]
        state = types.SimpleNamespace(label="active")
        answer = types.SimpleNamespace(values=values, current_state=state)
        future = types.SimpleNamespace(done=lambda: True, result=lambda: answer)
        return types.SimpleNamespace(
            wait_for_service=lambda timeout_sec: True, call_async=lambda request: future
        )

    def destroy_subscription(self, subscription: Any) -> None:
        self._heard = None

    def destroy_publisher(self, publisher: Any) -> None:
        pass

    def destroy_client(self, client: Any) -> None:
        pass


def end(name: str, reliable: bool, type_: str = "PointCloud2", version: int = 0) -> Any:
    return types.SimpleNamespace(
        node_name=name, node_namespace="/", topic_type=type_,
        qos_profile=types.SimpleNamespace(reliability=reliable),
        topic_type_hash=types.SimpleNamespace(version=version),
    )  # fmt: skip


@pytest.fixture
def _ros(monkeypatch: pytest.MonkeyPatch) -> None:
    def check(publisher: Any, subscription: Any) -> tuple[str, str]:
        is_heard = publisher.reliability >= subscription.reliability
        return ("ok", "") if is_heard else ("error", "Best effort publisher;")

    record = types.SimpleNamespace
    state = record(ERROR="error", OK="ok")
    request = record(Request=record)
    modules = {
        "rclpy": {}, "rclpy.qos": {
            "QoSCompatibility": state, "qos_check_compatible": check,
            "QoSReliabilityPolicy": record(RELIABLE=True),
        },
        "std_msgs": {}, "std_msgs.msg": {"String": record},
        "lifecycle_msgs": {}, "lifecycle_msgs.srv": {"GetState": request},
        "rcl_interfaces": {}, "rcl_interfaces.srv": {"GetParameters": request},
    }  # fmt: skip
    for name, members in modules.items():
        module: Any = types.ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)


def test_the_methods_of_the_graph_have_the_parameters_of_rclpy():
    listed = dict(
        line.rstrip(")").partition(".node Node.")[2].split("(")
        for line in SIGNATURES.read_text("utf-8").splitlines()
        if ".node Node." in line
    )
    own = {name: member for name, member in vars(GraphOfTwo).items() if name in listed}
    assert own.keys() == listed.keys()
    for name, names in listed.items():
        taken = inspect.signature(own[name]).parameters
        assert {each for each in names.split(", ") if each} <= taken.keys(), name


@pytest.mark.usefixtures("_ros")
def test_a_survey_tells_of_the_nodes_and_what_is_not_heard():
    graph = GraphOfTwo([end("camera", False)], [end("rtask_node", True)])
    found = survey_module.survey(graph, lambda for_s: None, 0.0)
    assert found["heard"]
    assert found["nodes"] == ["/camera", "/nao1/rtask_node"]
    assert found["ours"][0]["use_sim_time"] is True
    assert found["ours"][0]["publishers"] == {"/points": 1}
    [pair] = found["mismatches"]
    assert pair == {"topic": "/points", "publisher": "/camera", "subscriber": "/rtask_node",
                    "reason": "Best effort publisher"}  # fmt: skip


@pytest.mark.usefixtures("_ros")
@pytest.mark.parametrize(
    ("publisher", "subscriptions", "reason"),
    [
        (end("camera", True), [end("rtask_node", True)], ""),
        (end("camera", False), [end("n", True), end("n", False)], ""),  # it subscribes to both
        (end("camera", True, "Image"), [end("n", False)], "the types differ"),
    ],
)
def test_a_node_that_hears_by_one_of_its_subscriptions_is_no_mismatch(
    publisher, subscriptions, reason
):
    found = list(survey_module._mismatches(GraphOfTwo([publisher], subscriptions)))
    assert [pair["reason"].startswith(reason) for pair in found] == ([True] if reason else [])


def test_the_survey_is_read_by_python_3_10_and_needs_nothing_else():
    text = Path(survey_module.__file__).read_text("utf-8")
    tree = ast.parse(text, feature_version=(3, 10))
    names = {
        name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([a.name for a in node.names] if isinstance(node, ast.Import)
                     else [node.module or ""])
    }  # fmt: skip
    ros = {"rclpy", "std_msgs", "lifecycle_msgs", "rcl_interfaces"}
    assert names <= ros | sys.stdlib_module_names


def python_that(folder: Path, line: str) -> None:
    """Put a program in the place of the Python that has rclpy."""
    folder.mkdir()
    file = folder / "python3"
    file.write_text(f"#!/bin/sh\n{line}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)


def test_a_python_whose_libraries_do_not_load_is_named_with_its_error(tmp_path, monkeypatch):
    python_that(tmp_path / "bin", "echo 'librcl.so: not found' >&2; exit 1")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/nowhere")
    found = take_survey(Sourced({}), 0, 0.1)
    assert "python3: librcl.so: not found" in found["error"]


@pytest.mark.slow
def test_the_command_ends_with_1_where_something_must_be_mended(prefix, tmp_path, monkeypatch):
    python_that(tmp_path / "bin", f"cat <<'END'\n{json.dumps(SURVEY)}\nEND")
    for name, value in {
        "AMENT_PREFIX_PATH": str(prefix), "ROS_DISTRO": "jazzy",
        "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    domain = str(1 + os.getpid() % 100)

    def run(url: str) -> tuple[int, dict[str, Any]]:
        options = ("--json", "--wait", "0.1", "--server", url, "--domain", domain)
        with monkeypatch.context() as patch:  # not for the server, which is started by it
            other = types.SimpleNamespace(executable="/nowhere/python")
            patch.setattr("rtask.cli.ros2.graph.sys", other)
            done = CliRunner().invoke(cli, ["ros2", "doctor", *options])
        return done.exit_code, {each["name"]: each for each in json.loads(done.stdout)}

    with running_server(None) as server:
        code, found = run(server.url)
    broken = [each for each in found.values() if each["state"] == "broken"]
    assert (code, broken) == (0, [])
    assert "answers at" in found["server"]["detail"]
    assert "/nao1/rtask_node is active" in found["rtask node"]["detail"]
    code, found = run("http://127.0.0.1:1")
    assert (code, found["server"]["state"]) == (1, "broken")


@pytest.mark.usefixtures("_ros")
@pytest.mark.parametrize(
    ("published", "heard", "expected"),
    [(True, False, [True]), (False, False, [False]), (True, True, [])],
)
def test_a_survey_tells_by_what_quality_clouds_are_heard(published, heard, expected):
    hears = end("rtask_node", heard)
    hears.node_namespace = "/nao1"
    graph = GraphOfTwo([end("camera", published)], [hears])
    [node] = survey_module.survey(graph, lambda for_s: None, 0.0)["ours"]
    assert node["lossy"] == [{"topic": "/points", "is_reliable": each} for each in expected]


@pytest.mark.parametrize(
    ("rmw", "is_reliable", "largest", "words"),
    [
        ("rmw_fastrtps_cpp", True, "1", "-p reliable_views:=true"),
        ("rmw_fastrtps_cpp", False, "1", "segment_size of 32 MB"),
        ("rmw_cyclonedds_cpp", False, "212992", "sysctl -w net.core.rmem_max=4194304 first"),
        ("rmw_cyclonedds_cpp", False, "4194304", "min=4MB; net.core.rmem_max allows it"),
        ("rmw_zenoh_cpp", False, "", "sysctl net.core.rmem_max limits"),
    ],
)  # fmt: skip
def test_clouds_that_may_get_lost_are_named_with_the_remedy(
    tmp_path, monkeypatch, rmw, is_reliable, largest, words
):
    file = tmp_path / "rmem_max"
    file.write_text(largest)
    monkeypatch.setattr("rtask.cli.ros2.graph._RMEM_MAX", file)
    node = {**NODE, "lossy": [{"topic": "/p", "is_reliable": is_reliable}]}
    found = {each.name: each for each in examine_graph({**SURVEY, "rmw": rmw, "ours": [node]})}
    assert words in found["clouds"].mend
