"""What memory, causes and both are worth at products of one family, replayed.

The first robot of a fleet meets products that nobody knows, one after the other; the second meets
the same ones with what the first reported. Each works with memory of the attempts at the product
itself or without, and with reasoning about causes, which learns from the attempts at the other
products, or without. Controls give the second robot an untrue memory: that of a look-alike, or the
product's own outcomes moved to random grasps. A withdrawn teacher leaves nothing, which is the
first robot's condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.gripper_files import gripper_named
from rtask.engine.policy import Policy
from simulate.fleet.lessons import Lessons
from simulate.fleet.replay import Luck, Player, ReportedGrasp
from simulate.study.intervals import bootstrap
from simulate.world.seeds import stream

__all__ = ["COLUMNS", "CONDITIONS", "replay_family", "rows_of"]

CONDITIONS = ("neither", "memory", "causes", "both")
COLUMNS = (
    "hidden", *CONDITIONS, "causes less neither", "both less memory", "look-alike", "random grasps",
)  # fmt: skip
"""The last two: both less memory, where the memory is untrue."""

_REPLAY = 73
_CAP = 6
_UNTRUE = ("look-alike", "random grasps")


class _Fleet:
    """Two robots at the products of a family; the same luck under every condition."""

    def __init__(self, products: Sequence[Mapping[str, Any]], hand: str) -> None:
        policy, self.hand = Policy(), gripper_named(hand)
        self.products = products
        self.players = {
            False: Player(replace(policy, causes=False), self.hand, _CAP),
            True: Player(policy, self.hand, _CAP),
        }

    def play(self, rng: np.random.Generator) -> list[dict[str, Any]]:
        """Return the attempts of both robots at each product, by condition."""
        order = [int(i) for i in rng.permutation(len(self.products))]
        luck = {i: [Luck.draw(rng, _CAP) for _ in range(3)] for i in order}
        rows: list[dict[str, Any]] = [{"product": i, "robot_1": {}, "robot_2": {}} for i in order]
        first: dict[bool, dict[int, list[ReportedGrasp]]] = {}
        lessons: dict[bool, Lessons] = {}
        for reasons, player in self.players.items():
            first[reasons], lessons[reasons] = {}, Lessons(self.hand)
            for row in rows:
                i, product = row["product"], self.products[row["product"]]
                prior = lessons[reasons].prior_of(product)
                done = player.play(product, luck[i][0], prior=prior)
                first[reasons][i] = done
                lessons[reasons].add(product, done)
                row["robot_1"]["causes" if reasons else "neither"] = player.count(done)
        for row in rows:
            row["robot_2"] = self._second(row["product"], luck, first, lessons[True], rng)
        return rows

    def _second(
        self, i: int, luck: Mapping[int, Sequence[Luck]],
        first: Mapping[bool, Mapping[int, Sequence[ReportedGrasp]]], lessons: Lessons,
        rng: np.random.Generator,
    ) -> dict[str, int]:  # fmt: skip
        """Return the attempts of the second robot at a product, by condition and memory."""
        product, mine = self.products[i], luck[i][1]
        other = int(rng.choice([k for k in range(len(self.products)) if k != i]))
        places = rng.permutation(len(product["arms"]))
        counts: dict[str, int] = {}
        for reasons, player in self.players.items():
            prior = lessons.prior_of(product) if reasons else None
            own, alike = first[reasons][i], first[reasons][other]
            moved = [
                ReportedGrasp(int(k), report.held) for k, report in zip(places, own, strict=False)
            ]
            memories: dict[str, tuple[Sequence[ReportedGrasp], Mapping[str, Any]]] = {
                "": ((), product), "true": (own, product),
                "look-alike": (alike, self.products[other]), "random grasps": (moved, product),
            }  # fmt: skip
            for memory, (reports, source) in memories.items():
                seen = reports if mine.recognised else ()
                counts[f"{memory}, {reasons}"] = player.count(
                    player.play(product, mine, seen, source, prior)
                )
        return counts


def replay_family(
    products: Sequence[Mapping[str, Any]], hand: str, fleets: int, seed: int
) -> dict[str, Any]:
    """Return the attempts of both robots at products of one family, as JSON data.

    Parameters
    ----------
    products
        With their attempts, of :func:`simulate.study.attempt_table.try_product`; at least 2.
    hand
        With which they were made.
    fleets
        Of two robots, each with its own order of the products and its own luck.
    """
    fleet = _Fleet(products, hand)
    rows = [row for k in range(fleets) for row in fleet.play(stream(seed, _REPLAY, k))]
    of = np.array([row["product"] for row in rows])

    def column(robot: str, name: str) -> NDArray[np.float64]:
        return np.array([row[robot][name] for row in rows], np.float64)

    plain, reasoned = column("robot_1", "neither"), column("robot_1", "causes")
    second = {
        f"{memory}{reasons}": column("robot_2", f"{memory}, {reasons}")
        for memory in ("", "true", *_UNTRUE) for reasons in (False, True)
    }  # fmt: skip
    return {
        "products": len(products),
        "robot_1": {
            "neither": _mean(plain), "causes": _mean(reasoned),
            "causes less neither": _change(reasoned - plain, of),
        },
        "robot_2": {
            "neither": _mean(second["False"]), "memory": _mean(second["trueFalse"]),
            "causes": _mean(second["True"]), "both": _mean(second["trueTrue"]),
            "causes less neither": _change(second["True"] - second["False"], of),
            "both less memory": _change(second["trueTrue"] - second["trueFalse"], of),
            **{name: _change(second[f"{name}True"] - second[f"{name}False"], of)
               for name in _UNTRUE},
        },
    }  # fmt: skip


def _mean(values: NDArray[np.float64]) -> float:
    return round(float(values.mean()), 4)


def _change(less: NDArray[np.float64], of: NDArray[np.intp]) -> dict[str, Any]:
    """Return the mean of paired differences with its 95 % interval over products."""
    means = np.array([less[of == i].mean() for i in np.unique(of)])
    low, high = bootstrap(lambda i: float(means[i].mean()), len(means))
    return {"change": _mean(means), "interval95": [round(low, 4), round(high, 4)]}


def rows_of(families: Mapping[str, Mapping[str, Any]], robot: int) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS` for a robot, the family where causes cost most first."""
    cost = "causes less neither" if robot == 1 else "both less memory"
    figures = {name: family[f"robot_{robot}"] for name, family in families.items()}
    return [
        (name, *(_shown(figures[name].get(column)) for column in COLUMNS[1:]))
        for name in sorted(figures, key=lambda name: -float(figures[name][cost]["change"]))
    ]


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.2f}"
    low, high = value["interval95"]
    return f"{value['change']:+.2f} [{low:+.2f}, {high:+.2f}]"
