"""Processor time of a step of the learners with a table, beside plain loops of the same rules.

    python tests/benchmarks/learning/bench_learner_speed.py [--steps 40000] [--rounds 5]

Ours is `run_episodes` in the gymnasium environment of the two rooms, as users run it. The plain
sides are loops over lists with `random`, that of R-MAX over arrays of numpy, without checks or
interfaces: one in the same environment, one in rooms that are a plain function, too. All live
through the same number of steps, in turns; the medians of the rounds are compared.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from grasp.learning.agents import Dyna, QLearning, RMax, Sarsa, run_episodes
from grasp.learning.agents.tabular import Settings
from grasp.learning.environments import TwoRooms

_ALPHA, _GAMMA, _EPSILON, _LAMBDA, _REPLAYS = 0.3, 0.99, 0.1, 0.1, 1000
_MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1))
_SIDES = ((2, 3), (2, 3), (0, 1), (0, 1))
_LONGEST = 1000
_VISITS, _ERROR = 5, 1e-4
_WARM = 300


class Rooms(Protocol):
    """Two rooms, with numbers as states."""

    def start(self) -> int:
        """Begin an episode."""

    def move(self, state: int, action: int) -> tuple[int, float, bool]:
        """Return the next state, the reward, and whether the episode ended."""


class Gymnasium:
    """The environment that ours acts in."""

    def __init__(self, seed: int) -> None:
        self._world = TwoRooms()
        self._world.reset(seed=seed)

    def start(self) -> int:
        """Begin an episode."""
        row, column = self._world.reset()[0].tolist()
        return int(row * 11 + column)

    def move(self, state: int, action: int) -> tuple[int, float, bool]:
        """Return the next state, the reward, and whether the episode ended."""
        after, reward, ended, _, _ = self._world.step(action)
        row, column = after.tolist()
        return row * 11 + column, reward, ended


class Plain:
    """The same rooms in a few lines."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)

    def start(self) -> int:
        """Begin an episode."""
        return self._rng.randrange(5) * 11 + self._rng.randrange(6, 11)

    def move(self, state: int, action: int) -> tuple[int, float, bool]:
        """Return the next state, the reward, and whether the episode ended."""
        return _move(state, action, self._rng.random())


def _move(state: int, action: int, chance: float) -> tuple[int, float, bool]:
    if chance >= 0.8:
        action = _SIDES[action][chance >= 0.9]
    row, column = divmod(state, 11)
    down, right = _MOVES[action]
    there, beside = row + down, column + right
    free = 0 <= there < 5 and 0 <= beside < 11
    if free and right:
        free = row == 2 or (column != 5 and beside != 5)
    elif free:
        free = column != 5
    if free:
        state = there * 11 + beside
    return (state, 0.0, True) if state == 12 else (state, -1.0, False)


def _choose(row: list[float], rng: random.Random) -> int:
    if rng.random() < _EPSILON:
        return rng.randrange(4)
    top = max(row)
    best = [a for a, value in enumerate(row) if value == top]
    return best[0] if len(best) == 1 else rng.choice(best)


def plain_q_learning(rooms: Rooms, steps: int, seed: int, replays: int = 0) -> None:
    """Q-learning, with replays Dyna."""
    rng = random.Random(seed)
    table = [[0.0] * 4 for _ in range(55)]
    seen: list[tuple[int, int, int, float, bool]] = []
    state, length = rooms.start(), 0
    action = _choose(table[state], rng)
    for _ in range(steps):
        after, reward, ended = rooms.move(state, action)
        length += 1
        follows = _choose(table[after], rng)
        target = reward if ended else reward + _GAMMA * max(table[after])
        table[state][action] += _ALPHA * (target - table[state][action])
        if replays:
            seen.append((state, action, after, reward, ended))
            for s, a, s_next, r, end in rng.choices(seen, k=replays):
                goal = r if end else r + _GAMMA * max(table[s_next])
                table[s][a] += _ALPHA * (goal - table[s][a])
        state, action = after, follows
        if ended or length == _LONGEST:
            state, length = rooms.start(), 0
            action = _choose(table[state], rng)


