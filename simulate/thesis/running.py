"""Runs of entries: what came of each, in how long, on which machine."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simulate.thesis.entry import Entry
from simulate.thesis.result import Result, Setting

__all__ = ["Outcome", "machine", "run_entries"]


@dataclass(frozen=True)
class Outcome:
    """An entry and what its run gave.

    Parameters
    ----------
    result
        None where the entry has no run, or where it broke.
    seconds, cpu_s
        By the clock, and of this process.
    error
        What went wrong; "" where nothing did.
    """

    entry: Entry
    result: Result | None
    seconds: float = 0.0
    cpu_s: float = 0.0
    error: str = ""

    @property
    def verdict(self) -> str:
        """Verdict of the run, else the state of the entry."""
        if self.error:
            return "failed"
        return self.entry.state if self.result is None else self.result.verdict

    def to_json(self) -> dict[str, Any]:
        """Return JSON data, without pictures."""
        entry = self.entry
        return {
            "name": entry.name,
            "section": entry.section,
            "shows": entry.shows,
            "state": entry.state,
            "why": entry.why or None,
            "verdict": self.verdict,
            "seconds": round(self.seconds, 2),
            "cpu_seconds": round(self.cpu_s, 2),
            "error": self.error or None,
            "rows": [] if self.result is None else [row.to_json() for row in self.result.rows],
            "notes": [] if self.result is None else list(self.result.notes),
        }


def run_entries(
    entries: Iterable[Entry], setting: Setting, on_outcome: Callable[[Outcome], None]
) -> list[Outcome]:
    """Run entries in turn, each run once even where several show it; one that breaks ends alone.

    Parameters
    ----------
    on_outcome
        Called after each entry.
    """
    done: dict[str, Outcome] = {}
    outcomes = []
    for entry in entries:
        if not entry.run:
            outcome = Outcome(entry, None)
        elif entry.run in done:
            same = done[entry.run]
            outcome = Outcome(entry, same.result, same.seconds, same.cpu_s, same.error)
        else:
            outcome = done[entry.run] = _run(entry, setting)
        outcomes.append(outcome)
        on_outcome(outcome)
    return outcomes


def _run(entry: Entry, setting: Setting) -> Outcome:
    began, cpu = time.perf_counter(), time.process_time()
    result, error = None, ""
    try:
        result = entry.call(setting)
    except Exception as broken:  # noqa: BLE001 - one entry must not end a run of all; its row says what happened
        error = f"{type(broken).__name__}: {broken}"
    return Outcome(entry, result, time.perf_counter() - began, time.process_time() - cpu, error)


def machine() -> dict[str, Any]:
    """Return what times depend on: processor, cores that may be used, load, Python."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "system": platform.system(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
