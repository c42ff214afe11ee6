"""Clauses of the contract by DDS: the latched grasp, the outbox, tokens."""

from __future__ import annotations

import contextlib
import json
import queue
import signal

import pytest

from features.codec import encode_frame
from features.perception import perceive
from tests.commands import run_command
from tests.processes import wait_until
from tests.rtask.interop.ros.conftest import running
from tests.rtask.interop.ros.dds.conftest import HAND, command
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, view
from tests.servers import running_server

pytestmark = pytest.mark.slow
ANSWER_S = 120.0


def filled(types, message, fields):
    """Set the fields of a message; dictionaries in lists become messages of the type given."""
    for name, value in fields.items():
        if isinstance(value, tuple):
            kind, parts = value
            value = [filled(types, types.make(kind), part) for part in parts]
        setattr(message, name, value)
    return message


@pytest.fixture
def call(robot, types):
    """Return what calls an operation of a node of a namespace."""

    def ask(operation, space="", **fields):
        kind = "".join(part.capitalize() for part in operation.split("_"))
        name = f"{space}/rtask/{operation}" if space else f"rtask/{operation}"
        client = robot.client(name, f"rtask_msgs/srv/{kind}")
        return client.call(filled(types, client.make(), fields), ANSWER_S)

    return ask


def hands():
    return "rtask_msgs/EndEffector", [HAND]


def test_the_best_grasp_is_latched_and_a_late_subscriber_hears_it(served, robot, types, call):
    registered = call("register_robot", name="nao-1", model="nao", end_effectors=hands())
    gripper = f"{registered.robot}/h"
    soap, _ = perceive(view(), BASE_FROM_CAMERA).objects
    entry = {"data": encode_frame(soap.crop), "name": "soap", "gripper_id": gripper,
             "class_description": "box", "task_id": "task-soap"}  # fmt: skip
    stored = call("insert_object", objects=("rtask_msgs/NewObject", [entry]))
    assert (stored.refused, stored.stored) == ("", 1)
    answer = call(
        "recognise_for_grasp", data=encode_frame(soap.crop), gripper_id=gripper, propose=True
    )
    assert (answer.refused, len(answer.grasps) > 0) == ("", True)
    heard = queue.Queue()
    robot.subscribe("rtask/grasps", "moveit_msgs/msg/Grasp", heard.put, is_latched=True)
    grasp = types.decode(heard.get(timeout=ANSWER_S), "moveit_msgs/msg/Grasp")
    assert grasp.id == answer.grasps[0].id


def test_a_node_outlasts_its_server_what_waits_is_sent_and_commits_are_messages_again(
    network, robot, types, call, tmp_path
):
    outbox, folder = tmp_path / "outbox", tmp_path / "store"
    with running_server(folder) as server:
        child = command(
            "dds", "serve", "--server", server.url, "--domain", network, "--namespace", "/kept",
            "--outbox", str(outbox), "--timeout", "20",
        )  # fmt: skip
        with running(child):
            child.expect("ready /kept/rtask_node")
            known = call("register_robot", "/kept", name="n", model="m", end_effectors=hands())
            assert known.refused == ""
            server.stop(signal.SIGKILL)
            report = {"object": f"{known.robot}/thing", "gripper_id": f"{known.robot}/h",
                      "task_id": "t-1", "success": [True]}  # fmt: skip
            kept = call("report_outcome", "/kept", **report)
            assert f"kept in {outbox}" in kept.refused
            assert "t-1" in outbox.read_text()
            with running_server(folder, "-p", str(server.port)):
                # The object is unknown to the server: it answers, and the report is set aside.
                wait_until(lambda: not outbox.read_text(), ANSWER_S)
                aside = outbox.with_name("outbox.refused")
                wait_until(lambda: aside.exists() and "t-1" in aside.read_text(), ANSWER_S)
                changes = queue.Queue()
                robot.subscribe("/kept/rtask/changes", "rtask_msgs/msg/Change", changes.put)
                for number in range(60):  # until the topic is discovered and the node follows
                    call("register_robot", "/kept", name=f"n-{number}", model="m",
                         end_effectors=hands())  # fmt: skip
                    with contextlib.suppress(queue.Empty):
                        change = changes.get(timeout=1.0)
                        break
                assert types.decode(change, "rtask_msgs/msg/Change").commit > 1


def test_a_token_comes_from_a_file_and_without_one_the_refusal_is_the_answer(
    network, call, tmp_path
):
    folder, file = tmp_path / "locked", tmp_path / "token"
    made = run_command("token", "create", "--robot", "nao-2", "-d", str(folder), "--json")
    assert made.returncode == 0, made.stderr
    file.write_text(json.loads(made.stdout)["token"] + "\n")
    with running_server(folder) as server:
        answers = []
        for space, options in (("/with", ("--token-file", str(file))), ("/without", ())):
            child = command("dds", "serve", "--server", server.url, "--domain", network,
                            "--namespace", space, *options)  # fmt: skip
            with running(child):
                child.expect(f"ready {space}/rtask_node")
                answers.append(
                    call("register_robot", space, name="nao-2", model="m", end_effectors=hands())
                )
    assert answers[0].robot.endswith("/nao-2"), answers[0].refused
    assert (answers[1].robot, "needs scope write" in answers[1].refused) == ("", True)
