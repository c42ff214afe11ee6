"""Trials of a study in worker processes; one that kills its workers is lost, and no other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from grasp.workers import Processes
from simulate.study.declaration import trial_named

__all__ = ["run_trials"]


@dataclass(frozen=True)
class _Trial:
    """A function by its name, ``module:function``, and its settings."""

    name: str
    settings: Mapping[str, Any]

    def __call__(self, number: int) -> dict[str, Any]:
        return trial_named(self.name)(self.settings, number)


def run_trials(
    trial: str, settings: Mapping[str, Any], numbers: Iterable[int], processes: int
) -> Iterator[tuple[int, dict[str, Any] | None, str]]:
    """Yield (number, result, "") of each trial as it ends, or (number, None, why) if it fails.

    Results depend neither on ``processes`` nor on the order in which trials end: a trial gets only
    its settings and its number. One whose process is killed is run again, up to three times.

    Parameters
    ----------
    trial
        Function to run, as ``module:function``: takes settings and a number, returns a JSON-able
        result. The parent does not import it.
    settings
        Settings of all trials.
    numbers
        Numbers of the trials.
    processes
        Number of processes.
    """
    numbers_left = list(numbers)
    with Processes(processes, quiet=True) as workers:
        for i, done in workers.finished(_Trial(trial, dict(settings)), numbers_left):
            yield (
                (numbers_left[i], done.value, "")
                if done.error is None
                else (numbers_left[i], None, done.trace)
            )
