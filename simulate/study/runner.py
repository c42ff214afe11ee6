"""Runs the trials of an experiment that are not in its journal yet, on several processes."""

from __future__ import annotations

import sys
import time
from contextlib import closing
from pathlib import Path
from typing import IO, Any

from rtask.errors import RtaskError, UsageError
from simulate.study.declaration import Study
from simulate.study.journal import Journal
from simulate.study.workers import run_trials

__all__ = ["Progress", "run"]


class Progress:
    """Progress line of an experiment, updated in place on a terminal, else every ten seconds."""

    def __init__(self, total: int, done: int, stream: IO[str] | None = None) -> None:
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._total, self._before, self._done = total, done, done
        self._started = self._printed_s = time.monotonic()
        if done:
            self._say(f"{done} of {total} trials are done already")

    def step(self, words: str = "") -> None:
        """Count one more trial, with ``words`` about it."""
        self._done += 1
        now = time.monotonic()
        if not self._terminal and now - self._printed_s < 10 and self._done < self._total:
            return
        self._printed_s = now
        each = (now - self._started) / (self._done - self._before)
        left = each * (self._total - self._done)
        self._say(
            f"{self._done}/{self._total}  {each:.1f} s each, {left / 60:.0f} min left  {words}"
        )

    def failed(self, number: int, why: str) -> None:
        """Report that a trial failed with an error."""
        self._say(f"trial {number} broke: {why.splitlines()[-1]}")

    def _say(self, text: str) -> None:
        last = self._done >= self._total
        start, end = ("\r\x1b[K", "\n" if last else "") if self._terminal else ("", "\n")
        self._stream.write(start + text + end)
        self._stream.flush()


def run(
    study: Study,
    folder: Path,
    processes: int = 2,
    resume: bool = False,
    progress: IO[str] | None = None,
) -> list[dict[str, Any]]:
    """Run the missing trials of an experiment; return all results in order.

    Parameters
    ----------
    study
        The experiment.
    folder
        Holds ``journal.jsonl``.
    processes
        Number of processes; does not affect the results.
    resume
        Whether to continue the journal in ``folder``.
    progress
        Stream for progress messages; None for standard error.

    Raises
    ------
    UsageError
        There is a journal and ``resume`` is off, or it is of another experiment.
    RtaskError
        Trials crashed (an error of the program, not of a grasp). All others are in the journal, and
        the next run with ``resume`` repeats the failed ones.
    """
    if study.trials < 1 or processes < 1:
        raise UsageError(f"needs at least 1 trial and 1 process, got {study.trials}, {processes}")
    settings = {"name": study.name, **study.settings}
    broken: dict[int, str] = {}
    with closing(Journal(folder / "journal.jsonl", settings, resume)) as journal:
        missing = [n for n in range(study.trials) if n not in journal.done]
        bar = Progress(study.trials, study.trials - len(missing), progress)
        for number, result, why in run_trials(study.trial, study.settings, missing, processes):
            if result is None:
                broken[number] = why
                bar.failed(number, why)
            else:
                journal.append(number, result)
                bar.step(str(result.get("says", "")))
        done = dict(journal.done)
    if broken:
        first = min(broken)
        raise RtaskError(
            f"{len(broken)} of {study.trials} trials broke, trial {first} first: "
            f"{broken[first].splitlines()[-1]}; the others are kept, go on with --resume"
        )
    return [done[number] for number in range(study.trials)]
