"""Fetch a passenger and bring them where they want to go, who may change their mind."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.compass import MOVES, aside
from grasp.learning.environments.discretise import Bins
from grasp.learning.registration import refuse_rendering

__all__ = ["Taxi"]

LANDMARKS = ((4, 0), (0, 3), (4, 4), (0, 0))
"""(row, column); passenger and destination are numbers of landmarks."""
IN_TAXI = 4
PICK_UP, PUT_DOWN = 4, 5
_SIZE = 5
# (row, column) whose eastern side is a wall
_WALLS = {(0, 0), (1, 0), (0, 2), (1, 2), (3, 1), (4, 1)}
_CHANGES_MIND = 0.3


class Taxi(gymnasium.Env[NDArray[np.int64], int]):
    """Dietterich's taxi, with the fickle passenger of Hester and Stone.

    State: (row, column, passenger 0..3 or 4 = in the taxi, destination 0..3). Actions: north,
    south, east, west, pick up, put down. Moves cost 1, a pick-up or put-down at the wrong place
    10; bringing the passenger to the destination earns 20 and ends the episode.

    Parameters
    ----------
    stochastic
        Moves go sideways with probability .2, and on the first move after a pick-up that leads
        somewhere the passenger changes the destination with probability .3.
    """

    reward_range = 30.0
    highest_reward = 20.0
    max_steps = 1000

    def __init__(self, stochastic: bool = True, *, render_mode: str | None = None) -> None:
        refuse_rendering(render_mode)
        self.stochastic = stochastic
        self.observation_space = gymnasium.spaces.Box(
            np.zeros(4, dtype=np.int64), np.array([4, 4, 4, 3]), dtype=np.int64
        )
        self.action_space = gymnasium.spaces.Discrete(6)  # type: ignore[assignment]
        self._state = (0, 0, 0, 1)
        self._fresh = False

    @staticmethod
    def bins() -> Bins:
        """Return one cell a state."""
        return Bins((0, 0, 0, 0), (4, 4, 4, 3), (4, 4, 4, 3))

    @staticmethod
    def moved(row: int, column: int, direction: int) -> tuple[int, int]:
        """Return where a move leads; against a wall it leads nowhere."""
        down, right = MOVES[direction]
        there = (row + down, column + right)
        if not (0 <= there[0] < _SIZE and 0 <= there[1] < _SIZE):
            return row, column
        if right and (row, min(column, there[1])) in _WALLS:
            return row, column
        return there

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int64], dict[str, Any]]:
        """Start anywhere; the destination is not where the passenger is."""
        super().reset(seed=seed)
        rng = self.np_random
        passenger = int(rng.integers(4))
        destination = int((passenger + rng.integers(1, 4)) % 4)
        self._state = (int(rng.integers(_SIZE)), int(rng.integers(_SIZE)), passenger, destination)
        self._fresh = False
        return np.array(self._state), {}

    def step(self, action: int) -> tuple[NDArray[np.int64], float, bool, bool, dict[str, Any]]:
        """Drive, pick up or put down."""
        if action == PICK_UP:
            reward, ended = self._pick_up(), False
        elif action == PUT_DOWN:
            reward, ended = self._put_down()
        else:
            reward, ended = self._drive(int(action)), False
        return np.array(self._state), reward, ended, False, {}

    def _drive(self, action: int) -> float:
        row, column, passenger, destination = self._state
        direction = action
        if self.stochastic:
            direction = aside(action, self.np_random.random())
        there = self.moved(row, column, direction)
        if self.stochastic and self._fresh and there != (row, column):
            self._fresh = False
            if self.np_random.random() < _CHANGES_MIND:
                destination = int((destination + self.np_random.integers(1, 4)) % 4)
        self._state = (*there, passenger, destination)
        return -1.0

    def _pick_up(self) -> float:
        row, column, passenger, destination = self._state
        if passenger == IN_TAXI or (row, column) != LANDMARKS[passenger]:
            return -10.0
        self._state = (row, column, IN_TAXI, destination)
        self._fresh = True
        return -1.0

    def _put_down(self) -> tuple[float, bool]:
        row, column, passenger, destination = self._state
        if passenger != IN_TAXI or (row, column) != LANDMARKS[destination]:
            return -10.0, False
        self._state = (row, column, destination, destination)
        return 20.0, True
