"""Folders for temporary files: removed at the end, and by a later process after a kill."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rtask.scratch import ScratchFolder

_HOLD = """
import sys
from rtask.scratch import ScratchFolder
folder = ScratchFolder("held")
(folder.path / "deep").mkdir()
(folder.path / "deep" / "file").write_text("x")
print(folder.path, flush=True)
sys.stdin.read()
"""
_SEE = """
from rtask.scratch import ScratchFolder
with ScratchFolder("seen") as folder:
    print(*sorted(path.name for path in folder.parent.iterdir() if path != folder))
"""
_FORK = """
import os
from rtask.scratch import ScratchFolder
folder = ScratchFolder("fork")
child = os.fork()
if child == 0:
    folder.close()
    os._exit(0)
os.waitpid(child, 0)
stayed = folder.path.exists()
folder.close()
print(stayed, folder.path.exists())
"""


@pytest.fixture
def run(tmp_path: Path) -> Callable[[str], subprocess.Popen[str]]:
    def start(program: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )  # fmt: skip

    return start


def _output(process: subprocess.Popen[str]) -> str:
    return process.communicate(timeout=60)[0].strip()


def test_a_killed_process_leaves_its_folder_to_the_next_one(
    run: Callable[[str], subprocess.Popen[str]],
) -> None:
    with run(_HOLD) as holder:
        assert holder.stdout is not None
        held = Path(holder.stdout.readline().strip())
        assert _output(run(_SEE)) == held.name, "a folder whose process lives was removed"
        assert (held / "deep" / "file").exists()
        holder.kill()
    assert held.exists()
    assert _output(run(_SEE)) == ""
    assert not held.exists()


def test_only_folders_are_taken_away_and_no_link_is_followed(
    run: Callable[[str], subprocess.Popen[str]], tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "file").touch()
    (tmp_path / "rtask-scratch-link").symlink_to(elsewhere)
    (tmp_path / "rtask-scratch-file").touch()
    (tmp_path / "rtask-scratch-left-behind").mkdir()
    assert _output(run(_SEE)) == "elsewhere rtask-scratch-file rtask-scratch-link"
    assert (elsewhere / "file").exists()


def test_a_folder_goes_with_its_block_or_its_object(tmp_path: Path) -> None:
    with ScratchFolder("block", tmp_path) as path:
        (path / "file").touch()
    assert not path.exists()
    folder = ScratchFolder("object", tmp_path)
    path = folder.path
    del folder
    assert not path.exists()


def test_a_forked_child_that_ends_leaves_the_folder_to_its_parent(
    run: Callable[[str], subprocess.Popen[str]],
) -> None:
    assert _output(run(_FORK)) == "True False"
