"""An item of a thesis: what it shows, where, and how ours is run."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from simulate.thesis.result import Result, Setting

__all__ = ["Entry", "Kind", "State", "Thesis"]

Thesis = Literal["gatto", "kehoe", "beyond"]
"""Whose; ``beyond`` is what neither thesis has."""
Kind = Literal["table", "fig", "algorithm", "listing", "experiment", "capability"]
State = Literal["compared", "shown", "done differently", "not applicable"]


_MODULES = {
    "beyond": "simulate.thesis.runs.beyond",
    "features": "simulate.thesis.runs.features",
    "model": "simulate.thesis.runs.model",
    "poses": "simulate.thesis.runs.poses",
    "push_figures": "simulate.thesis.runs.push_figures",
    "push_nodes": "simulate.thesis.runs.push_nodes",
    "push_pose": "simulate.thesis.runs.push_pose",
    "push_tables": "simulate.thesis.runs.push_tables",
    "recognition": "simulate.thesis.runs.recognition",
    "robots": "simulate.thesis.runs.robots",
    "sense": "simulate.thesis.runs.sense",
}


@dataclass(frozen=True)
class Entry:
    """A table, figure, algorithm, listing or experiment.

    Parameters
    ----------
    thesis, kind, number
        Make up the name: ``kehoe-table-3.1``; experiments without a number have a word, and what
        neither thesis has is named by it: ``beyond-plans``.
    section
        Of the thesis.
    shows
        What the thesis shows there, in our words.
    state
        ``compared``: a run prints our figures beside the thesis's; ``shown``: a run prints or draws
        ours, as the thesis gives no figure; ``done differently`` and ``not applicable``: no run,
        and ``why`` says the reason and where ours is.
    run
        ``module:function`` below :mod:`simulate.thesis.runs`, called with a
        :class:`~simulate.thesis.result.Setting`.
    why
        Reason of the last two states, or a remark.
    """

    thesis: Thesis
    kind: Kind
    number: str
    section: str
    shows: str
    state: State
    run: str = ""
    why: str = ""

    def __post_init__(self) -> None:
        runs = self.state in ("compared", "shown")
        if runs != bool(self.run) or not (runs or self.why):
            raise ValueError(f"{self.name}: {self.state!r} needs a run or a reason")

    @property
    def name(self) -> str:
        """Name by which the command takes it."""
        if self.thesis == "beyond":
            return f"beyond-{self.number}"
        return f"{self.thesis}-{self.kind}-{self.number}"

    @property
    def title(self) -> str:
        """Name for people."""
        if self.thesis == "beyond":
            return f"Beyond the theses, {self.number}"
        author = {"gatto": "Gatto 2016", "kehoe": "Kehoe 2014"}[self.thesis]
        kind = {"fig": "Figure"}.get(self.kind, self.kind.capitalize())
        return f"{author}, {kind} {self.number}"

    def call(self, setting: Setting) -> Result:
        """Run it.

        Raises
        ------
        LookupError
            It has no run.
        """
        if not self.run:
            raise LookupError(f"{self.name} has no run: {self.why}")
        module, _, function = self.run.partition(":")
        work: Callable[[Setting], Result] = getattr(
            importlib.import_module(_MODULES[module]), function
        )
        return work(setting)
