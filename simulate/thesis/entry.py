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
State = Literal["compared", "shown", "built", "done differently", "not applicable"]


_MATERIAL = {
    "simulate.thesis.runs.beyond": "",
    "simulate.thesis.runs.calibration": "rendered chessboards",
    "simulate.thesis.runs.environment": "a lab without dynamics",
    "simulate.thesis.runs.features": "simulated tables",
    "simulate.thesis.runs.images": "simulated products",
    "simulate.thesis.runs.learners": "a world of two rooms",
    "simulate.thesis.runs.model": "simulated products",
    "simulate.thesis.runs.poses": "simulated products",
    "simulate.thesis.runs.push_figures": "stand-in outlines",
    "simulate.thesis.runs.push_nodes": "stand-in outlines",
    "simulate.thesis.runs.push_pose": "parts of our drawing",
    "simulate.thesis.runs.push_tables": "stand-in outlines",
    "simulate.thesis.runs.recognition": "simulated products",
    "simulate.thesis.runs.remembered": "a simulated Panda",
    "simulate.thesis.runs.robots": "a simulated Nao",
    "simulate.thesis.runs.sense": "simulated tables",
    "simulate.thesis.runs.shared_policy": "a world of two rooms",
    "simulate.thesis.runs.success": "simulated products",
}
"""Modules of runs, and what stands in there for what the thesis did not publish."""


@dataclass(frozen=True)
class Entry:
    """A table, figure, algorithm, listing or experiment.

    Parameters
    ----------
    thesis, kind, number
        Make up the name: ``kehoe-table-3.1``; experiments and capabilities, which have no number in
        the thesis, have a word, and what neither thesis has is named by it: ``beyond-plans``.
    section
        Of the thesis.
    shows
        What the thesis shows there, in our words.
    state
        ``compared``: a run prints our figures beside the thesis's; ``shown``: a run prints or draws
        ours, as the thesis gives no figure; ``built``: it does what the thesis describes in words,
        without a figure to compare or draw, and ``why`` names the document or command;
        ``done differently`` and ``not applicable``: no run, and ``why`` says the reason and where
        ours is.
    run
        ``module:function`` below :mod:`simulate.thesis.runs`, called with a
        :class:`~simulate.thesis.result.Setting`.
    why
        Reason of the states without a run, or a remark.
    material
        What stands in for what the thesis did not publish, if not what its module uses.
    """

    thesis: Thesis
    kind: Kind
    number: str
    section: str
    shows: str
    state: State
    run: str = ""
    why: str = ""
    material: str = ""

    def __post_init__(self) -> None:
        runs = self.state in ("compared", "shown")
        if runs != bool(self.run) or not (runs or self.why):
            raise ValueError(f"{self.name}: {self.state!r} needs a run or a reason")

    @property
    def stand_in(self) -> str:
        """What every row of the run is measured on, in a few words; "" = nothing stands in."""
        return self.material or _MATERIAL.get(self._module, "")

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
        function = self.run.partition(":")[2]
        work: Callable[[Setting], Result] = getattr(importlib.import_module(self._module), function)
        return work(setting)

    @property
    def _module(self) -> str:
        return f"simulate.thesis.runs.{self.run.partition(':')[0]}"
