"""R-MAX (Brafman and Tennenholtz 2002): what is not known yet is worth the most."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents.tabular import Settings, TabularAgent
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["RMax"]

_ERROR = 1e-4


class RMax(TabularAgent):
    """Learns a model; a pair is known after some visits, and until then it promises the most.

    Acts greedily by value iteration on the model. The model of a known pair stays as it is.

    Parameters
    ----------
    bins, actions, settings, seed
        As of every learner with a table.
    highest_reward
        The most that one step can give.
    visits
        After which a pair is known.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        settings: Settings | None = None,
        seed: int = 0,
        *,
        highest_reward: float = 0.0,
        visits: int = 5,
    ) -> None:
        super().__init__(bins, actions, settings, seed)
        if self.settings.gamma >= 1:
            raise ValueError("R-MAX needs gamma below 1")
        self.visits = visits
        self.most = highest_reward / (1 - self.settings.gamma)
        self._counts = np.zeros((bins.count, actions), dtype=np.int64)
        self._after = np.zeros((bins.count, actions, visits), dtype=np.int64)
        self._ended = np.zeros((bins.count, actions, visits), dtype=np.bool_)
        self._rewards = np.zeros((bins.count, actions, visits))
        self.values[:] = self.most

    def parameters(self) -> dict[str, Any]:
        """Return what the learner was made with."""
        return {**super().parameters(), "visits": self.visits, "most": self.most}

    def choose(self, cell: int, mask: NDArray[np.bool_] | None = None) -> int:
        """Return the best action of the model; optimism explores, chance need not."""
        return self.best(cell, mask)

    def observe(self, transition: Transition) -> None:
        """Count one step; plan again when a pair becomes known."""
        pair = (self.bins.number(transition.state), transition.action)
        seen = self._counts[pair]
        if seen >= self.visits:
            return
        self._after[pair][seen] = self.bins.number(transition.next_state)
        self._ended[pair][seen] = transition.terminated
        self._rewards[pair][seen] = transition.reward
        self._counts[pair] = seen + 1
        if seen + 1 == self.visits:
            pairs = np.argwhere(self._counts == self.visits)
            _iterate(
                self.values, pairs, self._after, self._ended, self._rewards, self.settings.gamma
            )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        return {
            **super().arrays(),
            "counts": self._counts,
            "after": self._after,
            "ended": self._ended,
            "rewards": self._rewards,
        }

    def take(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        super().take(arrays)
        self._counts = np.array(arrays["counts"])
        self._after = np.array(arrays["after"])
        self._ended = np.array(arrays["ended"])
        self._rewards = np.array(arrays["rewards"])


@numba.njit(cache=True, nogil=True)
def _iterate(
    values: NDArray[np.float64],
    pairs: NDArray[np.int64],
    after: NDArray[np.int64],
    ended: NDArray[np.bool_],
    rewards: NDArray[np.float64],
    gamma: float,
) -> None:
    """Value iteration over the known pairs, starting from the values as they are."""
    visits = after.shape[2]
    change = 1.0
    while change > _ERROR:
        change = 0.0
        for i in range(len(pairs)):
            state, action = pairs[i]
            total = 0.0
            for k in range(visits):
                total += rewards[state, action, k]
                if not ended[state, action, k]:
                    total += gamma * values[after[state, action, k]].max()
            change = max(change, abs(total / visits - values[state, action]))
            values[state, action] = total / visits