def plain_sarsa(rooms: Rooms, steps: int, seed: int) -> None:
    """Sarsa whose traces pull towards one target."""
    rng = random.Random(seed)
    table = [[0.0] * 4 for _ in range(55)]
    traces: dict[tuple[int, int], float] = {}
    state, length = rooms.start(), 0
    action = _choose(table[state], rng)
    for _ in range(steps):
        after, reward, ended = rooms.move(state, action)
        length += 1
        follows = _choose(table[after], rng)
        target = reward if ended else reward + _GAMMA * table[after][follows]
        traces[state, action] = 1.0
        for (s, a), trace in list(traces.items()):
            table[s][a] += _ALPHA * trace * (target - table[s][a])
            traces[s, a] = trace * _LAMBDA
            if traces[s, a] < 1e-6:
                del traces[s, a]
        state, action = after, follows
        if ended or length == _LONGEST:
            traces.clear()
            state, length = rooms.start(), 0
            action = _choose(table[state], rng)


def plain_rmax(rooms: Rooms, steps: int, seed: int) -> None:
    """R-MAX with a model in arrays of numpy, and value iteration over all known pairs at once."""
    rng = np.random.default_rng(seed)
    values, counts = np.zeros((55, 4)), np.zeros((55, 4), int)
    after, goes_on = np.zeros((55, 4, _VISITS), int), np.zeros((55, 4, _VISITS))
    rewards = np.zeros((55, 4, _VISITS))
    state, length = rooms.start(), 0
    for _ in range(steps):
        best = np.flatnonzero(values[state] == values[state].max())
        action = int(best[0] if len(best) == 1 else rng.choice(best))
        there, reward, ended = rooms.move(state, action)
        length += 1
        seen = counts[state, action]
        if seen < _VISITS:
            after[state, action, seen], rewards[state, action, seen] = there, reward
            goes_on[state, action, seen] = not ended
            counts[state, action] = seen + 1
            if seen + 1 == _VISITS:
                pairs = counts == _VISITS
                change = 1.0
                while change > _ERROR:
                    promised = goes_on[pairs] * values.max(1)[after[pairs]]
                    better = (rewards[pairs] + _GAMMA * promised).mean(1)
                    change = float(np.abs(better - values[pairs]).max())
                    values[pairs] = better
        state = there
        if ended or length == _LONGEST:
            state, length = rooms.start(), 0


_ROWS: dict[str, tuple[Callable[[int], Any], Callable[[Rooms, int, int], None], int]] = {
    "Q-learning": (lambda s: QLearning(TwoRooms.bins(), 4, seed=s), plain_q_learning, 1),
    "Sarsa": (lambda s: Sarsa(TwoRooms.bins(), 4, seed=s), plain_sarsa, 1),
    "Dyna": (
        lambda s: Dyna(TwoRooms.bins(), 4, seed=s, replays=_REPLAYS),
        lambda rooms, steps, s: plain_q_learning(rooms, steps, s, _REPLAYS),
        20,
    ),
    "R-MAX": (
        lambda s: RMax(TwoRooms.bins(), 4, Settings(gamma=_GAMMA), seed=s, visits=_VISITS),
        plain_rmax,
        1,
    ),
}


def ours(agent: Any, steps: int, seed: int) -> int:
    """Live so many steps or a few more, to the end of an episode; return how many."""
    lived = 0
    for episode in run_episodes(agent, TwoRooms(), steps, seed=seed):
        lived += episode.steps
        if lived >= steps:
            break
    return lived


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=40_000)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print(f"{'us of the processor a step':28}{'ours':>8}{'plain, same world':>20}{'plain':>16}")
    for name, (make, plain, dearer) in _ROWS.items():
        steps = options.steps // dearer
        ours(make(0), _WARM, 0)
        times = []
        for seed in range(options.rounds):
            agent, rooms = make(seed), (Gymnasium(seed), Plain(seed))
            marks = [time.process_time()]
            lived = [ours(agent, steps, seed)]
            marks.append(time.process_time())
            for world in rooms:
                plain(world, steps, seed)
                lived.append(steps)
                marks.append(time.process_time())
            times.append(1e6 * np.diff(marks) / lived)
        mine, same, bare = np.median(times, axis=0)
        print(
            f"{name:28}{mine:>8.2f}{f'{same:.2f} ({mine / same:.2f} x)':>20}"
            f"{f'{bare:.2f} ({mine / bare:.2f} x)':>16}",
            flush=True,
        )


if __name__ == "__main__":
    main()
