"""Whether reasoning about causes costs less if its say depends on how well it predicted.

    python tests/benchmarks/learning/bench_weighed_causes.py FOLDER [--fleets 20] [--seed 1]

The folder is of a finished `rtask study unforeseen`. Two experts predict each attempt of the first
robot before it is made: the learner with causes, and the same learner without. Their sums of log
scores over all attempts so far, in the products of a family, are the log odds of a Bayesian
mixture, which starts at e to 1 for causes. What causes leave of a grasp's quality is moved towards
1 by the part of the expert without them. Whatever the family, the log loss of the mixture of the
two predictions exceeds that of the one with causes by at most log(1 + 1/e) = .31 in all, and that
of the one without by at most log(1 + e) = 1.31 (Cesa-Bianchi and Lugosi 2006, 3.3). The bound is
one of predictions, and none of attempts, since either expert alone would have tried other grasps.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import BetaThompson, Trial
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from rtask.engine.policy import Policy
from simulate.fleet.lessons import Lessons
from simulate.fleet.replay import Luck, Player, ReportedGrasp
from simulate.study.intervals import bootstrap
from simulate.world.seeds import stream

_CAP = 6
_REPLAY = 74
_PRIOR_LOG_ODDS = 1.0
"""Of causes: at even odds they won less where they are right."""
CONDITIONS = ("without", "causes", "weighed")


class WeighedPlayer(Player):
    """Robot that believes in causes as far as they predicted better than the learner without.

    ``score`` is the log odds of causes after all attempts of the first robots, ``gained`` what the
    latest episode adds to it.
    """

    def __init__(self, policy: Policy, hand: ParallelGripper, cap: int) -> None:
        super().__init__(policy, hand, cap)
        self.score, self.gained = _PRIOR_LOG_ODDS, 0.0

    def play(
        self, product: Mapping[str, Any], luck: Luck, reports: Sequence[ReportedGrasp] = (),
        source: Mapping[str, Any] | None = None, prior: NDArray[np.float64] | None = None,
    ) -> list[ReportedGrasp]:  # fmt: skip
        """Return the attempts of a robot at a product; see :meth:`Player.play`."""
        source = source or product
        plain = self._arms(product, reports, source, luck.turned)
        learner = BetaThompson(self.policy.bandit, max(product["size"]))
        sign = -1.0 if luck.turned else 1.0
        reported = [
            (sign * source["arms"][report.arm]["x"], report.held, report.weight)
            for report in reports
        ]
        done: list[ReportedGrasp] = []
        self.gained = 0.0
        for seed, outcome in zip(luck.seeds.tolist(), luck.outcomes.tolist(), strict=True):
            tries = [Trial(plain[d.arm].position, plain[d.arm].theta, d.held) for d in done]
            seen = [*reported, *((trial.position[0], trial.success, 1.0) for trial in tries)]
            reasoned = self._with_causes(plain, seen, product["size"][0], prior)
            weight = 1 / (1 + math.exp(-(self.score + self.gained)))
            order = learner.rank(
                [replace(arm, hidden=weight * arm.hidden + 1 - weight) for arm in reasoned],
                tries, seed,
            )  # fmt: skip
            if not order:
                break
            chosen = order[0].index
            tried = product["arms"][chosen]["held"]
            held = bool(tried[int(outcome * len(tried))])
            chances = [learner.beliefs(arms, tries)[chosen] for arms in (reasoned, plain)]
            with_causes, without = (float(belief[0] / belief.sum()) for belief in chances)
            self.gained += (
                math.log(with_causes / without) if held
                else math.log((1 - with_causes) / (1 - without))
            )  # fmt: skip
            done.append(ReportedGrasp(chosen, held))
            if held:
                break
        return done


def play_fleet(
    products: Sequence[Mapping[str, Any]], hand: ParallelGripper, rng: np.random.Generator
) -> list[tuple[int, dict[str, tuple[int, int]]]]:
    """Return the attempts of both robots at each product, by condition, with the same luck."""
    order = [int(i) for i in rng.permutation(len(products))]
    luck = {i: (Luck.draw(rng, _CAP), Luck.draw(rng, _CAP)) for i in order}
    counts: dict[int, dict[str, tuple[int, int]]] = {i: {} for i in order}
    for condition in CONDITIONS:
        # As it was when this was measured: of the five best grasps one was sampled.
        sampled = replace(Policy().bandit, telling=math.inf)
        policy = replace(Policy(), causes=condition != "without", bandit=sampled)
        kind = WeighedPlayer if condition == "weighed" else Player
        player, lessons = kind(policy, hand, _CAP), Lessons(hand)
        reports: dict[int, list[ReportedGrasp]] = {}
        for i in order:
            prior = lessons.prior_of(products[i])
            reports[i] = player.play(products[i], luck[i][0], prior=prior)
            lessons.add(products[i], reports[i])
            if isinstance(player, WeighedPlayer):
                player.score += player.gained
        for i in order:
            mine = luck[i][1]
            seen = reports[i] if mine.recognised else ()
            prior = lessons.prior_of(products[i])
            second = player.play(products[i], mine, seen, prior=prior)
            counts[i][condition] = player.count(reports[i]), player.count(second)
    return list(counts.items())


def families_of(folder: Path) -> tuple[str, dict[str, list[dict[str, Any]]]]:
    """Return the hand and the products of a finished study, by family."""
    lines = (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    study, *trials = map(json.loads, lines)
    families: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for trial in sorted(
        (trial for trial in trials if "result" in trial), key=lambda trial: trial["trial"]
    ):
        if trial["result"]["arms"]:
            families[trial["result"]["family"]].append(trial["result"])
    return str(study["study"]["hand"]), families


def changes_of(rows: Sequence[tuple[int, Mapping[str, tuple[int, int]]]]) -> list[str]:
    """Return for each robot: causes and weighed less without, and weighed less causes."""
    of = np.array([i for i, _ in rows])
    words = []
    for robot in (0, 1):
        attempts = {name: np.array([row[name][robot] for _, row in rows]) for name in CONDITIONS}
        for more, less in (("causes", "without"), ("weighed", "without"), ("weighed", "causes")):
            words.append(over_products(attempts[more] - attempts[less], of))
    return words


def over_products(difference: NDArray[np.int64], of: NDArray[np.int64]) -> str:
    """Return the mean of paired differences with its 95 % interval over products, in words."""
    means = np.array([difference[of == i].mean() for i in np.unique(of)])
    low, high = bootstrap(lambda i: float(means[i].mean()), len(means))
    return f"{means.mean():+.2f} [{low:+.2f}, {high:+.2f}]"


def main() -> None:
    """Print a row a family: robot 1 and 2, each with three paired changes, over products."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fleets", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    hand, families = families_of(options.folder)
    everything: list[tuple[int, Mapping[str, tuple[int, int]]]] = []
    print("family | products | " + " | ".join(
        f"robot {robot}, {change}" for robot in (1, 2)
        for change in ("causes less without", "weighed less without", "weighed less causes")
    ))  # fmt: skip
    for name, products in families.items():
        fleets = [
            play_fleet(products, gripper_named(hand), stream(options.seed, _REPLAY, number))
            for number in range(options.fleets)
        ]
        rows = [row for fleet in fleets for row in fleet]
        print(" | ".join([name, str(len(products)), *changes_of(rows)]), flush=True)
        first = 1000 * len({i // 1000 for i, _ in everything})
        everything += [(first + i, row) for i, row in rows]
    print(" | ".join(["all", str(len({i for i, _ in everything})), *changes_of(everything)]))


if __name__ == "__main__":
    main()
