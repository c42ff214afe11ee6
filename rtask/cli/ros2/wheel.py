"""The DDS of the wheel: whether a message that is sent by it is heard on this machine.

It is tried in a process of its own, ``python -m rtask.cli.ros2.wheel DOMAIN SECONDS``: a library
of C that does not fit ends its whole process, and with it all that a doctor had found.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

from rtask.cli.doctor import Finding
from rtask.errors import RtaskError
from rtask.extras import install_command

__all__ = ["examine_dds"]

_TOPIC, _TYPE = "/rtask_doctor", "std_msgs/msg/String"
_HEARD_S, _STARTS_S = 10.0, 30.0
_NETWORK = "look at CYCLONEDDS_URI and the domain"
_ALONE = "env -u LD_PRELOAD -u LD_LIBRARY_PATH rtask ros2 dds ..."


def examine_dds(domain: int, wait_s: float, is_needed: bool) -> Iterator[Finding]:
    """Look at what ``rtask ros2 dds`` needs: the library, and a message sent and heard.

    Parameters
    ----------
    wait_s
        Time for the discovery of nodes, s.
    is_needed
        Whether there is no other way to ROS 2 on this machine; else its lack is a note.
    """
    if importlib.util.find_spec("cyclonedds") is None:
        yield Finding(
            "cyclonedds", "broken" if is_needed else "note",
            "not installed; rtask ros2 dds needs it", install_command("dds"),
        )  # fmt: skip
        return
    network = os.environ.get("CYCLONEDDS_URI") or "chosen by Cyclone"
    version = importlib.metadata.version("cyclonedds")
    yield Finding("cyclonedds", "ok", f"{version}; network: {network}")
    report = _report_of_child(domain, wait_s)
    if "error" in report:
        is_loaded_twice = report.get("loaded_twice", False)
        state = "note" if is_loaded_twice and not is_needed else "broken"
        yield Finding("dds", state, report["error"], _ALONE if is_loaded_twice else _NETWORK)
    elif report["nodes"] is None:
        yield Finding(
            "dds", "broken", "a message was sent and not heard on this machine",
            "let CYCLONEDDS_URI name an interface that is up",
        )  # fmt: skip
    else:
        yield Finding("dds", "ok", "a message was sent and heard")
        yield Finding("dds nodes", "ok", ", ".join(report["nodes"]) or "no other heard")


def _report_of_child(domain: int, wait_s: float) -> dict[str, Any]:
    """Return what the child process has found; ``error`` says why it found nothing."""
    longest_s = _STARTS_S + _HEARD_S + wait_s
    command = [sys.executable, "-m", __name__, str(domain), str(wait_s)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=longest_s
        )
    except subprocess.TimeoutExpired:
        return {"error": f"the library gave no answer within {longest_s:g} s"}
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode < 0:
        name = signal.Signals(-done.returncode).name
        return {"error": f"the library ended its process with {name}; {last}".rstrip("; ")}
    try:
        report: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        return {"error": last or f"exit code {done.returncode}"}
    return report


def _heard_nodes(domain: int, wait_s: float) -> list[str] | None:
    """Return the nodes that announce themselves; None if this machine does not hear itself."""
    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

    heard, names = threading.Event(), set[str]()
    with (
        DdsNode("rtask_doctor", RosTypes(), domain=domain) as node,
        DdsNode("rtask_doctor_peer", RosTypes(), domain=domain) as peer,
    ):
        node.watch_nodes(names.update)
        peer.subscribe(_TOPIC, _TYPE, lambda _: heard.set(), is_latched=True)
        publisher = node.publisher(_TOPIC, _TYPE, is_latched=True)
        message = publisher.make()
        message.data = "hello"
        publisher.publish(message)
        if not heard.wait(_HEARD_S):
            return None
        threading.Event().wait(wait_s)
        return sorted(names - {node.full_name, peer.full_name})


def main() -> None:
    """Print the nodes heard, or why there is no answer, as one object of JSON."""
    try:
        report: dict[str, Any] = {"nodes": _heard_nodes(int(sys.argv[1]), float(sys.argv[2]))}
    except RtaskError as error:
        report = {"error": str(error), "loaded_twice": "libraries" in error.details}
    print(json.dumps(report))  # noqa: T201 - the parent reads this line


if __name__ == "__main__":
    main()
