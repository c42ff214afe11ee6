"""What it is worth that an object lost on the way is no sign of what hides in it.

    python tests/benchmarks/learning/bench_lost_on_the_way.py FOLDER... [--replays 60]

Each folder has a table of attempts (`rtask study attempts`). Robot 1 tries a product until a grasp
holds; that object is then lost on the way, and it tries no further. Robot 2 starts from its report,
twice with the same luck: the loss counts as if the place had given way, and as a failure of the
grasp alone. Losses are drawn from all holds alike, since at which end it was held hardly matters.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from grasp.spatial.gripper_files import gripper_named
from rtask.engine.policy import Policy
from simulate.fleet.replay import Luck, Player
from simulate.study.attempt_table import read_attempts
from simulate.study.intervals import bootstrap

_CAP = 6


def pairs_of(folder: Path, replays: int, rng: np.random.Generator) -> list[tuple[str, int, int]]:
    """Return (product, attempts of robot 2 before, and now) for each replay with a loss."""
    table = read_attempts(folder / "attempts.json")
    player = Player(Policy(), gripper_named(str(table["settings"]["hand"])), _CAP)
    pairs = []
    for product in table["products"]:
        for _ in range(replays if product["arms"] else 0):
            first, second = Luck.draw(rng, _CAP), Luck.draw(rng, _CAP)
            tried = player.play(product, first)
            if not tried or not tried[-1].held:
                continue
            failed = replace(tried[-1], held=False)
            counts = [
                player.count(player.play(product, second, [*tried[:-1], report]))
                for report in (failed, replace(failed, lost=True))
            ]
            pairs.append((f"{folder.name} {product['product']}", counts[0], counts[1]))
    return pairs


def main() -> None:
    """Print attempts before and now for each folder, with the interval over products."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--replays", type=int, default=60)
    options = parser.parse_args()
    for folder in options.folders:
        pairs = pairs_of(folder, options.replays, np.random.default_rng(17))
        names = sorted({name for name, *_ in pairs})
        of_product = np.array([
            [len(mine := [p for p in pairs if p[0] == name]), sum(p[1] for p in mine),
             sum(p[2] for p in mine)]
            for name in names
        ])  # fmt: skip

        def change(i: np.ndarray, sums: np.ndarray = of_product) -> float:
            return float((sums[i, 2] - sums[i, 1]).sum() / sums[i, 0].sum())

        n, before, now = of_product.sum(axis=0)
        low, high = bootstrap(change, len(names))
        print(
            f"{folder.name}: {len(names)} products, {n} replays: {before / n:.2f} attempts before, "
            f"{now / n:.2f} now, {(now - before) / n:+.2f} [{low:+.2f}, {high:+.2f}]",
            flush=True,
        )


if __name__ == "__main__":
    main()
