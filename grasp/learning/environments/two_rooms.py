"""Two rooms and a door between them."""

from __future__ import annotations

from functools import cache
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.environments.compass import MOVES, SHARES, SIDES, SOUTH, WEST, aside
from grasp.learning.environments.discretise import Bins
from grasp.learning.registration import refuse_rendering
from grasp.learning.transition import Transition

__all__ = ["TwoRooms"]

_ROWS, _COLUMNS = 5, 11
_GOAL = (1, 1)
_DOOR_ROW, _WALL = 2, 5


class TwoRooms(gymnasium.Env[NDArray[np.int64], int]):
    """Find the goal through a door: five rows, eleven columns, a wall in column 5.

    State: (row, column). Actions: north (row + 1), south, east (column + 1), west. Every step costs
    1, reaching (1, 1) costs nothing and ends the episode. Episodes start anywhere in the columns 6
    to 10. The only way is row 2.

    Parameters
    ----------
    stochastic
        With probability .2 a move goes sideways, half of it to either side.
    """

    reward_range = 1.0
    highest_reward = 0.0
    max_steps = 1000

    def __init__(self, stochastic: bool = True, *, render_mode: str | None = None) -> None:
        refuse_rendering(render_mode)
        self.stochastic = stochastic
        self.observation_space = gymnasium.spaces.Box(
            np.array([0, 0]), np.array([_ROWS - 1, _COLUMNS - 1]), dtype=np.int64
        )
        self.action_space = gymnasium.spaces.Discrete(4)  # type: ignore[assignment]
        self._state = (0, 6)
        self._ways = _leads_to()

    @staticmethod
    def bins() -> Bins:
        """Return one cell a state, with the ranges that planners receive."""
        return Bins((0, 0), (5, 10), (5, 10))

    @staticmethod
    def moved(state: tuple[int, int], direction: int) -> tuple[int, int]:
        """Return where a move leads; against a wall it leads nowhere."""
        row, column = state
        down, right = MOVES[direction]
        there = (row + down, column + right)
        if not (0 <= there[0] < _ROWS and 0 <= there[1] < _COLUMNS):
            return state
        through_wall = right and _WALL in (column, there[1]) and row != _DOOR_ROW
        along_wall = down and column == _WALL
        return state if through_wall or along_wall else there

    def outcomes(self, state: tuple[int, int], action: int) -> list[tuple[float, tuple[int, int]]]:
        """Return where an action leads, with probabilities."""
        if not self.stochastic:
            return [(1.0, self.moved(state, action))]
        directions = (action, *SIDES[action])
        return [
            (share, self.moved(state, direction))
            for share, direction in zip(SHARES, directions, strict=True)
        ]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int64], dict[str, Any]]:
        """Start somewhere in the right room."""
        super().reset(seed=seed)
        self._state = (int(self.np_random.integers(_ROWS)), int(self.np_random.integers(6, 11)))
        return np.array(self._state), {}

    def step(self, action: int) -> tuple[NDArray[np.int64], float, bool, bool, dict[str, Any]]:
        """Move."""
        chance = self.np_random.random()
        direction = aside(int(action), chance) if self.stochastic else int(action)
        self._state, place = self._ways[self._state][direction]
        ended = self._state == _GOAL
        # A copy of an array takes a third of the time of a new one.
        return place.copy(), 0.0 if ended else -1.0, ended, False, {}

    def examples(self) -> list[Transition]:
        """Return two transitions that show the door and the goal, from the real dynamics."""
        transitions = []
        for state, action in (((2, 1), SOUTH), ((2, 6), WEST)):
            self._state = state
            after, reward, ended, cut, _ = self.step(action)
            transitions.append(Transition(np.array(state), action, reward, after, ended, cut))
        return transitions


@cache
def _leads_to() -> dict[tuple[int, int], list[tuple[tuple[int, int], NDArray[np.int64]]]]:
    """Return where each direction leads from each state, also as arrays."""
    places = {(r, c): np.array((r, c)) for r in range(_ROWS) for c in range(_COLUMNS)}
    return {
        state: [(there, places[there]) for there in (TwoRooms.moved(state, d) for d in range(4))]
        for state in places
    }
