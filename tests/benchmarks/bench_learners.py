"""Learners on worlds with known returns, beside the published implementation.

    python tests/benchmarks/bench_learners.py [--seeds 5] [--taxi]

The published figures are of the C++ implementation of TEXPLORE and its companions
(rl-texplore-ros-pkg), mean return an episode over 20 seeds and deviation between seeds. Prints
both sides and the difference in standard errors.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from grasp.learning.agents import Dyna, QLearning, RMax, Sarsa, run_episodes
from grasp.learning.agents.texplore import Texplore
from grasp.learning.environments import Taxi, TwoRooms

Cell = tuple[int, int, float, float]
_ROOMS, _TAXI = TwoRooms.bins(), Taxi.bins()

# name, world, agent, (first episode, last, published mean, deviation)
_ROWS: list[tuple[str, Callable[[], Any], Callable[[int], Any], list[Cell]]] = [
    ("two rooms, TEXPLORE", TwoRooms, lambda s: Texplore(_ROOMS, 4, seed=s),
     [(1, 10, -25.9, 16.9), (11, 20, -14.7, 1.9), (21, 50, -13.4, 0.8), (51, 60, -12.6, 1.3)]),
    ("two rooms, Dyna", TwoRooms, lambda s: Dyna(_ROOMS, 4, seed=s),
     [(1, 10, -44.5, 6.4), (11, 20, -15.9, 2.3), (21, 50, -14.3, 1.3), (51, 60, -14.2, 1.8)]),
    ("two rooms, R-MAX", TwoRooms, lambda s: RMax(_ROOMS, 4, seed=s),
     [(1, 10, -105.2, 7.7), (11, 20, -20.4, 4.9), (21, 50, -13.2, 2.7), (101, 150, -12.3, 2.7)]),
    ("two rooms, Sarsa", TwoRooms, lambda s: Sarsa(_ROOMS, 4, seed=s),
     [(1, 10, -174.2, 21.3), (11, 20, -76.5, 20.1), (21, 50, -43.5, 6.6), (351, 400, -14.3, 1.2)]),
    ("two rooms, Q-learning", TwoRooms, lambda s: QLearning(_ROOMS, 4, seed=s),
     [(1, 10, -174.1, 16.7), (11, 20, -80.9, 23.3), (21, 50, -49.0, 5.2), (351, 400, -13.9, 1.1)]),
]  # fmt: skip
_TAXI_ROWS: list[tuple[str, Callable[[], Any], Callable[[int], Any], list[Cell]]] = [
    ("taxi, Q-learning", Taxi, lambda s: QLearning(_TAXI, 6, seed=s),
     [(1, 10, -872, 102), (11, 20, -509, 93), (21, 50, -402, 29), (351, 400, -17.5, 3.8)]),
    ("taxi, deterministic, Q-learning", lambda: Taxi(False), lambda s: QLearning(_TAXI, 6, seed=s),
     [(1, 10, -859, 102), (11, 20, -530, 93), (21, 50, -347, 29), (351, 400, -7.3, 2.0)]),
]  # fmt: skip


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
    parser.add_argument("--taxi", action="store_true", help="also the taxi, a minute more")
    options = parser.parse_args()
    print(f"{'':34}{'episodes':>10}{'ours':>18}{'published':>18}{'errors apart':>14}")
    for name, world, make, cells in _ROWS + (_TAXI_ROWS if options.taxi else []):
        started = time.process_time()
        last = max(cell[1] for cell in cells)
        lives = np.array([returns(world, make(s), last, s) for s in range(options.seeds)])
        for first, end, mean, deviation in cells:
            ours = lives[:, first - 1 : end].mean(axis=1)
            spread = ours.std(ddof=1) if len(ours) > 1 else float("nan")
            error = np.sqrt(spread**2 / len(ours) + deviation**2 / 20)
            print(
                f"{name if first == 1 else '':34}{f'{first}-{end}':>10}"
                f"{f'{ours.mean():.1f} +- {spread:.1f}':>18}{f'{mean} +- {deviation}':>18}"
                f"{abs(ours.mean() - mean) / error:>14.1f}",
                flush=True,
            )
        if name.endswith("TEXPLORE"):
            median = np.median(lives[:, :10].mean(axis=1))
            print(f"{'':34}{'1-10':>10}{f'median {median:.1f}':>18}{'median -20.3':>18}")
        print(f"{'':34}{'':>10}{f'{time.process_time() - started:.0f} CPU s':>18}")


if __name__ == "__main__":
    main()
