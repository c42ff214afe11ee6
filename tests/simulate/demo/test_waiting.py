"""A robot that waits: for an endpoint that is slow, one that is gone, behind a closed window."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rtask.errors import RtaskError
from simulate.demo.console import Console
from simulate.demo.orchestrate import Demo, Settings
from simulate.demo.processes import _Child

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


def test_a_window_that_somebody_closed_is_named(tmp_path: Path) -> None:
    last_words = "X connection to :0 broken (explicit kill or server shutdown)."
    command = [sys.executable, "-c", f"import sys; sys.exit({last_words!r})"]
    child = _Child("nao-1", command, tmp_path / "log", {})
    assert child.next_line(60) is None
    assert child.complaint() == "its window was closed"
    child.stop()
