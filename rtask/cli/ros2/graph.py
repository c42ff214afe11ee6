"""The running graph of ROS 2: what a survey by the Python of ROS 2 has found."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rtask.cli.doctor import Finding
from rtask.cli.ros2.environment import Sourced, python_names
from rtask.ros2 import survey as survey_program

__all__ = ["examine_graph", "take_survey"]

_STARTS_S = 40.0
_RMEM_MAX, _BUFFER = Path("/proc/sys/net/core/rmem_max"), 4 * 2**20
_Survey = dict[str, Any]


def take_survey(ros: Sourced, domain: int, wait_s: float) -> _Survey:
    """Return what the first Python that has rclpy sees; ``error`` says why none does.

    Parameters
    ----------
    wait_s
        Time for the discovery of others, s.
    """
    environment = {**ros.variables, "ROS_DOMAIN_ID": str(domain)}
    program = Path(survey_program.__file__).read_text("utf-8")
    errors = {}
    for name in (sys.executable, *python_names(ros)):
        file = shutil.which(name)
        if file is None or name in errors:
            continue
        try:
            done = subprocess.run(
                [file, "-c", program, str(wait_s)], capture_output=True, text=True, check=False,
                timeout=wait_s + _STARTS_S, env=environment,
            )  # fmt: skip
            report: _Survey = json.loads(done.stdout.strip().rpartition("\n")[2])
        except subprocess.TimeoutExpired:
            return {"error": f"{name}: rclpy gave no answer within {wait_s + _STARTS_S:g} s"}
        except ValueError:
            last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            errors[name] = last
            continue
        if "error" not in report:
            return report
        errors[name] = report["error"]
    return {"error": "; ".join(f"{name}: {error}" for name, error in errors.items())}


def examine_graph(report: _Survey) -> Iterator[Finding]:
    """Look at what a survey has found: the RMW, the nodes, their topics and their clock."""
    if "error" in report:
        yield Finding(
            "rclpy", "broken", report["error"], "source the ROS 2 in the shell of this command"
        )
        return
    yield Finding("rclpy", "ok", f"{report['rclpy']} in Python {report['python']}")
    yield Finding("rmw", "ok", report["rmw"])
    if not report["heard"]:
        yield Finding(
            "topics", "broken", "a message that was published was not heard on this machine",
            "look for a firewall, and at the discovery above",
        )  # fmt: skip
        return
    yield Finding("topics", "ok", "a message that was published was heard")
    yield Finding("nodes", "ok", ", ".join(report["nodes"]) or "no other is seen")
    if not report["ours"]:
        yield Finding(
            "rtask node", "note", "no node offers rtask/where_is",
            "ros2 run rtask_ros2 node, with the domain and the discovery above",
        )  # fmt: skip
    yield from _rivals(report["ours"])
    names = {node["name"] for node in report["ours"]}
    for node in report["ours"]:
        yield _state(node)
        yield _camera(node)
        yield from (_lossy(node["name"], each, report["rmw"]) for each in node["lossy"])
        yield _clock(node, report["clocks"])
    for pair in report["mismatches"]:
        is_ours = bool(names & {pair["publisher"], pair["subscriber"]})
        words = f"{pair['subscriber']} does not hear {pair['publisher']} on {pair['topic']}"
        yield Finding(
            "qos", "broken" if is_ours else "note", f"{words}: {pair['reason']}",
            "give both the same: `ros2 topic info -v` shows them",
        )  # fmt: skip


def _rivals(ours: list[_Survey]) -> Iterator[Finding]:
    offered: dict[str, list[str]] = {}
    for node in ours:
        for service in node["services"]:
            offered.setdefault(service, []).append(node["name"])
    doubled = {service: names for service, names in offered.items() if len(names) > 1}
    if doubled:
        service, names = min(doubled.items())
        words = f"{service} is offered by {' and '.join(names)}; calls reach both"
        yield Finding(
            "services", "broken", words,
            "end one, or start it in a namespace: --ros-args -r __ns:=/robot",
        )  # fmt: skip


def _state(node: _Survey) -> Finding:
    count = len(node["services"])
    if node["state"] is None:
        words = f"{node['name']} does not say its state; `rtask ros2 dds serve` has none"
        return Finding("rtask node", "note", words)
    if node["state"] != "active":
        mend = "configure" if node["state"] == "unconfigured" else "activate"
        return Finding(
            "rtask node", "note", f"{node['name']} is {node['state']}: it refuses requests",
            f"ros2 lifecycle set {node['name']} {mend}",
        )  # fmt: skip
    return Finding("rtask node", "ok", f"{node['name']} is active, with {count} services")


def _camera(node: _Survey) -> Finding:
    """Look whether anybody publishes a view for a node: clouds, or depth."""
    camera = node["publishers"]
    heard = sorted(name for name, count in camera.items() if count)
    if heard:
        return Finding("camera", "ok", f"published for {node['name']}: {', '.join(heard)}")
    return Finding(
        "camera", "note", f"nobody publishes {' or '.join(sorted(camera)) or 'a view'}",
        "start the camera, or the node with -r '~/points:=/camera/depth_registered/points'",
    )  # fmt: skip


def _lossy(node: str, heard: _Survey, rmw: str) -> Finding:
    """Say that large clouds may get lost on their way, and what keeps them."""
    if heard["is_reliable"]:
        mend = f"start {node} with --ros-args -p reliable_views:=true; the camera is reliable"
    elif "fastrtps" in rmw:
        mend = (
            "let the camera be reliable, or a profile of Fast DDS give SHM a segment_size of 32 MB"
        )
    elif "cyclone" in rmw:
        mend = (
            "let the camera be reliable, or CYCLONEDDS_URI ask for SocketReceiveBufferSize "
            f"min=4MB; {_buffers()}"
        )
    else:
        mend = f"let the camera be reliable; {_buffers()}"
    words = f"{node} hears clouds of {heard['topic']} by best effort: large ones may get lost"
    return Finding("clouds", "note", words, mend)


def _buffers() -> str:
    try:
        largest = int(_RMEM_MAX.read_text("ascii"))
    except (OSError, ValueError):
        return "sysctl net.core.rmem_max limits what can be asked for"
    if largest >= _BUFFER:
        return f"net.core.rmem_max allows it with {largest}"
    return f"sudo sysctl -w net.core.rmem_max={_BUFFER} first, which is {largest}"


def _clock(node: _Survey, publishers: int) -> Finding:
    if node["use_sim_time"] and not publishers:
        return Finding(
            "clock", "broken", f"{node['name']} has use_sim_time, and nobody publishes /clock",
            f"start the simulator, or ros2 param set {node['name']} use_sim_time false",
        )  # fmt: skip
    if publishers and not node["use_sim_time"]:
        return Finding(
            "clock", "note", f"/clock is published, and {node['name']} has the machine's clock",
            "start it with --ros-args -p use_sim_time:=true",
        )  # fmt: skip
    return Finding("clock", "ok", "/clock" if publishers else "the clock of this machine")
