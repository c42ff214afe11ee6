"""Running experiments: any number of processes, killed and resumed, broken trials."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rtask.errors import RtaskError, UsageError
from simulate.study.declaration import Study
from simulate.study.intervals import mean_interval, wilson
from simulate.study.journal import Journal
from simulate.study.runner import run


def draw(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """A trial: a number that follows from the seed and the trial's own."""
    import numpy as np

    return {"value": int(np.random.default_rng((settings["seed"], number)).integers(10**9))}


def dies_in_two(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """A trial that takes its process along once in 0 and, until it is healed, always in 2."""
    folder = Path(settings["folder"])
    died, is_healed = folder / f"died-{number}", (folder / "healed").exists()
    if (number == 0 and not died.exists()) or (number == 2 and not is_healed):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 3 and not is_healed:
        raise ZeroDivisionError("three")
    return {"value": number}


def slow(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """A trial that lasts long enough to be killed in."""
    time.sleep(0.0 if number < 2 else 60.0)
    return {"value": number, "pid": os.getpid()}


# Spawned processes find the trials by this module's name, which is not on the path under pytest.
_HERE = Path(__file__)


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let worker processes import this file as they import any module."""
    monkeypatch.syspath_prepend(str(_HERE.parent))
    monkeypatch.setenv("PYTHONPATH", str(_HERE.parent))


def _study(trials: int, seed: int = 1, **settings: Any) -> Study:
    return Study("numbers", "test_runner:draw", {"seed": seed, **settings}, trials)


@pytest.mark.slow
def test_results_do_not_depend_on_how_many_processes_there_are(tmp_path: Path) -> None:
    study = _study(5)
    two = run(study, tmp_path / "two", 2, progress=io.StringIO())
    assert two == [draw(study.settings, number) for number in range(5)]
    assert len({result["value"] for result in two}) == 5


@pytest.mark.slow
def test_going_on_does_only_what_is_missing_and_ends_alike(tmp_path: Path) -> None:
    run(_study(2), tmp_path / "a", 1, progress=io.StringIO())
    with (tmp_path / "a" / "journal.jsonl").open("a") as file:
        file.write('{"trial": 2, "resu')  # cut off by a crash
    told = io.StringIO()
    resumed = run(_study(4), tmp_path / "a", 1, resume=True, progress=told)
    assert resumed == [draw(_study(4).settings, number) for number in range(4)]
    assert "2 of 4 trials are done already" in told.getvalue()
    lines = (tmp_path / "a" / "journal.jsonl").read_text().splitlines()
    assert [json.loads(line).get("trial") for line in lines][:1] == [None]
    assert sorted(json.loads(line)["trial"] for line in lines[1:]) == [0, 1, 2, 3]


@pytest.mark.slow
def test_another_seed_or_setting_is_refused_by_name_and_nothing_changes(tmp_path: Path) -> None:
    run(_study(1), tmp_path, 1, progress=io.StringIO())
    before = (tmp_path / "journal.jsonl").read_bytes()
    with pytest.raises(UsageError, match=r"seed 1 \(now 2\)"):
        run(_study(1, seed=2), tmp_path, 1, resume=True, progress=io.StringIO())
    with pytest.raises(UsageError, match="preset None"):
        run(_study(1, preset="fast"), tmp_path, 1, resume=True, progress=io.StringIO())
    with pytest.raises(UsageError, match="--resume"):
        run(_study(1), tmp_path, 1, progress=io.StringIO())
    assert (tmp_path / "journal.jsonl").read_bytes() == before


def test_a_file_that_is_no_journal_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_text("years of work\n")
    with pytest.raises(UsageError, match="no journal"):
        Journal(path, {"seed": 1}, resume=True)
    assert path.read_text() == "years of work\n"


@pytest.mark.slow
def test_a_trial_that_kills_its_process_or_raises_is_named_and_the_others_are_kept(
    tmp_path: Path,
) -> None:
    study = Study("numbers", "test_runner:dies_in_two", {"seed": 0, "folder": str(tmp_path)}, 5)
    told = io.StringIO()
    with pytest.raises(RtaskError, match="2 of 5 trials broke, trial 2 first"):
        run(study, tmp_path / "run", 2, progress=told)
    assert "exit code -9" in told.getvalue()
    assert "ZeroDivisionError: three" in told.getvalue()
    (tmp_path / "healed").touch()
    again = run(study, tmp_path / "run", 1, resume=True, progress=told)
    assert [result["value"] for result in again] == [0, 1, 2, 3, 4]


@pytest.mark.slow
def test_killed_outright_it_leaves_no_process_and_goes_on_later(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; \n"
        "from simulate.study.declaration import Study\n"
        "from simulate.study.runner import run\n"
        "if __name__ == '__main__':\n"
        "    run(Study('s', 'test_runner:slow', {'seed': 0}, 4), Path(sys.argv[1]), 2)\n"
    )
    script = tmp_path / "program.py"
    script.write_text(program)
    journal = tmp_path / "run" / "journal.jsonl"
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "run")], stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and not (
        journal.exists() and len(journal.read_text().splitlines()) == 3
    ):
        time.sleep(0.05)  # the file is all that it tells us
    process.kill()
    process.wait()
    pids = {json.loads(line)["result"]["pid"] for line in journal.read_text().splitlines()[1:]}
    assert pids
    while time.monotonic() < deadline and any(Path(f"/proc/{pid}").exists() for pid in pids):
        time.sleep(0.05)  # the workers end in their own time
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)
    with closing(Journal(journal, {"name": "s", "seed": 0}, resume=True)) as kept:
        assert sorted(kept.done) == [0, 1]


def test_intervals_are_those_of_the_books() -> None:
    # Brown, Cai and DasGupta 2001, and R's binom.confint(8, 10, method="wilson").
    assert wilson(8, 10) == pytest.approx((0.490162, 0.943318), abs=1e-5)
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(0, 5)[0] == 0.0
    spread = mean_interval([1.0, 2.0, 3.0, 4.0] * 25)["interval95"]
    assert spread == pytest.approx([2.28, 2.72], abs=0.06)  # 2.5 +- 1.96 * 1.118 / 10
