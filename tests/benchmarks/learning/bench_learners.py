"""Learners on worlds with known returns, beside the published implementation.

    python tests/benchmarks/learning/bench_learners.py [--seeds 5] [--first 0] [--only taxi]

The published figures are of the C++ implementation of TEXPLORE and its companions
(rl-texplore-ros-pkg): mean return an episode over seeds, and deviation between seeds. Prints both
sides and the difference in standard errors; below TEXPLORE as published also what ours earns more,
paired, with its 95 % interval over seeds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import bootstrap

from grasp.learning.agents import Dyna, QLearning, RMax, Sarsa, run_episodes
from grasp.learning.agents.texplore import Texplore, TexploreSettings
from grasp.learning.agents.texplore.tree import ForestSettings
from grasp.learning.environments import MountainCar, Taxi, TwoRooms

_ROOMS, _TAXI, _CAR = TwoRooms.bins(), Taxi.bins(), MountainCar.bins()
_NONE = float("nan")


@dataclass(frozen=True)
class Row:
    """A learner in a world; cells: first and last episode, published mean and deviation."""

    name: str
    world: Callable[[], Any]
    agent: Callable[[int], Any]
    seeds: int
    cells: tuple[tuple[int, int, float, float], ...]


_PUBLISHED = (
    (1, 10, -25.9, 16.9), (11, 20, -14.7, 1.9), (21, 50, -13.4, 0.8), (51, 60, -12.6, 1.3),
)  # fmt: skip
_AS_PUBLISHED = TexploreSettings(forest=ForestSettings(smoothing=0.0))
_ROWS = (
    Row("two rooms, TEXPLORE", TwoRooms, lambda s: Texplore(_ROOMS, 4, seed=s), 20, _PUBLISHED),
    Row("two rooms, TEXPLORE, as published", TwoRooms,
        lambda s: Texplore(_ROOMS, 4, _AS_PUBLISHED, seed=s), 20, _PUBLISHED),
    Row("two rooms, Dyna", TwoRooms, lambda s: Dyna(_ROOMS, 4, seed=s), 20,
        ((1, 10, -44.5, 6.4), (11, 20, -15.9, 2.3), (21, 50, -14.3, 1.3), (51, 60, -14.2, 1.8))),
    Row("two rooms, R-MAX", TwoRooms, lambda s: RMax(_ROOMS, 4, seed=s), 20,
        ((1, 10, -105.2, 7.7), (11, 20, -20.4, 4.9), (21, 50, -13.2, 2.7),
         (101, 150, -12.3, 2.7))),
    Row("two rooms, Sarsa", TwoRooms, lambda s: Sarsa(_ROOMS, 4, seed=s), 20,
        ((1, 10, -174.2, 21.3), (11, 20, -76.5, 20.1), (21, 50, -43.5, 6.6),
         (351, 400, -14.3, 1.2))),
    Row("two rooms, Q-learning", TwoRooms, lambda s: QLearning(_ROOMS, 4, seed=s), 20,
        ((1, 10, -174.1, 16.7), (11, 20, -80.9, 23.3), (21, 50, -49.0, 5.2),
         (351, 400, -13.9, 1.1))),
    Row("still two rooms, R-MAX", lambda: TwoRooms(False), lambda s: RMax(_ROOMS, 4, seed=s), 5,
        ((1, 10, -98.3, _NONE), (11, 20, -12.5, _NONE), (51, 100, -8.4, _NONE))),
    Row("still two rooms, TEXPLORE", lambda: TwoRooms(False),
        lambda s: Texplore(_ROOMS, 4, seed=s), 5,
        ((1, 10, -13.1, _NONE), (11, 20, -9.6, _NONE), (21, 40, -10.2, _NONE))),
    Row("still two rooms, TEXPLORE, as published", lambda: TwoRooms(False),
        lambda s: Texplore(_ROOMS, 4, _AS_PUBLISHED, seed=s), 5,
        ((1, 10, -13.1, _NONE), (11, 20, -9.6, _NONE), (21, 40, -10.2, _NONE))),
    Row("still two rooms, Q-learning", lambda: TwoRooms(False),
        lambda s: QLearning(_ROOMS, 4, seed=s), 5,
        ((1, 10, -137.7, _NONE), (11, 20, -62.7, _NONE), (981, 1000, -9.4, _NONE))),
    Row("taxi, Q-learning", Taxi, lambda s: QLearning(_TAXI, 6, seed=s), 10,
        ((1, 10, -872, 102), (11, 20, -509, 93), (21, 50, -402, 29), (351, 400, -17.5, 3.8))),
    Row("taxi, Sarsa", Taxi, lambda s: Sarsa(_TAXI, 6, seed=s), 10,
        ((1, 10, -938, 108), (11, 20, -511, 89), (21, 50, -422, 52), (351, 400, -30.5, 7.6))),
    Row("taxi, R-MAX", Taxi, lambda s: RMax(_TAXI, 6, seed=s, highest_reward=20), 3,
        ((1, 10, -1843, _NONE), (11, 20, -1064, _NONE), (21, 50, -494, _NONE),
         (101, 150, -9.5, _NONE))),
    Row("still taxi, Q-learning", lambda: Taxi(False), lambda s: QLearning(_TAXI, 6, seed=s), 10,
        ((1, 10, -859, _NONE), (11, 20, -530, _NONE), (21, 50, -347, _NONE),
         (351, 400, -7.3, 2.0))),
    Row("still taxi, Sarsa", lambda: Taxi(False), lambda s: Sarsa(_TAXI, 6, seed=s), 10,
        ((1, 10, -829, _NONE), (11, 20, -516, _NONE), (21, 50, -385, _NONE),
         (351, 400, -10.1, 3.8))),
    Row("still taxi, R-MAX", lambda: Taxi(False),
        lambda s: RMax(_TAXI, 6, seed=s, highest_reward=20), 3,
        ((1, 10, -1918, _NONE), (11, 20, -924, _NONE), (21, 50, -471, _NONE),
         (101, 150, 4.9, _NONE))),
    Row("mountain car, Q-learning", MountainCar, lambda s: QLearning(_CAR, 3, seed=s), 10,
        ((1, 10, -392, 35), (11, 20, -317, 52), (21, 50, -275, 67), (451, 500, -116, 31))),
)  # fmt: skip


def returns(make_world: Callable[[], Any], agent: Any, episodes: int, seed: int) -> list[float]:
    """Return the undiscounted returns of one life."""
    world = make_world()
    world.reset(seed=1000 + seed)
    if hasattr(world, "examples"):
        agent.learn_examples(world.examples())
    return [episode.reward for episode in run_episodes(agent, world, episodes, seed=seed)]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", default="", help="rows whose names hold this")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    print(f"{'':34}{'episodes':>10}{'ours':>18}{'published':>18}{'errors apart':>14}")
    before = np.empty((0, 0))
    for row in _ROWS:
        if options.only not in row.name:
            continue
        started = time.process_time()
        last = max(cell[1] for cell in row.cells)
        lives = np.array([returns(row.world, row.agent(s), last, s) for s in seeds])
        for first, end, mean, deviation in row.cells:
            ours = lives[:, first - 1 : end].mean(axis=1)
            spread = ours.std(ddof=1) if len(ours) > 1 else _NONE
            # Where no deviation is published, ours stands for both.
            theirs = spread if np.isnan(deviation) else deviation
            error = np.sqrt(spread**2 / len(ours) + theirs**2 / row.seeds)
            published = f"{mean}" if np.isnan(deviation) else f"{mean} +- {deviation}"
            print(
                f"{row.name if first == 1 else '':34}{f'{first}-{end}':>10}"
                f"{f'{ours.mean():.1f} +- {spread:.1f}':>18}{published:>18}"
                f"{abs(ours.mean() - mean) / error:>14.1f}",
                flush=True,
            )
            if row.name.endswith("as published") and len(ours) > 1:
                change = before[:, first - 1 : end].mean(axis=1) - ours
                ends = bootstrap((change,), np.mean, rng=0).confidence_interval
                print(f"{'':44}paired {change.mean():+.2f} [{ends.low:+.2f}, {ends.high:+.2f}]")
        before = lives
        if row.name == "two rooms, TEXPLORE":
            median = np.median(lives[:, :10].mean(axis=1))
            print(f"{'':34}{'1-10':>10}{f'median {median:.1f}':>18}{'median -20.3':>18}")
        print(f"{'':34}{'':>10}{f'{time.process_time() - started:.0f} CPU s':>18}")


if __name__ == "__main__":
    main()
