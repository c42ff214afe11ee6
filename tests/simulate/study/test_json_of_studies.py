"""Studies as programs call them: standard output holds JSON, whatever Bullet writes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("attempts", "-n", "1", "--grasps", "2", "--tries", "3"),
        ("judging", "-n", "1", "--preset", "fast"),
    ],
    ids=lambda words: words[0],
)
def test_a_study_prints_json_and_nothing_else(words: tuple[str, ...], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rtask", "simulate", *words, "--workers", "1"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out"), "--json"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout), dict)
