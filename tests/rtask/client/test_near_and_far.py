"""One program, two clients: in process and against ``rtask serve``; the answers are the same."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from rtask.errors import CallFailedError, ForbiddenError, RtaskError

pytestmark = pytest.mark.slow

NS = "https://w3id.org/rtask-kg/ns#"
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.05, "max_payload": 0.3}


def sight(seed: int) -> dict:
    """Return a printed card lying on a table, seen from above."""
    rng = np.random.default_rng(seed)
    picture = np.full((240, 320, 3), 140, np.uint8)
    for _ in range(160):
        x, y = (int(v) for v in (rng.integers(110, 210), rng.integers(90, 150)))
        colour = tuple(int(v) for v in rng.integers(0, 256, 3))
        cv2.rectangle(picture, (x, y), (x + int(rng.integers(3, 18)), y + 8), colour, -1)
    depth = np.full((240, 320), 0.30, np.float32)
    mask = np.zeros((240, 320), bool)
    mask[90:150, 110:210] = True
    depth[mask] = 0.27
    frame = Frame(depth, Intrinsics(320, 240, 700.0, 700.0, 159.5, 119.5), picture, mask)
    return {
        "data": to_wire(encode_frame(frame.crop(mask))),
        # The camera looks straight down: its z is the table's -z.
        "sensor_pose": {"position": {"x": 0.15, "y": 0.0, "z": 0.57},
                        "orientation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}},
        "frame_id": "base_footprint",
        "support_height": 0.27,
    }  # fmt: skip


def program(client) -> dict:
    """Meet two things, grasp one of them, ask again; return what was heard."""
    client.register_robot(name="nao-1", model="nao-h25-v5", end_effectors=[HAND])
    client.insert_object(objects=[sight(2)])
    seen = sight(1)
    asked = client.recognise_for_grasp(gripper_id="hand", propose=True, **seen)
    told = client.insert_object(
        objects=[{**seen, "gripper_id": "hand", "grasp": asked["grasps"][0],
                  "outcome": {"success": True, "reason": "ok"}, "task_id": asked["task_id"]}]
    )  # fmt: skip
    again = client.recognise_for_grasp(gripper_id="hand", **seen)
    report = client.report_outcome(
        task_id=again["task_id"], object=again["object"], grasp=again["grasps"][0],
        gripper_id="hand", outcome={"success": False, "reason": "slip_lift"},
    )  # fmt: skip
    rows = client.query(
        f"SELECT ?length ?name {{ ?o <{NS}extentX> ?length ; <{NS}name> ?name }} ORDER BY ?name"
    )
    return {
        "first": asked["task_response"],
        "new": told["objects"][0]["new"],
        "second": again["task_response"],
        "same": again["object"] == told["objects"][0]["object"],
        "statistics": report["statistics"],
        "grasp": {k: asked["grasps"][0][k] for k in ("id", "x", "y", "theta", "mean")},
        "rows": rows,
        "asked": client.ask(f"ASK {{ ?o a <{NS}ManipulableObject> }}"),
    }


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[tuple[str, str]]:
    """Return address and a robot's token of a server in a process of its own."""
    data = tmp_path_factory.mktemp("served")
    rtask_command = str(Path(sys.executable).with_name("rtask"))
    made = subprocess.run(
        [rtask_command, "token", "create", "--data", str(data), "--robot", "nao-1"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    token = next(word for word in made.stdout.split() if word.startswith("rtk_"))
    process = subprocess.Popen(
        [rtask_command, "serve", "--data", str(data), "-p", "0"],
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("ready "), line
        yield line.split()[1], token
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)
        process.stdout.close()


@pytest.fixture(scope="module")
def heard_far(served):
    url, token = served
    with rtask.connect(url, token=token) as client:
        return program(client)


def test_near_and_far_hear_the_same(heard_far):
    with rtask.open(":memory:") as kb, rtask.connect(kb, agent="nao-1") as client:
        near = program(client)
    assert near["first"] == "candidate"
    assert near["second"] == "grasp"
    assert near["same"] is near["new"] is near["asked"] is True
    assert near["statistics"]["attempts"] == 2
    assert heard_far == near


def test_the_token_names_the_robot_and_its_graph(served, heard_far):
    url, token = served
    with rtask.connect(url, token=token) as client:
        client.update(f'INSERT DATA {{ <urn:mug> <{NS}name> "mug" }}')
        graphs = client.query("SELECT ?g { GRAPH ?g { <urn:mug> ?p ?o } }")
        assert [row["g"].rsplit("/", 1)[1] for row in graphs] == ["nao-1"]
        foreign = graphs[0]["g"].replace("nao-1", "nao-2")
        with pytest.raises(ForbiddenError, match="nao-2"):
            client.update(f"INSERT DATA {{ GRAPH <{foreign}> {{ <urn:a> a <urn:b> }} }}")
        with pytest.raises(ForbiddenError, match="nao-2"):
            client.register_robot(name="nao-2", model="nao", end_effectors=[HAND])


def test_without_a_token_one_only_reads(served, heard_far):
    url, _ = served
    with rtask.connect(url) as client:
        assert client.ask("ASK { ?s ?p ?o }")
        with pytest.raises(RtaskError, match="token"):
            client.update("INSERT DATA { <urn:a> <urn:b> <urn:c> }")
        with pytest.raises(ForbiddenError, match="scope write"):
            client.insert_object(objects=[sight(1)])


def test_what_was_told_to_nobody_arrives_at_the_next_connection(served, heard_far, tmp_path):
    url, token = served
    seen = sight(1)
    with rtask.connect(url, token=token) as client:
        asked = client.recognise_for_grasp(gripper_id="hand", **seen)
    report = {
        "task_id": asked["task_id"],
        "object": asked["object"],
        "grasp": asked["grasps"][0],
        "gripper_id": "hand",
        "outcome": {"success": True, "reason": "ok"},
    }
    box = tmp_path / "outbox.jsonl"
    with (
        contextlib.suppress(RtaskError),
        rtask.connect("http://127.0.0.1:9", timeout_s=0.3, outbox=box) as away,
    ):
        away.report_outcome(**report)
    assert box.stat().st_size > 0
    with rtask.connect(url, token=token, outbox=box) as client:
        assert box.stat().st_size == 0
        assert client.report_outcome(**report)["stored"] == 0


def test_errors_of_queries_carry_the_servers_words(served):
    url, token = served
    with rtask.connect(url, token=token) as client:
        with pytest.raises(CallFailedError, match="1:"):
            client.query("SELECT nonsense")
        with pytest.raises(RtaskError, match="ask\\(\\) is for ASK"):
            client.ask("SELECT * { ?s ?p ?o } LIMIT 1")
