"""A car too weak for its hill."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.discretise import Bins
from grasp.learning.registration import refuse_rendering
from grasp.learning.transition import Transition

__all__ = ["MountainCar"]

_LEFT, _TOP = -1.2, 0.6
_SLOWEST, _FASTEST = -0.07, 0.07
_LOW, _HIGH = np.array([_LEFT, _SLOWEST]), np.array([_TOP, _FASTEST])


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

    def __init__(self, stochastic: bool = True, *, render_mode: str | None = None) -> None:
        refuse_rendering(render_mode)
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
        position, velocity = self._state.tolist()
        noise = self.np_random.random() - 0.5 if self.stochastic else 0.0
        push = 0.001 * (int(action) - 1 + noise)
        faster = velocity + push - 0.0025 * float(np.cos(3 * position))
        faster = min(max(faster, _SLOWEST), _FASTEST)
        there = position + velocity
        if there < _LEFT and faster < 0:
            faster = 0.0
        there = min(max(there, _LEFT), _TOP)
        self._state = np.array([there, faster])
        ended = there >= _TOP
        return self._state.copy(), 0.0 if ended else -1.0, ended, False, {}

    def examples(self) -> list[Transition]:
        """Return one transition near the top and a random one for each action."""
        transitions = [self._example(np.array([0.58, 0.03]), 2)]
        for action in range(3):
            state = self.np_random.uniform((-1.2, -0.07), (0.59, 0.07))
            transitions.append(self._example(np.asarray(state), action))
        return transitions

    def _example(self, state: NDArray[np.float64], action: int) -> Transition:
        self._state = state
        after, reward, ended, cut, _ = self.step(action)
        return Transition(state, action, reward, after, ended, cut)
