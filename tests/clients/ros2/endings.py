"""Clauses on what is lost and comes back, and on tokens; the last of them ends the node."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import threading

from tests.clients.ros2.programs import NAMESPACE, WAIT_S, Program, own_python
from tests.clients.ros2.registry import HAND, clause


def kept_report(shell):
    """Report an outcome to a node whose server is gone; return the answer."""
    entry = shell.seen.objects[0]
    # By its id alone: where the grasp is, only the decision says, which outlasts the server.
    report = {"task_id": entry.task_id, "gripper_id": shell.gripper, "grasp": entry.grasps[0].id,
              "success": [True]}  # fmt: skip
    done = queue.Queue()
    threading.Thread(
        target=lambda: done.put(shell.robot.operation("report_outcome", **report)), daemon=True
    ).start()
    answer = done.get(timeout=WAIT_S)
    assert "kept in" in answer.refused, answer.refused


def sent_from_outbox(shell):
    """Wait until the server has answered what waited."""
    outbox = shell.folder / "outbox"
    shell.wait_for(lambda: not outbox.read_text(), "the answer of the server")
    refused = outbox.with_name("outbox.refused")
    assert not refused.exists(), refused.read_text()


@clause("a report waits in the outbox while the server is gone, and is answered once it is back")
def _(shell):
    shell.server.end(signal.SIGKILL)
    kept_report(shell)
    shell.start_server()
    sent_from_outbox(shell)


@clause("what waits outlasts a node that is killed: it is sent by the node that is started again")
def _(shell):
    shell.server.end(signal.SIGKILL)
    kept_report(shell)
    shell.node.end(signal.SIGKILL)
    assert (shell.folder / "outbox").read_text()
    shell.start_server()
    shell.node = shell.start_node("--gripper", "hand", "--outbox", str(shell.folder / "outbox"))
    sent_from_outbox(shell)
    soap = shell.seen.objects[0].object
    answer = shell.robot.operation("recall_grasps", object=soap, gripper_id=shell.gripper)
    assert (answer.refused, len(answer.grasps) > 0) == ("", True), answer


@clause("a token comes from a file; without one the server's refusal is the answer")
def _(shell):
    folder, file = shell.folder / "locked", shell.folder / "token"
    rtask = shell.options.rtask.split()
    made = subprocess.run(
        [*rtask, "token", "create", "--robot", "nao-2", "-d", str(folder), "--json"],
        env=own_python(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    file.write_text(json.loads(made.stdout)["token"] + "\n")
    server = Program([*rtask, "serve", "--data", str(folder), "-p", "0"], own_python())
    address = f"http://127.0.0.1:{server.expect(r'http://127[.]0[.]0[.]1:([0-9]+)', 120.0)[1]}"
    about = {"name": "nao-2", "model": "nao", "end_effectors": [HAND]}
    answers = []
    for space, options in (("/with", ("--token-file", str(file))), ("/without", ())):
        node = shell.start_node("--server", address, *options, namespace=space)
        answers.append(shell.robot.operation_in(space, "register_robot", **about))
        node.end()
    server.end()
    assert (answers[0].refused, answers[0].robot.rpartition("/")[2]) == ("", "nao-2")
    assert (answers[1].robot, "needs scope write" in answers[1].refused) == ("", True), answers[1]
    return answers[1].refused


@clause("a signal ends it with exit code 0, and leaves the graph")
def _(shell):
    shell.end_camera()
    assert shell.node.end(signal.SIGINT) == 0
    shell.wait_for(
        lambda: ("rtask_node", NAMESPACE) not in shell.robot.node.get_node_names_and_namespaces(),
        "the node out of the graph",
    )
