"""Whether a choice by the best mean costs less than samples, where causes tell grasps apart.

    python -m tests.benchmarks.learning.bench_causes_by_mean FOLDER [--fleets 30] [--seed 1]

The folder is of a finished `rtask study unforeseen`. Fleets of two robots are replayed from it,
each under three conditions with the same luck: without causes; with causes, of the five best
grasps the one whose sample of its belief is largest (`sampled`); and with causes, by the mean of
the belief once causes tell grasps apart (`by mean`, which the engine does).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from rtask.engine.policy import Policy
from simulate.fleet.lessons import Lessons
from simulate.fleet.replay import Luck, Player
from simulate.world.seeds import stream
from tests.benchmarks.learning.bench_weighed_causes import families_of, over_products

_CAP = 6
_REPLAY = 77
SAMPLED = replace(Policy(), bandit=replace(Policy().bandit, telling=math.inf))
POLICIES = {"without": replace(Policy(), causes=False), "sampled": SAMPLED, "by mean": Policy()}
CHANGES = (("sampled", "without"), ("by mean", "without"), ("by mean", "sampled"))


def play_fleet(
    products: Sequence[Mapping[str, Any]], hand: ParallelGripper, rng: np.random.Generator
) -> list[tuple[int, dict[str, tuple[int, int]]]]:
    """Return the attempts of both robots at each product, by condition, with the same luck."""
    order = [int(i) for i in rng.permutation(len(products))]
    luck = {i: (Luck.draw(rng, _CAP), Luck.draw(rng, _CAP)) for i in order}
    counts: dict[int, dict[str, tuple[int, int]]] = {i: {} for i in order}
    for condition, policy in POLICIES.items():
        player, lessons = Player(policy, hand, _CAP), Lessons(hand)
        first = {}
        for i in order:
            prior = lessons.prior_of(products[i])
            first[i] = player.play(products[i], luck[i][0], prior=prior)
            lessons.add(products[i], first[i])
        for i in order:
            reports = first[i] if luck[i][1].recognised else ()
            prior = lessons.prior_of(products[i])
            second = player.play(products[i], luck[i][1], reports, prior=prior)
            counts[i][condition] = player.count(first[i]), player.count(second)
    return list(counts.items())


def changes_of(rows: Sequence[tuple[int, Mapping[str, tuple[int, int]]]]) -> list[str]:
    """Return the paired changes of each robot, with intervals over products."""
    of = np.array([i for i, _ in rows])
    words = []
    for robot in (0, 1):
        attempts = {name: np.array([row[name][robot] for _, row in rows]) for name in POLICIES}
        words += [over_products(attempts[more] - attempts[less], of) for more, less in CHANGES]
    return words


def main() -> None:
    """Print a row a family: robot 1 and 2, each with three paired changes, over products."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fleets", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    hand, families = families_of(options.folder)
    titles = [f"robot {robot}: {a} less {b}" for robot in (1, 2) for a, b in CHANGES]
    print(" | ".join(["family", "products", *titles]))
    everything: list[tuple[int, Mapping[str, tuple[int, int]]]] = []
    for number, (name, products) in enumerate(families.items()):
        rows = [
            row
            for fleet in range(options.fleets)
            for row in play_fleet(
                products, gripper_named(hand), stream(options.seed, _REPLAY, fleet)
            )
        ]
        print(" | ".join([name, str(len(products)), *changes_of(rows)]), flush=True)
        everything += [(1000 * number + i, row) for i, row in rows]
    print(" | ".join(["all", str(len({i for i, _ in everything})), *changes_of(everything)]))


if __name__ == "__main__":
    main()
