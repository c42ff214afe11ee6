"""Sarsa with traces (Rummery and Niranjan 1994)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents.tabular import Settings, TabularAgent
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["Sarsa"]

_FADED = 1e-6


class Sarsa(TabularAgent):
    """Learns the values of what it really does, along the way it came.

    Parameters
    ----------
    bins, actions, settings, seed
        As of every learner with a table.
    fading
        Lambda: how much of a trace is left a step later.
    standard
        With traces as in Sutton and Barto: every pair on the way moves by the same error, and
        traces fade by gamma lambda. Otherwise every pair moves towards the same one-step target,
        as in the published implementation that Gatto 2016 used.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        settings: Settings | None = None,
        seed: int = 0,
        *,
        fading: float = 0.1,
        standard: bool = False,
    ) -> None:
        super().__init__(bins, actions, settings, seed)
        if not 0 <= fading <= 1:
            raise ValueError(f"fading is {fading}, expected 0 to 1")
        self.fading = fading
        self.standard = standard
        self._traces: dict[tuple[int, int], float] = {}

    def parameters(self) -> dict[str, Any]:
        """Return what the learner was made with."""
        return {**super().parameters(), "fading": self.fading, "standard": self.standard}

    def observe(self, transition: Transition) -> None:
        """Learn from one step, and choose the next action with it."""
        before = (self._cell_before(transition), transition.action)
        target = transition.reward
        if not transition.terminated:
            after = self.bins.number(transition.next_state)
            target += self.settings.gamma * self.values.item(after, self.plan(after))
        self._update(before, target)
        if transition.terminated or transition.truncated:
            self._traces.clear()
            self._planned = None

    def _update(self, pair: tuple[int, int], target: float) -> None:
        values, traces, alpha = self.values, self._traces, self.settings.alpha
        traces[pair] = 1.0
        error = target - values.item(pair)
        fade = self.fading * (self.settings.gamma if self.standard else 1.0)
        for other, trace in list(traces.items()):
            value = values.item(other)
            step = error if self.standard else target - value
            values[other] = value + alpha * trace * step
            faded = trace * fade
            if faded < _FADED:
                del traces[other]
            else:
                traces[other] = faded

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from others' steps; nobody knows what they did next, so the pair itself counts."""
        for transition in transitions:
            pair = (self.bins.number(transition.state), transition.action)
            follows = 0.0 if transition.terminated else self.values[pair]
            self._update(pair, transition.reward + self.settings.gamma * follows)
            self._traces.clear()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        traces = [(*pair, trace) for pair, trace in self._traces.items()]
        return {
            **super().arrays(),
            "traces": np.array(traces, dtype=np.float64).reshape(-1, 3),
        }

    def take(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        super().take(arrays)
        self._traces = {(int(s), int(a)): float(e) for s, a, e in arrays["traces"]}
