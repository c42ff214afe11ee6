"""Fleets of two robots replayed from a table of attempts.

The first robot meets products that nobody knows. The second meets the same ones with what the first
one reported, and again with nothing. Both choose by the engine's own weights and learner. Controls
give the second robot another memory: that of a look-alike (another product of the family, with
another secret), that of a product of another family, and the outcomes of the product itself moved
to random grasps. Only the last holds nothing that is true: families share where they can be held,
and most hard products cannot be held in the middle. Both robots also work without reasoning about
hidden causes.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import Arm, BetaThompson, Trial
from grasp.learning.causes import hidden_share
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from rtask.engine.memory.experience import Weights, gather, won_by
from rtask.engine.policy import Policy
from rtask.engine.remembered import Remembered, Tally
from rtask.errors import UsageError
from simulate.study.attempt_table import attempts_named, attempts_of, read_attempts
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap
from simulate.world.seeds import stream

__all__ = [
    "COLUMNS", "CONDITIONS", "Luck", "Player", "ReportedGrasp", "replay_rows", "replay_study",
    "replay_trial", "summary_of",
]  # fmt: skip

CONDITIONS = ("shared", "look-alikes", "another family", "random grasps")
COLUMNS = (
    "memory of", "robot 1", "robot 2", "robot 2 alone", "effect", "first tries", "headroom won",
)  # fmt: skip

_REPLAY = 70
_RECOGNISED, _TURNED = 0.9, 0.03
_NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)


@dataclass(frozen=True)
class ReportedGrasp:
    """An attempt that a robot reported: the number of the grasp, and whether it held.

    Parameters
    ----------
    weight
        Part for which the report counts, 0..1; see :mod:`rtask.engine.honesty`.
    lost
        Whether the object was held and then lost on the way: a failure of the grasp, which says
        nothing of what hides in the object.
    """

    arm: int
    held: bool
    weight: float = 1.0
    lost: bool = False


def replay_study(path: Path, fleets: int, on_table: int, cap: int, seed: int) -> Study:
    """Return the study of what sharing is worth, with controls; each trial is a fleet.

    Parameters
    ----------
    path
        Table of attempts, as :func:`simulate.study.attempt_table.read_attempts` takes it.
    fleets, on_table
        Number of fleets, and products of each; at least 1.
    cap
        Attempts at one product; one never held counts one more.

    Raises
    ------
    UsageError
        A number is out of range, or the table holds too few products for a fleet.
    """
    if fleets < 1 or on_table < 1:
        raise UsageError(f"--fleets and --table must be at least 1, got {fleets} and {on_table}")
    usable = _usable(read_attempts(path))
    if on_table > len(usable):
        raise UsageError(f"a fleet takes {on_table} products, and the table has {len(usable)}")
    settings = {**attempts_named(path), "on_table": on_table, "cap": cap, "seed": seed}
    return Study("replay", "simulate.fleet.replay:replay_trial", settings, fleets, _describe)


def _usable(table: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [product for product in table["products"] if product["arms"]]


def replay_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Play one fleet.

    Returns
    -------
    ``rows`` has for each condition the number of a product and the attempts of the first robot, the
    second, and the second alone; ``without`` the product and the attempts of both robots without
    causes.
    """
    table, cap = attempts_of(settings), settings["cap"]
    usable, policy = _usable(table), Policy()
    hand = gripper_named(str(table["settings"]["hand"]))
    player, plain = Player(policy, hand, cap), Player(replace(policy, causes=False), hand, cap)
    rows: dict[str, list[list[int]]] = {name: [] for name in CONDITIONS}
    without: list[list[int]] = []
    rng = stream(settings["seed"], _REPLAY, number)
    for i in rng.choice(len(usable), settings["on_table"], replace=False).tolist():
        first_luck, two, other = (Luck.draw(rng, cap) for _ in range(3))
        first = player.play(usable[i], first_luck)
        alone = player.play(usable[i], two)
        first_plain = plain.play(usable[i], first_luck)
        second_plain = plain.play(usable[i], two, first_plain if two.recognised else [])
        without.append([i, *(player.count(done) for done in (first_plain, second_plain))])
        for name in CONDITIONS:
            memory = _memory(name, i, usable, first, player, other, rng)
            if memory is None:
                continue
            second = player.play(usable[i], two, *memory) if two.recognised else alone
            rows[name].append([i, *(player.count(done) for done in (first, second, alone))])
    return {"rows": rows, "without": without}


