"""One frame of the simulated robot, live over the node and from a recording: the same objects."""

from __future__ import annotations

import base64
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from features.codec import decode, encode_frame
from features.geometry import Frame
from rtask.cli.perception.recognise import recognise
from rtask.cli.perception.segment import segment
from rtask.cli.perception.selecting import Selection, objects_in
from rtask.cli.perception.view_options import View
from rtask.cli.ros.schema import engine_schema
from rtask.client.base import RULES
from rtask.interop.ros.looking import Look
from rtask.ros2.contract import Contract
from rtask.ros2.node import GraphNode, NodeOptions
from rtask.ros2.seeing import Eyes
from tests.rtask.ros2.standin import World, install
from tests.servers import RunningServer, running_server
from tests.simulate.ros.recorded import LIVE, Taken, take_frame, write_recording

pytest.importorskip("rosbags")
pytestmark = pytest.mark.deep  # tests/rtask/cli/test_recorded_view.py is its small sibling

WAIT_S = 240.0
SEED, SEEDS = 3, range(10)
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    made = World(engine_schema())
    with pytest.MonkeyPatch.context() as patch:
        install(made, lambda name, module: patch.setitem(sys.modules, name, module))
        # Messages of the stand-in have no constants, which markers are made of.
        patch.setattr("rtask.ros2.seeing.markers", lambda *given: None)
        yield made


@pytest.fixture(scope="module")
def taken(world: World, tmp_path_factory: pytest.TempPathFactory) -> Taken:
    """One frame of the Nao before its table."""
    return take_frame(world, tmp_path_factory.mktemp("assets"), SEED)


@pytest.fixture(scope="module")
def recording(world: World, taken: Taken, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recorded") / "rec", taken.messages, world)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with running_server(tmp_path_factory.mktemp("node") / "store") as running:
        yield running


@pytest.fixture(scope="module")
def node(world: World, server: RunningServer) -> Iterator[GraphNode]:
    options = NodeOptions("rtask_node", server.url, gripper_id="hand", timeout_s=WAIT_S)
    made = GraphNode(options, Contract(engine_schema(), RULES))
    assert made.node.trigger_configure() == "success", made.trouble
    assert made.node.trigger_activate() == "success"
    yield made
    made.close()


@pytest.fixture(scope="module")
def live(world: World, node: GraphNode, taken: Taken) -> dict[str, Any]:
    """What the node saw in the frame, and its answers before and after half of it was taught."""
    looks: list[Look] = []
    look = Eyes.look
    given = {"name": "nao-1", "model": "nao-h25-v5", "end_effectors": [HAND]}
    robot = world.call("rtask/register_robot", **given).robot

    def see() -> Any:
        for topic, message in taken.messages:
            world.publish(LIVE[topic], message)
        handle = world.actions["rtask/see"].send(gripper_id=f"{robot}/hand")
        assert handle is not None
        assert handle.ended.wait(WAIT_S)
        assert handle.status == "succeeded", handle.result.refused
        return handle.result.objects

    def remember(eyes: Eyes, since: Any) -> Look:
        looks.append(look(eyes, since))
        return looks[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Eyes, "look", remember)
        see()
        for number, viewed in enumerate(looks[0].objects[::2]):
            entry = {
                "data": list(base64.b64decode(viewed.data)), "name": f"taught-{number}",
                "gripper_id": f"{robot}/hand", "class_description": "box",
                "task_id": f"task-{number}",
            }  # fmt: skip
            stored = world.call("rtask/insert_object", objects=[entry])
            assert (stored.refused, stored.stored) == ("", 1)
        return {"look": looks[0], "objects": see()}


def test_the_crops_are_equal_pixel_by_pixel(live, recording):
    _, crops = objects_in(recording, View(), "auto", Selection())
    seen = live["look"].objects
    assert len(seen) >= 2
    for (_, offline), viewed in zip(crops, seen, strict=True):
        # As both are sent: depth is compressed to a fraction of a millimetre.
        sent, taken = decode(encode_frame(offline)), decode(base64.b64decode(viewed.data))
        assert isinstance(sent, Frame)
        assert isinstance(taken, Frame)
        assert sent.intrinsics == taken.intrinsics
        for one, other in zip(layers(sent), layers(taken), strict=True):
            np.testing.assert_array_equal(one, other)


def layers(crop: Frame) -> tuple[Any, Any, Any]:
    return crop.depth_m, crop.rgb, crop.mask


def test_segment_and_the_node_find_the_same_table_and_as_many_objects(live, recording):
    answer = json.loads(CliRunner().invoke(segment, [str(recording), "--json"]).stdout)
    look = live["look"]
    assert (answer["frame"], answer["status"]) == ("base_footprint", look.status)
    assert answer["table_height_m"] == pytest.approx(look.table_height, abs=1e-4)
    for row, viewed in zip(answer["objects"], look.objects, strict=True):
        middle = [viewed.pose["position"][axis] for axis in "xyz"]
        off = max(abs(a - b) for a, b in zip(row["centroid_m"], middle, strict=True))
        assert off < max(viewed.size) / 2, "the middle of what is seen lies in its box"


def test_recognise_and_the_node_name_the_same_objects(live, recording, server):
    done = CliRunner().invoke(recognise, [str(recording), "--server", server.url, "--json"])
    rows = json.loads(done.stdout)
    offline = [row["matches"][0]["object"] if row["accepted"] else "" for row in rows]
    assert offline == [each.object for each in live["objects"]]
    assert sum(map(bool, offline)) >= 2, "what was taught is recognised"


@pytest.mark.parametrize("seed", SEEDS)
def test_live_recorded_and_direct_count_what_lies_in_view(world, node, tmp_path, monkeypatch, seed):
    """Neither the hands of the robot nor the walls of its bins are objects."""
    counts: list[int] = []
    look = Eyes.look

    def remember(eyes: Eyes, since: Any) -> Look:
        seen = look(eyes, since)
        counts.append(len(seen.objects))
        return seen

    monkeypatch.setattr(Eyes, "look", remember)
    taken = take_frame(world, tmp_path, seed)
    node._parts.forget()
    for topic, message in taken.messages:
        world.publish(LIVE[topic], message)
    handle = world.actions["rtask/see"].send()
    assert handle is not None
    assert handle.ended.wait(WAIT_S)
    recording = write_recording(tmp_path / "rec", taken.messages, world)
    answer = json.loads(CliRunner().invoke(segment, [str(recording), "--json"]).stdout)
    assert [*counts, len(answer["objects"]), taken.direct] == [taken.in_view] * 3
