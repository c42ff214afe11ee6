"""A car too weak for its hill."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["MountainCar"]

_LOW, _HIGH = np.array([-1.2, -0.07]), np.array([0.6, 0.07])


class MountainCar(gymnasium.Env[NDArray[np.float64], int]):
    """Rock a car up a hill; every step costs 1 until it is at the top.

    State: (position, velocity). Actions: push back, nothing, push forth. The position moves by the
    velocity before the push.

    Parameters
    ----------
    stochastic
        Pushes are off by up to half a push.
    """

    reward_range = 1.0
    highest_reward = 0.0
    max_steps = 1000

    def __init__(self, stochastic: bool = True) -> None:
        self.stochastic = stochastic
        self.observation_space = gymnasium.spaces.Box(_LOW, _HIGH, dtype=np.float64)
        self.action_space = gymnasium.spaces.Discrete(3)  # type: ignore[assignment]
        self._state = np.array([-0.5, 0.0])

    @staticmethod
    def bins(parts: int = 20) -> Bins:
        """Return a grid of so many widths in either dimension."""
        return Bins(tuple(_LOW), tuple(_HIGH), (parts, parts))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start anywhere but at the top."""
        super().reset(seed=seed)
        position, velocity = self.np_random.uniform((-1.2, -0.07), (0.59, 0.07))
        self._state = np.array([position, velocity])
        return self._state.copy(), {}

    def step(self, action: int) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Push."""
        position, velocity = self._state
        noise = self.np_random.uniform(-0.5, 0.5) if self.stochastic else 0.0
        faster = velocity + 0.001 * (action - 1 + noise) - 0.0025 * np.cos(3 * position)
        faster = float(np.clip(faster, _LOW[1], _HIGH[1]))
        there = position + velocity
        if there < _LOW[0] and faster < 0:
            faster = 0.0
        there = float(np.clip(there, _LOW[0], _HIGH[0]))
        self._state = np.array([there, faster])
        ended = there >= _HIGH[0]
        return self._state.copy(), 0.0 if ended else -1.0, ended, False, {}

    def examples(self) -> list[Transition]:
        """Return one transition near the top and a random one for each action."""
        found = [self._example(np.array([0.58, 0.03]), 2)]
        for action in range(3):
            state = self.np_random.uniform((-1.2, -0.07), (0.59, 0.07))
            found.append(self._example(np.asarray(state), action))
        return found

    def _example(self, state: NDArray[np.float64], action: int) -> Transition:
        self._state = state
        after, reward, ended, cut, _ = self.step(action)
        return Transition(state, action, reward, after, ended, cut)
