"""A robot that waits: for an endpoint that is slow, one that is gone, behind a closed window."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rtask.errors import RobotError, RtaskError
from simulate.demo.console import Console
from simulate.demo.orchestrate import Demo, Settings
from simulate.demo.processes import _Child, _Worker

DONE = {"event": "done", "name": "nao-1", "encounters": [], "products": [], "seconds": 1.0}
WAITING = {"event": "waiting", "for": "report_outcome", "doing": "waiting for the endpoint"}


def watch(folder: Path, ended: int | None) -> dict:
    """Let a demo watch a robot that waits before it is done."""
    (folder / "demo").mkdir()
    robot = SimpleNamespace(name="nao-1", events=lambda: iter([WAITING, DONE]))
    process = SimpleNamespace(poll=lambda: ended)
    endpoint = SimpleNamespace(process=process, complaint=lambda: "killed by signal 9 (SIGKILL)")
    return Demo(Settings(folder / "demo"), Console(results=False))._watch(robot, endpoint, {})


def test_a_slow_endpoint_is_waited_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert watch(tmp_path, ended=None)["name"] == "nao-1"
    assert "nao-1: no answer yet; asking again" in capsys.readouterr().err


def test_an_endpoint_that_is_gone_is_not(tmp_path: Path) -> None:
    with pytest.raises(RtaskError, match=r"nao-1 waits for .*SIGKILL.*outbox .*--keep"):
        watch(tmp_path, ended=-9)


def test_a_robot_that_is_killed_is_named_with_what_it_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    event = json.dumps({"event": "ready", "doing": "looking at its table"})
    lines = ("import os, signal", f"print({event!r}, flush=True)", "os.kill(os.getpid(), 9)")
    (tmp_path / "robot_that_dies.py").write_text("\n".join(lines))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    robot = _Worker("robot_that_dies", "nao-1", {}, "", tmp_path / "log")
    said = "nao-1 disappeared while looking at its table: killed by signal 9 (SIGKILL)"
    try:
        with pytest.raises(RobotError, match=re.escape(said)):
            list(robot.events())
    finally:
        robot.stop()


def test_a_window_that_somebody_closed_is_named(tmp_path: Path) -> None:
    last_words = "X connection to :0 broken (explicit kill or server shutdown)."
    command = [sys.executable, "-c", f"import sys; sys.exit({last_words!r})"]
    child = _Child("nao-1", command, tmp_path / "log", {})
    assert child.next_line(60) is None
    assert child.complaint() == "its window was closed"
    child.stop()
