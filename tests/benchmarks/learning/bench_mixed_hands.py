"""Lessons of a hand of one kind for a hand of another, replayed from two tables of attempts.

    rtask study attempts -n 24 --products light --gripper nao --seed 9700 --out nao
    rtask study attempts -n 24 --products light --gripper panda --seed 9700 --out panda
    python tests/benchmarks/learning/bench_mixed_hands.py nao panda

The same products, tried by both hands without arms. One robot tries a product until a grasp holds;
another one starts from its report, or from nothing, with the same luck. Reports count as the engine
lets them: what a weak hand holds a strong one holds, and what a strong one drops a weak one drops.
Intervals over products. The last lines name the products to which a lesson did not carry over.
"""

from __future__ import annotations

import argparse
import datetime as dt
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import Arm
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from rtask.engine.memory.experience import Weights, gather, won_by
from rtask.engine.policy import Policy
from rtask.engine.remembered import Tally
from simulate.fleet.replay import Luck, Player, ReportedGrasp
from simulate.study.attempt_table import read_attempts
from simulate.study.intervals import bootstrap
from simulate.world.seeds import stream

_CAP = 6
_NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)


class PlayerTold(Player):
    """Plays a robot that was told by a hand which may be of another kind."""

    teller: ParallelGripper
    _trusts: Sequence[float] = ()

    def _arms(
        self, product: Mapping[str, Any], reports: Sequence[ReportedGrasp],
        source: Mapping[str, Any], turned: bool,
    ) -> list[Arm]:  # fmt: skip
        arms = super()._arms(product, (), product, turned)
        forces = {hand.gripper_type: hand.max_force for hand in (self.hand, self.teller)}
        length, width, height = (float(side) for side in product["size"])
        weights = Weights(
            self.policy, {"it": 1.0}, self.hand, (length, width, height), _NOW, forces
        )
        kind = self.teller.gripper_type
        memory = [
            replace(self._remembered(arm, reports, source, turned), gripper_type=kind)
            for arm in sorted({report.arm for report in reports})
        ]
        # Of what hides, a report says as much as of the grasp, by the hand and its outcome.
        self._trusts = [
            weights.trust(memory[0], Tally(report.held, 1)) for report in reports if not report.lost
        ]
        at = np.array([arm.position for arm in arms])
        thetas = np.array([arm.theta for arm in arms])
        told = gather(at, thetas, memory, weights, self.policy.bandit.bandwidth)
        won = {} if turned else won_by(memory, weights)
        # A remembered grasp is offered itself: it is the arm of this hand that lies there.
        own = {_place(source["arms"][int(name.split(":")[1])]): n for name, n in won.items()}
        return [
            replace(
                arm, successes=float(told.successes[i]), failures=float(told.failures[i]),
                own_successes=own.get((round(arm.position[0], 3), round(arm.theta, 2)), 0.0),
            )
            for i, arm in enumerate(arms)
        ]  # fmt: skip

    def _with_causes(
        self, arms: Sequence[Arm], seen: Sequence[tuple[float, bool, float]], length: float,
        prior: NDArray[np.float64] | None,
    ) -> list[Arm]:  # fmt: skip
        told = [(x, held, trust) for (x, held, _), trust in zip(seen, self._trusts, strict=False)]
        return super()._with_causes(arms, [*told, *seen[len(told) :]], length, prior)


def _place(arm: Mapping[str, Any]) -> tuple[float, float]:
    return round(float(arm["x"]), 3), round(float(arm["theta"]), 2)


def replayed(tables: Mapping[str, Any], teller: str, asker: str, replays: int) -> list[Any]:
    """Return (product, its kind, attempts told, attempts alone) of each replay."""
    rng = stream(41, 0)
    hands = {name: gripper_named(str(t["settings"]["hand"])) for name, t in tables.items()}
    first = PlayerTold(Policy(), hands[teller], _CAP)
    second = PlayerTold(Policy(), hands[asker], _CAP)
    first.teller, second.teller = hands[teller], hands[teller]
    theirs = {p["product"]: p for p in tables[teller]["products"]}
    rows = []
    for mine in tables[asker]["products"]:
        source = theirs[mine["product"]]
        for _ in range(replays if mine["arms"] and source["arms"] else 0):
            one, two = Luck.draw(rng, _CAP), Luck.draw(rng, _CAP)
            reports = first.play(source, one)
            alone = second.play(mine, two)
            told = second.play(mine, two, reports, source) if two.recognised else alone
            rows.append((mine["product"], mine["kind"], second.count(told), second.count(alone)))
    return rows


def main() -> None:
    """Print what each kind of hand gains by the lessons of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs=2, type=Path)
    parser.add_argument("--replays", type=int, default=60)
    options = parser.parse_args()
    tables = {f.name: read_attempts(f / "attempts.json") for f in options.folders}
    for asker in tables:
        for teller in tables:
            rows = replayed(tables, teller, asker, options.replays)
            of_product: dict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
            for product, kind, told, alone in rows:
                of_product[kind, product].append((told, alone))
            for kinds in (sorted({kind for kind, _ in of_product}), *sorted(
                [kind] for kind in {kind for kind, _ in of_product}
            )):  # fmt: skip
                names = [key for key in sorted(of_product) if key[0] in kinds]
                sums = np.array([
                    [len(of_product[k]), *np.sum(of_product[k], axis=0)] for k in names
                ])  # fmt: skip

                def change(i: np.ndarray, sums: np.ndarray = sums) -> float:
                    return float((sums[i, 1] - sums[i, 2]).sum() / sums[i, 0].sum())

                n, told, alone = sums.sum(axis=0)
                low, high = bootstrap(change, len(names))
                print(
                    f"{asker} told by {teller}, {' and '.join(kinds)}: {len(names)} products, "
                    f"{told / n:.2f} attempts, alone {alone / n:.2f}, {(told - alone) / n:+.2f} "
                    f"[{low:+.2f}, {high:+.2f}]",
                    flush=True,
                )
            worse = [
                f"{name} ({np.mean([t for t, _ in pairs]):.1f} for "
                f"{np.mean([a for _, a in pairs]):.1f})"
                for (_, name), pairs in sorted(of_product.items())
                if np.mean([t for t, _ in pairs]) > np.mean([a for _, a in pairs]) + 0.05
            ]
            print(f"  more attempts with the lesson: {', '.join(worse) or 'none'}", flush=True)


if __name__ == "__main__":
    main()
