"""Dyna-Q (Sutton 1990): Q-learning that also replays what it remembers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents.q_learning import QLearning
from grasp.learning.agents.tabular import Settings
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["Dyna"]


class Dyna(QLearning):
    """After each real step, many steps drawn from those remembered.

    Parameters
    ----------
    bins, actions, settings, seed
        As of every learner with a table.
    replays
        Remembered steps a real one.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        settings: Settings | None = None,
        seed: int = 0,
        *,
        replays: int = 1000,
    ) -> None:
        super().__init__(bins, actions, settings, seed)
        self.replays = replays
        self._steps = np.zeros((64, 4), dtype=np.int64)
        self._rewards = np.zeros(64)
        self._count = 0

    def parameters(self) -> dict[str, Any]:
        """Return what the learner was made with."""
        return {**super().parameters(), "replays": self.replays}

    def observe(self, transition: Transition) -> None:
        """Learn from one step, then from remembered ones."""
        self._remember(transition)
        drawn = self.rng.integers(self._count, size=self.replays)
        _replay(
            self.values, self._steps, self._rewards, drawn, self.settings.alpha, self.settings.gamma
        )

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from others' steps and remember them."""
        for transition in transitions:
            self._remember(transition)

    def _remember(self, transition: Transition) -> None:
        before, after = self.update(transition)
        if self._count == len(self._rewards):
            self._steps = np.concatenate([self._steps, np.zeros_like(self._steps)])
            self._rewards = np.concatenate([self._rewards, np.zeros_like(self._rewards)])
        self._steps[self._count] = (before, transition.action, after, transition.terminated)
        self._rewards[self._count] = transition.reward
        self._count += 1

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        filled = slice(self._count)
        return {**super().arrays(), "steps": self._steps[filled], "rewards": self._rewards[filled]}

    def take(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        super().take(arrays)
        self._count = len(arrays["rewards"])
        room = max(self._count, 64)
        self._steps = np.zeros((room, 4), dtype=np.int64)
        self._rewards = np.zeros(room)
        self._steps[: self._count] = arrays["steps"]
        self._rewards[: self._count] = arrays["rewards"]


@numba.njit(cache=True, nogil=True)
def _replay(
    values: NDArray[np.float64],
    steps: NDArray[np.int64],
    rewards: NDArray[np.float64],
    drawn: NDArray[np.int64],
    alpha: float,
    gamma: float,
) -> None:
    for i in drawn:
        before, action, after, ended = steps[i]
        target = rewards[i]
        if not ended:
            target += gamma * values[after].max()
        values[before, action] += alpha * (target - values[before, action])
