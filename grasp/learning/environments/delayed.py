"""Actuators that carry out an action some steps after it was chosen."""

from __future__ import annotations

from collections import deque
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.discretise import Bins

__all__ = ["DelayedActions"]


class DelayedActions(gymnasium.Wrapper[NDArray[Any], int, NDArray[Any], int]):
    """Carries out each action ``steps`` steps after it was chosen.

    What a state leads to then depends on the actions that are still to come. TEXPLORE's answer is
    to tell the learner of them (Hester and Stone 2013, 3.3): with ``tells`` they follow the
    environment's own state, the one that is carried out next first.

    Parameters
    ----------
    environment
        With a vector (d,) as state and numbered actions.
    steps
        By how many steps actions are late; 0 = not at all.
    tells
        Whether the state has the actions to come.
    idle
        Action that is carried out until the first chosen one is.

    Raises
    ------
    ValueError
        ``steps`` is negative, or the environment's actions are not numbered.

    Examples
    --------
    >>> from grasp.learning.environments import TwoRooms
    >>> late = DelayedActions(TwoRooms(stochastic=False), 2)
    >>> state, _ = late.reset(seed=1)
    >>> state.tolist()
    [2, 8, 0, 0]
    >>> [late.step(3)[0].tolist() for _ in range(3)]
    [[3, 8, 0, 3], [4, 8, 3, 3], [4, 7, 3, 3]]
    """

    def __init__(
        self, environment: gymnasium.Env[Any, int], steps: int, tells: bool = True, idle: int = 0
    ) -> None:
        super().__init__(environment)
        actions, states = environment.action_space, environment.observation_space
        if steps < 0 or not isinstance(actions, gymnasium.spaces.Discrete):
            raise ValueError(f"delays numbered actions by 0 steps or more, got {steps}, {actions}")
        self.steps, self.tells, self.idle = steps, tells, idle
        self._coming: deque[int] = deque()
        if tells:
            assert isinstance(states, gymnasium.spaces.Box)
            self.observation_space = gymnasium.spaces.Box(
                np.append(states.low, [0] * steps),
                np.append(states.high, [int(actions.n) - 1] * steps),
                dtype=states.dtype.type,
            )  # fmt: skip

    def bins(self, own: Bins) -> Bins:
        """Return the cells of the state that is told, given those of the environment's own."""
        if not self.tells:
            return own
        assert isinstance(self.action_space, gymnasium.spaces.Discrete)
        last = int(self.action_space.n) - 1
        low, high = own.low.tolist(), own.high.tolist()
        parts = np.rint((own.high - own.low) / own.width).astype(int).tolist()
        return Bins(
            [*low, *[0.0] * self.steps], [*high, *[float(last)] * self.steps],
            [*parts, *[last] * self.steps],
        )  # fmt: skip

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Begin an episode; nothing has been chosen yet."""
        state, info = self.env.reset(seed=seed, options=options)
        self._coming = deque([self.idle] * self.steps)
        return self._told(state), info

    def step(self, action: int) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Choose an action, and carry out the one that was chosen ``steps`` steps ago."""
        self._coming.append(int(action))
        state, reward, ended, cut, info = self.env.step(self._coming.popleft())
        return self._told(state), float(reward), ended, cut, info

    def _told(self, state: NDArray[Any]) -> NDArray[Any]:
        if not self.tells:
            return state
        return np.append(state, np.array(self._coming, dtype=state.dtype))
