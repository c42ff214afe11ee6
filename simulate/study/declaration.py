"""What a study is: its trials, and what it says of them. All else follows from that.

A command returns a :class:`Study`; progress, journal, tables, charts and JSON are made from it in
:mod:`simulate.study.command`, and the tables of the theses take its trials by
:meth:`Study.in_process`.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

__all__ = ["Report", "Results", "Study", "Table", "Trial", "trial_named"]

Results = Sequence[Mapping[str, Any]]
Trial = Callable[[Mapping[str, Any], int], dict[str, Any]]


@dataclass(frozen=True)
class Table:
    """Rows with a title, as they are printed."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Report:
    """What a study says of its trials.

    Parameters
    ----------
    figures
        JSON data, which ``--json`` prints.
    tables
        Are printed without ``--json``, then ``lines``.
    more
        What the file has besides the figures, or instead of those of the same name, such as the
        trials.
    file
        Name of the file in the output folder that holds figures and ``more``.
    pictures
        Names of further files, which the study has written there.
    """

    figures: Mapping[str, Any]
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()
    more: Mapping[str, Any] = field(default_factory=dict)
    file: str = "report.json"
    pictures: Sequence[str] = ()


Describe = Callable[[Results, Mapping[str, Any], Path], Report]


def _nothing(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    return Report({})


@dataclass(frozen=True)
class Study:
    """An experiment of independent trials; one computation is a study of one trial.

    Parameters
    ----------
    name
        Goes into the journal.
    trial
        Function to run, as ``module:function``: takes the settings and the number of the trial,
        returns JSON-able data; see :func:`simulate.study.workers.run_trials`.
    settings
        Settings on which trials depend, JSON-able, including ``seed``.
    trials
        Number of trials.
    describe
        Makes the report of the results, given the settings and the output folder, into which it may
        draw.
    """

    name: str
    trial: str
    settings: Mapping[str, Any]
    trials: int
    describe: Describe = _nothing

    @property
    def slug(self) -> str:
        """The name as that of a folder."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")

    def in_process(self) -> list[dict[str, Any]]:
        """Run all trials here, without journal, and return their results in order."""
        trial = trial_named(self.trial)
        return [trial(self.settings, number) for number in range(self.trials)]


def trial_named(name: str) -> Trial:
    """Return the function that ``module:function`` names.

    >>> trial_named("simulate.study.intervals:share")(3, 4)["share"]
    0.75
    """
    module, _, function = name.partition(":")
    return cast(Trial, getattr(importlib.import_module(module), function))
