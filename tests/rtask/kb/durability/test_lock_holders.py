"""Who holds a folder, as told from what a lock file names."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from typing import Any

import pytest

from rtask.kb.durability.lock import _is_running

_HERE = socket.gethostname()


def test_this_process_runs() -> None:
    assert _is_running({"host": _HERE, "pid": os.getpid()})


def test_of_a_process_on_another_machine_one_cannot_say_that_it_ended() -> None:
    assert _is_running({"host": f"not-{_HERE}", "pid": -1})


def test_a_process_that_has_ended_holds_nothing() -> None:
    ended = subprocess.Popen([sys.executable, "-S", "-c", ""])
    ended.wait()
    assert not _is_running({"host": _HERE, "pid": ended.pid})


def test_a_process_of_another_user_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(pid: int, number: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "kill", refuse)
    assert _is_running({"host": _HERE, "pid": 1})


@pytest.mark.parametrize("holder", [{}, {"host": _HERE}, {"host": _HERE, "pid": "?"}])
def test_a_lock_that_names_nobody_is_held_by_nobody(holder: dict[str, Any]) -> None:
    assert not _is_running(holder)
