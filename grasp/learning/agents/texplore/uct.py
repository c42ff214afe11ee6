"""UCT(lambda): Monte Carlo tree search over the model's predictions (Hester and Stone 2013)."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.learning.agents.texplore.model import Prediction
from grasp.learning.agents.texplore.tree import uniform
from grasp.learning.environments.discretise import Bins

__all__ = ["Planner"]

Ints = NDArray[np.int64]

_DEEPEST = 200
_RATE = 10.0
_MAX_VISITS = 10.0


class Planner:
    """Values of cells and actions, improved by rollouts.

    Parameters
    ----------
    bins
        Numbers the states.
    actions
        How many there are.
    reward_range
        Largest reward less smallest.
    gamma, fading
        Discount; lambda of the returns.
    seed
        Of the rollouts.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        reward_range: float,
        gamma: float,
        fading: float,
        seed: int,
    ) -> None:
        self.bins = bins
        self.gamma, self.fading = gamma, fading
        self.scale = 2 * max(reward_range, 1.0) / (1 - gamma)
        self.random = np.array([seed * 2 + 1], dtype=np.uint64)
        rng = np.random.default_rng((seed, 1))
        self.values = rng.uniform(0, 0.01, (bins.count, actions))
        self.visits = np.ones(bins.count)
        self.tries = np.ones((bins.count, actions))

    def model_changed(self) -> None:
        """Trust what was found with the model before only so much."""
        np.minimum(self.visits, _MAX_VISITS * self.tries.shape[1], out=self.visits)
        np.minimum(self.tries, _MAX_VISITS, out=self.tries)

    def rollouts(
        self,
        state: FloatArray,
        number: int,
        predictions: Prediction,
        predict: Callable[[int, int], None],
    ) -> None:
        """Run rollouts from a state.

        Parameters
        ----------
        state : (d,)
            Where to start.
        number
            How many.
        predictions
            Read; what is missing there is asked for.
        predict
            Called with a cell and an action, fills the gap.
        """
        shape = np.array(self.bins.shape, dtype=np.int64)
        done = 0
        while done < number:
            done, cell, action = _roll(
                state, number, done, predictions.known, predictions.reward, predictions.end,
                predictions.changes, predictions.shares, self.values, self.visits, self.tries,
                self.bins.low, self.bins.high, self.bins.width, self.bins.first, shape,
                self.gamma, self.fading, self.scale, self.random,
            )  # fmt: skip
            if cell >= 0:
                predict(cell, action)


@numba.njit(cache=True, nogil=True)
def _cell(state: FloatArray, width: FloatArray, first: Ints, shape: Ints) -> int:
    number = 0
    for k in range(len(state)):
        half = width[k] / 2 if state[k] >= 0 else -width[k] / 2
        tiny = 1e-9 if state[k] >= 0 else -1e-9
        index = int((state[k] + half) / width[k] + tiny) - first[k]
        number = number * shape[k] + min(max(index, 0), shape[k] - 1)
    return number


@numba.njit(cache=True, nogil=True)
def _best(values: FloatArray, visits: float, tries: FloatArray, scale: float) -> int:
    best, action = -np.inf, 0
    for a in range(len(values)):
        value = values[a] + scale * np.sqrt(np.log(visits) / tries[a])
        if value > best:
            best, action = value, a
    return action


@numba.njit(cache=True, nogil=True)
def _roll(
    start: FloatArray,
    number: int,
    done: int,
    is_predicted: NDArray[np.bool_],
    rewards: FloatArray,
    ends: FloatArray,
    changes: FloatArray,
    shares: FloatArray,
    values: FloatArray,
    visits: FloatArray,
    tries: FloatArray,
    low: FloatArray,
    high: FloatArray,
    width: FloatArray,
    first: Ints,
    shape: Ints,
    gamma: float,
    fading: float,
    scale: float,
    random: NDArray[np.uint64],
) -> tuple[int, int, int]:
    """Run rollouts until enough are done, or a prediction is missing.

    Returns
    -------
    (done, cell, action)
        Cell and action of the missing prediction; -1 if none is.
    """
    cells = np.empty(_DEEPEST + 1, dtype=np.int64)
    actions = np.empty(_DEEPEST + 1, dtype=np.int64)
    on_path = np.zeros(len(visits), dtype=np.int64)
    state, after = np.empty(len(start)), np.empty(len(start))
    while done < number:
        state[:] = start
        depth = 0
        result = 0.0
        ended = False
        while True:
            cell = _cell(state, width, first, shape)
            if depth > _DEEPEST:
                result = values[cell].max()
                break
            action = _best(values[cell], visits[cell], tries[cell], scale)
            if not is_predicted[cell, action]:
                for d in range(depth):
                    on_path[cells[d]] = 0
                return done, cell, action
            cells[depth], actions[depth] = cell, action
            depth += 1
            if uniform(random) < ends[cell, action]:
                ended = True
                break
            on_path[cell] += 1
            inside = True
            for k in range(len(state)):
                drawn = uniform(random)
                j = 0
                while j < shares.shape[3] - 1 and drawn >= shares[cell, action, k, j]:
                    drawn -= shares[cell, action, k, j]
                    j += 1
                after[k] = state[k] + changes[cell, action, k, j]
                inside = inside and low[k] - 1e-9 <= after[k] <= high[k] + 1e-9
            if inside:
                state[:] = after
        for d in range(depth - 1, -1, -1):
            cell, action = cells[d], actions[d]
            rate = _RATE / (tries[cell, action] + _RATE)
            last = ended and d == depth - 1
            result = rewards[cell, action] + (0.0 if last else gamma * result)
            if last or on_path[cell] == 1:
                values[cell, action] += rate * (result - values[cell, action])
                visits[cell] += 1
                tries[cell, action] += 1
                if not last:
                    result = fading * result + (1 - fading) * values[cell].max()
            if not last:
                on_path[cell] -= 1
        done += 1
    return done, -1, -1
