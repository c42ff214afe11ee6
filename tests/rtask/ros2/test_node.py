"""The node's own logic over a real server, with a stand-in for rclpy."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import queue
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from rtask.cli.ros.schema import engine_schema
from rtask.client.base import RULES
from rtask.errors import UsageError
from rtask.interop.ros.operations import OperationHandler
from rtask.rdf.namespaces import PREFIXES
from rtask.ros2.contract import Contract
from rtask.ros2.node import GraphNode, NodeOptions
from tests.rtask.ros2.standin import World, install
from tests.servers import RunningServer, running_server

pytest.importorskip("rosbags")

SIGNATURES = Path(__file__).with_name("rclpy_signatures.txt")
CONTRACT = Contract(engine_schema(), RULES)
WAIT_S = 60.0
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with running_server(tmp_path_factory.mktemp("node") / "store") as running:
        yield running


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World(engine_schema())
    install(made, lambda name, module: monkeypatch.setitem(sys.modules, name, module))
    return made


@pytest.fixture
def node(world: World, server: RunningServer, tmp_path: Path) -> Iterator[GraphNode]:
    made = GraphNode(
        NodeOptions("rtask_node", server.url, outbox=tmp_path / "outbox", timeout_s=WAIT_S),
        CONTRACT,
    )
    yield made
    made.close()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, str]]]:
    """Address of a server with two robots, and the token of each."""
    folder = tmp_path_factory.mktemp("guarded") / "store"
    with rtask.open(folder) as kb:
        kb.update(f"{PREFIXES} INSERT DATA {{ <urn:tea> a rt:Box ; rt:objectId 'lab/1' . "
                  "<urn:cup> a rt:Exemplar ; rt:exemplarOf <urn:tea> }")  # fmt: skip
    store = TokenStore(folder)
    tokens = {name: store.create("robot", agent=name)[0] for name in ("nao-1", "nao-2")}
    store.close()
    with running_server(folder) as running:
        yield running.url, tokens


def rtask_node(url: str, token: str) -> contextlib.closing[GraphNode]:
    options = NodeOptions("rtask_node", url, token=token, timeout_s=WAIT_S)
    return contextlib.closing(GraphNode(options, CONTRACT))


def start(node: GraphNode) -> None:
    assert node.node.trigger_configure() == "success", node.trouble
    assert node.node.trigger_activate() == "success"


def register(world: World, name: str) -> Any:
    given = {"name": name, "model": "nao-h25-v5", "end_effectors": [HAND]}
    return world.call("rtask/register_robot", **given)


def test_the_methods_of_the_stand_in_have_the_parameters_of_rclpy(world):
    missing = []
    for line in SIGNATURES.read_text("utf-8").splitlines():
        module, _, rest = line.partition(" ")
        name, _, names = rest.rstrip(")").partition("(")
        if module not in sys.modules or not hasattr(sys.modules[module], name.split(".")[0]):
            missing.append(line)  # only the program that starts a node takes it
            continue
        taken = importlib.import_module(module)
        for part in name.split("."):
            taken = getattr(taken, part)
        own = inspect.signature(taken).parameters
        lacking = [each for each in names.split(", ") if each and each not in own]
        assert not lacking, f"{line}: {list(own)}"
    assert {line.split(" ")[0] for line in missing} == {
        "rclpy", "rclpy.action.server", "rclpy.executors", "rclpy.lifecycle.publisher",
        "rclpy.node", "rclpy.qos", "rclpy.utilities",
    }  # fmt: skip


def test_each_operation_is_a_service_once_the_node_is_configured_and_none_after_it(world, node):
    assert world.services == {}
    start(node)
    expected = {f"rtask/{name}" for name in CONTRACT.schema.services} | {"rtask/segment"}
    assert world.services.keys() == expected
    node.clean_up()
    left = [world.services, world.publishers, world.actions, *world.subscriptions.values()]
    assert not any(left)


def test_a_service_answers_with_what_the_server_says(world, node):
    start(node)
    answer = register(world, "nao-1")
    assert (answer.refused, answer.robot.rpartition("/")[2]) == ("", "nao-1")


def test_what_is_refused_is_answered_with_its_reason_on_one_line(world, node):
    start(node)
    refused = world.call("rtask/recall_grasps", object="https://example.org/nothing").refused
    assert "https://example.org/nothing" in refused
    assert "\n" not in refused


@pytest.mark.parametrize(
    ("operation", "given"),
    [
        ("register_robot", {"name": "nao-1", "model": "panda", "end_effectors": [HAND]}),
        ("state_frame", {"frame": "nao-1/base", "lost": True}),
        ("state_place", {"thing": "urn:cup", "place": "{robot}/hand"}),
        ("claim_step", {"robot": "nao-1"}),
        ("report_outcome", {"object": "urn:tea", "gripper_id": "{robot}/hand"}),
    ],
)
def test_a_node_speaks_for_the_robot_of_its_token_alone(world, guarded, operation, given):
    url, tokens = guarded
    with rtask_node(url, tokens["nao-1"]) as owner:
        start(owner)
        robot = register(world, "nao-1").robot
    with rtask_node(url, tokens["nao-2"]) as stranger:
        start(stranger)
        named = {
            key: value.format(robot=robot) if isinstance(value, str) else value
            for key, value in given.items()
        }
        refused = world.call(f"rtask/{operation}", **named).refused
    assert "nao-1" in refused or "another robot" in refused, refused
    assert "'nao-2'" in refused


def test_an_inactive_node_refuses_requests_and_goals(world, node):
    start(node)
    node.node.on_deactivate(None)
    assert world.call("rtask/where_is", name="cup").refused == "the node is not active"
    assert world.call("rtask/segment").refused == "the node is not active"
    assert world.actions["rtask/see"].send() is None


def test_an_error_that_nobody_expected_is_an_answer(world, node, monkeypatch):
    def fail(*_: Any) -> None:
        raise RuntimeError("a fault of the node's own")

    start(node)
    monkeypatch.setattr(OperationHandler, "answer_or_refuse", fail)
    refused = world.call("rtask/where_is", name="cup").refused
    assert refused == 'an unexpected error: RuntimeError("a fault of the node\'s own")'


def test_a_goal_without_a_view_is_aborted_and_names_the_topics(world, node, monkeypatch):
    monkeypatch.setattr("rtask.ros2.seeing._VIEW_S", 0.1)
    start(node)
    handle = world.actions["rtask/see"].send()
    assert handle.ended.wait(WAIT_S)
    assert handle.status == "aborted"
    assert "/robot/rtask_node/points" in handle.result.refused


def test_a_cancelled_goal_ends_as_cancelled_and_a_replaced_one_as_aborted(world, node):
    start(node)
    see = world.actions["rtask/see"]
    first, second = see.send(), see.send()
    assert first.ended.wait(WAIT_S)
    assert first.status == "aborted"
    second.is_cancel_requested = True
    assert second.ended.wait(WAIT_S)
    assert second.status == "canceled"


def test_commits_are_messages_only_while_somebody_subscribes(world, node):
    start(node)
    [tick] = node.node.timers
    changes = world.publishers["rtask/changes"]
    tick()
    register(world, "nao-2")
    assert changes.messages.empty()
    changes.listeners = 1
    tick()
    for number in range(20):  # the subscription reaches the server after the call has returned
        assert register(world, f"nao-{number + 3}").refused == ""
        try:
            change = changes.messages.get(timeout=1.0)
        except queue.Empty:
            continue
        break
    assert change.commit


def test_a_report_waits_in_the_outbox_while_the_server_is_away(world, tmp_path):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # taken, and nobody listens
        address = f"http://127.0.0.1:{silent.getsockname()[1]}"
        _report_to_nobody(world, tmp_path, address)


def _report_to_nobody(world, tmp_path, address):
    options = NodeOptions("rtask_node", address, outbox=tmp_path / "outbox", timeout_s=1.0)
    node = GraphNode(options, CONTRACT)
    start(node)
    refused = world.call(
        "rtask/report_outcome", task_id="t-1", grasp="urn:g", success=[True]
    ).refused
    assert f"kept in {tmp_path / 'outbox'}" in refused
    assert "t-1" in (tmp_path / "outbox").read_text("utf-8")
    node.close()


def test_another_node_with_the_same_services_is_named_at_the_start_and_later(world, node):
    node.check_free(0.1)
    world.others["other", "/robot"] = ["/robot/rtask/where_is"]
    with pytest.raises(UsageError, match=r"/robot/rtask/where_is is offered by .*/robot/other;"):
        node.check_free(0.1)
    node.watch_for_rival()
    node.watch_for_rival()
    assert len(world.log) == 1, "it is said once"
    assert world.log[0].endswith("calls reach either")
    world.others = {("rtask_node", "/robot"): ["/robot/rtask/where_is"]}
    node.watch_for_rival()
    assert "/robot/rtask_node" in world.log[1], "one of the same name is another as well"
    world.others = {}
    node.watch_for_rival()
    assert len(world.log) == 2


def test_parameters_give_what_a_goal_leaves_out_and_the_token_is_none_of_them(world, node):
    world.parameters |= {"frame": "torso", "table_height": float("nan"), "min_confidence": 0.8}
    options = node.see_options()
    assert (options.frame, options.table_height, options.min_confidence) == ("torso", None, 0.8)
    assert not [name for name in world.parameters if "token" in name]


def test_a_node_without_an_address_says_how_to_give_one(world, monkeypatch):
    monkeypatch.delenv("RTASK_SERVER", raising=False)
    node = GraphNode(NodeOptions("rtask_node"), CONTRACT)
    assert node.node.trigger_configure() == "failure"
    assert world.log == ["no server: give --server, the parameter url or RTASK_SERVER"]
    node.close()


def test_views_and_poses_are_forgotten_when_the_time_jumps_back(world, node):
    start(node)
    jump: Any = type("Jump", (), {"delta": type("Delta", (), {"nanoseconds": -1})})
    [jumped] = node.node.clock.jumped
    jumped(jump)
    assert world.log == ["the time jumped back: views and transforms are gone"]


def test_the_world_is_published_as_markers_once_somebody_listens(world, node, server):
    told = f"""{PREFIXES} INSERT DATA {{ <urn:lab/map> a rt:Frame ; rt:frameId "map" .
      <urn:lab/nao> a cora:Robot ; rt:name "nao-9" ; rt:bodyFrame <urn:lab/map> }}"""
    httpx.post(f"{server.url}/update", data={"update": told}, timeout=60).raise_for_status()
    start(node)
    [tick] = node.node.timers
    shown = world.publishers["rtask/world"]
    for _ in range(5):  # once a second
        tick()
    assert shown.messages.empty()
    shown.listeners = 1
    for _ in range(5):
        tick()
    markers = shown.messages.get(timeout=WAIT_S).markers
    assert {marker.header.frame_id for marker in markers} == {"map"}
    assert {marker.text for marker in markers} == {"", "map", "nao-9"}