def summary_of(results: Results, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the effect of sharing over all fleets, with controls, as JSON data."""
    usable = _usable(attempts_of(settings))
    oracle = np.array([_oracle(product) for product in usable])
    rows = {
        name: np.array([row for result in results for row in result["rows"][name]])
        for name in CONDITIONS
    }
    without = np.array([row for result in results for row in result["without"]])
    return {
        "fleets": len(results),
        "products": len(usable),
        "oracle_first_try": round(float(np.mean(oracle)), 4),
        "causes": _causes(rows["shared"], without),
        "conditions": {
            name: _summary(outcomes, oracle) for name, outcomes in rows.items() if len(outcomes)
        },
    }


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results, settings)
    lines = [f"the best grasp of each product holds {summary['oracle_first_try']:.2f} of the time"]
    for robot, effect in summary["causes"].items():
        low, high = effect["interval95"]
        lines.append(
            f"{robot.replace('_', ' ')} without reasoning about hidden causes: "
            f"{effect['without']:.2f} attempts; with it: {effect['with']:.2f}, "
            f"{effect['change']:+.2f} [{low:+.2f}, {high:+.2f}]"
        )
    title = f"{len(results)} fleets of two robots, attempts to first success"
    table = Table(title, COLUMNS, replay_rows(summary))
    return Report(summary, [table], lines, file="replay.json")


@dataclass(frozen=True)
class Luck:
    """Chance of one robot at one product, the same under every memory.

    Parameters
    ----------
    seeds, outcomes : (cap,)
        Of the learner, and of which try of a grasp it gets, 0..1, attempt by attempt.
    recognised, turned
        Whether it recognises the product, and sees it turned by half a turn.
    """

    seeds: NDArray[np.int64]
    outcomes: NDArray[np.float64]
    recognised: bool
    turned: bool

    @classmethod
    def draw(cls, rng: np.random.Generator, cap: int) -> Luck:
        """Draw it."""
        return cls(
            rng.integers(2**31, size=cap), rng.random(cap),
            bool(rng.random() < _RECOGNISED), bool(rng.random() < _TURNED),
        )  # fmt: skip


def _memory(
    condition: str, i: int, products: Sequence[Mapping[str, Any]], first: Sequence[ReportedGrasp],
    player: Player, luck: Luck, rng: np.random.Generator,
) -> tuple[Sequence[ReportedGrasp], Mapping[str, Any]] | None:  # fmt: skip
    """Return attempts to remember for a product, and the product on which they were made.

    None if no product is of the kind that the condition asks for.
    """
    if condition == "shared":
        return first, products[i]
    if condition == "random grasps":
        places = rng.permutation(len(products[i]["arms"]))
        moved = [ReportedGrasp(int(k), other.held) for k, other in zip(places, first, strict=False)]
        return moved, products[i]
    alike = condition == "look-alikes"
    kind = products[i]["kind"]
    others = [k for k, other in enumerate(products) if k != i and (other["kind"] == kind) is alike]
    if not others:
        return None
    source = products[int(rng.choice(others))]
    return player.play(source, luck), source


class Player:
    """Plays a robot at one product after another."""

    def __init__(self, policy: Policy, hand: ParallelGripper, cap: int) -> None:
        self.policy, self.hand, self.cap = policy, hand, cap

    def count(self, done: Sequence[ReportedGrasp]) -> int:
        """Return the attempts to success, the cap and one more if none held."""
        return len(done) if done and done[-1].held else self.cap + 1

    def play(
        self, product: Mapping[str, Any], luck: Luck, reports: Sequence[ReportedGrasp] = (),
        source: Mapping[str, Any] | None = None, prior: NDArray[np.float64] | None = None,
    ) -> list[ReportedGrasp]:  # fmt: skip
        """Return the attempts of a robot at a product.

        Parameters
        ----------
        reports
            Attempts that the graph remembers.
        source
            Product on which they were made; None = this one.
        prior : (h,)
            Of what hides in it, from attempts at other products
            (:class:`simulate.fleet.lessons.Lessons`); None = there are none.
        """
        source = source or product
        arms = self._arms(product, reports, source, luck.turned)
        learner = BetaThompson(self.policy.bandit, max(product["size"]))
        sign = -1.0 if luck.turned else 1.0
        reported = [
            (sign * source["arms"][attempt.arm]["x"], attempt.held, attempt.weight)
            for attempt in reports
            if not attempt.lost
        ]
        done: list[ReportedGrasp] = []
        for seed, outcome in zip(luck.seeds.tolist(), luck.outcomes.tolist(), strict=True):
            tries = [
                Trial(arms[attempt.arm].position, arms[attempt.arm].theta, attempt.held)
                for attempt in done
            ]
            seen = [*reported, *((trial.position[0], trial.success, 1.0) for trial in tries)]
            known = self._with_causes(arms, seen, product["size"][0], prior)
            order = learner.rank(known, tries, seed)
            if not order:
                break
            chosen = order[0].index
            tried = product["arms"][chosen]["held"]
            done.append(ReportedGrasp(chosen, bool(tried[int(outcome * len(tried))])))
            if done[-1].held:
                break
        return done

    def _with_causes(
        self, arms: Sequence[Arm], seen: Sequence[tuple[float, bool, float]], length: float,
        prior: NDArray[np.float64] | None,
    ) -> list[Arm]:  # fmt: skip
        """Return arms with what attempts (place along them in m, held, weight) say of causes."""
        if not self.policy.causes:
            return list(arms)
        x, held, weight = np.array(seen, dtype=np.float64).reshape(-1, 3).T
        places = np.array([arm.position[0] for arm in arms]) / length
        half_finger = self.hand.finger_width / 2 / length
        hidden = hidden_share(places, half_finger, x / length, held, weight, prior)
        return [replace(arm, hidden=float(h)) for arm, h in zip(arms, hidden, strict=True)]

    def _arms(
        self, product: Mapping[str, Any], reports: Sequence[ReportedGrasp],
        source: Mapping[str, Any], turned: bool,
    ) -> list[Arm]:  # fmt: skip
        at = np.array([[a["x"], a["y"], a["z"]] for a in product["arms"]])
        thetas = np.array([a["theta"] for a in product["arms"]])
        length, width, height = (float(s) for s in product["size"])
        size = (length, width, height)
        weights = Weights(self.policy, {"it": 1.0}, self.hand, size, _NOW)
        tried = sorted({report.arm for report in reports})
        memory = [self._remembered(arm, reports, source, turned) for arm in tried]
        evidence = gather(at, thetas, memory, weights, self.policy.bandit.bandwidth)
        won = {} if turned or source is not product else won_by(memory, weights)
        return [
            Arm(
                (a["x"], a["y"], a["z"]), a["theta"], a["quality"],
                float(evidence.successes[i]), float(evidence.failures[i]),
                own_successes=won.get(f"grasp:{i}", 0.0),
            )
            for i, a in enumerate(product["arms"])
        ]  # fmt: skip

    def _remembered(
        self, number: int, reports: Sequence[ReportedGrasp], source: Mapping[str, Any], turned: bool
    ) -> Remembered:
        arm = source["arms"][number]
        sign = -1.0 if turned else 1.0  # half a turn leaves the closing direction as it is
        counts = Counter((report.held, report.weight) for report in reports if report.arm == number)
        tallies = tuple(Tally(held, n, weight=w) for (held, w), n in sorted(counts.items()))
        return Remembered(
            f"grasp:{number}", "it", False, sign * arm["x"], sign * arm["y"], arm["z"],
            arm["theta"], self.hand.max_opening, arm["quality"], self.hand.gripper_type,
            None, tallies,
        )  # fmt: skip


def _oracle(product: Mapping[str, Any]) -> float:
    """Return the outcome of the grasp that did best on all tries but the last, on the last."""
    held = np.array([arm["held"] for arm in product["arms"]], dtype=np.float64)
    best = held[:, :-1].mean(axis=1)
    return float(held[best == best.max(), -1].mean())


def _causes(rows: NDArray[np.int64], without: NDArray[np.int64]) -> dict[str, Any]:
    """Return the attempts of both robots with and without causes, paired, with intervals."""
    products = rows[:, 0]
    distinct_products = np.unique(products)
    effects: dict[str, Any] = {}
    for robot in (1, 2):
        less = rows[:, robot] - without[:, robot]
        sums = np.array(
            [[(products == i).sum(), less[products == i].sum()] for i in distinct_products]
        )

        def change(i: NDArray[np.intp], sums: NDArray[np.int64] = sums) -> float:
            return float(sums[i, 1].sum() / sums[i, 0].sum())

        effects[f"robot_{robot}"] = {
            "with": round(float(rows[:, robot].mean()), 4),
            "without": round(float(without[:, robot].mean()), 4),
            "change": round(float(less.mean()), 4),
            "interval95": [round(v, 4) for v in bootstrap(change, len(distinct_products))],
        }
    return effects


def _summary(rows: NDArray[np.int64], oracle: NDArray[np.float64]) -> dict[str, Any]:
    """Return the figures of one condition, with 95 % intervals over products."""
    products, first, second, alone = rows.T
    distinct_products = np.unique(products)
    sums = np.array(
        [
            [
                len(mine := rows[products == i]), mine[:, 1].sum(), mine[:, 2].sum(),
                mine[:, 3].sum(), (mine[:, 1] == 1).sum(), (mine[:, 2] == 1).sum(),
                len(mine) * oracle[i],
            ]
            for i in distinct_products
        ],
        dtype=np.float64,
    )  # fmt: skip

    def effect(i: NDArray[np.intp]) -> float:
        return float((sums[i, 2] - sums[i, 3]).sum() / sums[i, 0].sum())

    def won(i: NDArray[np.intp]) -> float:
        # A resample may hold no product with headroom.
        room = max((sums[i, 6] - sums[i, 4]).sum(), 1e-9)
        return float((sums[i, 5] - sums[i, 4]).sum() / room)

    everything = np.arange(len(distinct_products))
    has_room = bool((sums[:, 6] - sums[:, 4]).sum() > 0)
    return {
        "n": len(rows),
        "robot_1": round(float(first.mean()), 4),
        "robot_2": round(float(second.mean()), 4),
        "robot_2_alone": round(float(alone.mean()), 4),
        "first_try": [round(float((held_first == 1).mean()), 4) for held_first in (first, second)],
        "effect": round(effect(everything), 4),
        "effect_interval95": [round(v, 4) for v in bootstrap(effect, len(distinct_products))],
        "headroom_won": round(won(everything), 4) if has_room else None,
        "headroom_interval95": [round(v, 4) for v in bootstrap(won, len(distinct_products))]
        if has_room
        else None,
    }


def replay_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    names = {
        "shared": "the product", "look-alikes": "a look-alike",
        "another family": "another family", "random grasps": "random grasps",
    }  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for name, figures in summary["conditions"].items():
        low, high = figures["effect_interval95"]
        rows.append(
            (
                names[name],
                f"{figures['robot_1']:.2f}", f"{figures['robot_2']:.2f}",
                f"{figures['robot_2_alone']:.2f}",
                f"{figures['effect']:+.2f} [{low:+.2f}, {high:+.2f}]",
                "{:.2f} -> {:.2f}".format(*figures["first_try"]),
                "-" if figures["headroom_won"] is None else f"{figures['headroom_won']:.2f}",
            )
        )  # fmt: skip
    return rows
