"""TEXPLORE's model of actions: a forest for each feature, the reward and termination."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.learning.agents.texplore.tree import Forest, ForestSettings, leaf_of
from grasp.learning.transition import Transition

__all__ = ["Model", "Prediction"]


_UNTRAINED_REWARD = -0.001
_MERGED = 1e-4


class Prediction:
    """The predictions of a model for every cell and action, as arrays that a planner reads.

    Parameters
    ----------
    cells, actions, features
        Sizes.
    """

    def __init__(self, cells: int, actions: int, features: int) -> None:
        self.known = np.zeros((cells, actions), dtype=np.bool_)
        self.reward = np.zeros((cells, actions))
        self.end = np.zeros((cells, actions))
        self.changes = np.zeros((cells, actions, features, 1))
        self.shares = np.zeros((cells, actions, features, 1))

    def fit(self, outcomes: int) -> None:
        """Make room for so many different changes of a feature."""
        missing = outcomes - self.changes.shape[3]
        if missing > 0:
            pad = ((0, 0), (0, 0), (0, 0), (0, missing))
            self.changes, self.shares = np.pad(self.changes, pad), np.pad(self.shares, pad)


class Model:
    """Predicts the change of each feature, the reward and the end of the episode.

    Inputs of the forests are the state and the action as one-hot columns.

    Parameters
    ----------
    low, high : (d,)
        Range of each feature.
    actions
        How many there are.
    settings
        How forests grow.
    seed
        Of the forests.
    bonus
        Weight of the forests' disagreement, added to the reward; 0 = none.
    novelty
        Weight of the distance to what was visited with the same action; 0 = none.
    """

    def __init__(
        self,
        low: Sequence[float],
        high: Sequence[float],
        actions: int,
        settings: ForestSettings,
        seed: int,
        *,
        bonus: float = 0.0,
        novelty: float = 0.0,
    ) -> None:
        self.low, self.high = np.asarray(low, float), np.asarray(high, float)
        self.actions = actions
        self.bonus, self.novelty = bonus, novelty
        inputs = len(self.low) + actions
        resolution = _MERGED * (self.high - self.low)
        seeds = [seed * 1_000_003 + k for k in range(len(self.low) + 2)]
        self.changes = [
            Forest(inputs, settings, float(r), s) for r, s in zip(resolution, seeds, strict=False)
        ]
        self.reward = Forest(inputs, settings, _MERGED, seeds[-2])
        self.end = Forest(inputs, settings, 0.5, seeds[-1])
        self._visited: list[list[FloatArray]] = [[] for _ in range(actions)]

    def _input(self, state: NDArray[Any], action: int) -> FloatArray:
        x = np.zeros(len(self.low) + self.actions)
        x[: len(self.low)] = state
        x[len(self.low) + action] = 1.0
        return x

    def learn(self, transition: Transition) -> bool:
        """Learn one step; return whether any prediction may have changed."""
        x = self._input(transition.state, transition.action)
        changed = self.reward.add(x, transition.reward)
        changed |= self.end.add(x, float(transition.terminated))
        if not transition.terminated:
            # What follows the end is nowhere; it teaches nothing about movement.
            moved = np.asarray(transition.next_state, float) - transition.state
            for forest, change in zip(self.changes, moved, strict=True):
                changed |= forest.add(x, float(change))
        if self.novelty:
            self._visited[transition.action].append(np.asarray(transition.state, float))
        return changed or bool(self.novelty)

    def predict_into(
        self, prediction: Prediction, cell: int, state: FloatArray, action: int
    ) -> None:
        """Write the prediction for a cell and action."""
        x = self._input(state, action)
        forests = [forest.predict(x) for forest in self.changes]
        prediction.fit(max((len(shares) for shares in forests), default=1))
        prediction.changes[cell, action] = 0.0
        prediction.shares[cell, action] = 0.0
        for feature, (forest, shares) in enumerate(zip(self.changes, forests, strict=True)):
            if not len(shares):
                prediction.shares[cell, action, feature, 0] = 1.0  # untrained: it stays
                continue
            prediction.changes[cell, action, feature, : len(shares)] = forest.outputs
            prediction.shares[cell, action, feature, : len(shares)] = shares
        rewards = self.reward.predict(x)
        reward = float(rewards @ self.reward.outputs) if len(rewards) else _UNTRAINED_REWARD
        ends = self.end.predict(x)
        prediction.end[cell, action] = (
            float(np.clip(ends @ self.end.outputs, 0, 1)) if len(ends) else 0.0
        )
        prediction.reward[cell, action] = reward + self._exploration(x, state, action)
        prediction.known[cell, action] = True

    def _exploration(self, x: FloatArray, state: FloatArray, action: int) -> float:
        bonus = 0.0
        if self.bonus:
            forests = [*self.changes, self.reward, self.end]
            agreement = [1 - _disagreement(forest, x) / 4.605 for forest in forests]
            bonus += self.bonus * (1 - float(np.mean(agreement)))
        if self.novelty and self._visited[action]:
            away = np.abs(np.array(self._visited[action]) - state) / (self.high - self.low)
            bonus += self.novelty * float(away.mean(axis=1).min())
        return bonus

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything learned, by name."""
        arrays: dict[str, NDArray[Any]] = {}
        for name, forest in self._named():
            arrays.update(forest.arrays(name))
        rows = [(a, *s) for a, states in enumerate(self._visited) for s in states]
        arrays["visited"] = np.array(rows, dtype=np.float64).reshape(-1, 1 + len(self.low))
        return arrays

    def take(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Take over what :meth:`arrays` returned."""
        for name, forest in self._named():
            forest.take(name, {k: v for k, v in arrays.items() if k.startswith(f"{name}_")})
        self._visited = [[] for _ in range(self.actions)]
        for row in arrays["visited"]:
            self._visited[int(row[0])].append(row[1:])

    def _named(self) -> list[tuple[str, Forest]]:
        changes = [(f"change{k}", forest) for k, forest in enumerate(self.changes)]
        return [*changes, ("reward", self.reward), ("end", self.end)]


def _disagreement(forest: Forest, x: FloatArray) -> float:
    """Return the mean Kullback-Leibler divergence over pairs of trees, zeros replaced by .01."""
    shares = []
    for tree in np.flatnonzero(forest.used):
        counts = forest.counts[tree, leaf_of(x, forest.nodes[tree], forest.limits[tree])]
        counts = counts[: len(forest.outputs)]
        shares.append(np.maximum(counts / counts.sum(), 0.01))
    pairs = [float(np.sum(p * np.log(p / q))) for p in shares for q in shares if p is not q]
    return float(np.mean(pairs)) if pairs else 0.0
