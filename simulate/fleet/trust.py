"""Fleets in which some robots report falsely, replayed from a table of attempts.

Every robot meets every product of its fleet several times, in random order, with what all have
reported so far. Liars work like the others and report something else. The same fleets are played
several times with the same luck: all report truthfully; the liars are believed; the reports of
whoever is found to contradict the others (:mod:`rtask.engine.honesty`) are left out; the reports of
the rest weigh besides by how truthful they seem, as the engine does it, without liars too; and the
liars are never heard, which no judgement can better: there are fewer to learn from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.gripper_files import gripper_named
from rtask.engine.honesty import Reports, judge_honesty
from rtask.engine.policy import Policy
from rtask.errors import UsageError
from simulate.fleet.replay import Luck, Player, ReportedGrasp
from simulate.study.attempt_table import attempts_named, attempts_of, read_attempts
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap
from simulate.world.seeds import stream

__all__ = ["COLUMNS", "LIES", "summary_of", "trust_rows", "trust_study", "trust_trial"]

LIES = ("flipped", "held", "random")
"""What liars report: the opposite, that every grasp held, or anything."""
COLUMNS = ("reports", "first tries that held", "less than truthful", "attempts")

_TRUST = 71
_JUDGED = ("left out", "weighed", "truthful, weighed")
_CONDITIONS = {
    "truthful": "all truthful",
    "believed": "liars believed",
    "left out": "liars left out",
    "weighed": "reports weighed",
    "truthful, weighed": "all truthful, reports weighed",
    "unheard": "liars never heard",
}


@dataclass
class _Fleet:
    """Reports and findings of one fleet under one condition."""

    reports: dict[int, list[tuple[int, ReportedGrasp]]] = field(default_factory=dict)
    count: dict[int, int] = field(default_factory=dict)
    named: dict[int, int] = field(default_factory=dict)
    """robots whose reports are left out now, and how many they had made when they were named"""
    ever: dict[int, int] = field(default_factory=dict)
    """the same of all that were ever named"""
    doubts: dict[int, float] = field(default_factory=dict)
    """weights of the reports of each robot, where they are weighed"""
    first: list[tuple[int, bool]] = field(default_factory=list)
    attempts: list[int] = field(default_factory=list)


def trust_study(
    path: Path, fleets: int, robots: int, liars: int, on_table: int, rounds: int, cap: int,
    seed: int, lie: str = "flipped",
) -> Study:  # fmt: skip
    """Return the study of what liars cost the others; each trial is a fleet.

    Parameters
    ----------
    path
        Table of attempts, as :func:`simulate.study.attempt_table.read_attempts` takes it.
    robots, liars
        Robots of a fleet, and how many of them report falsely.
    on_table, rounds
        Products of a fleet, and how often each robot meets each.
    cap
        Attempts at one product.
    lie
        One of :data:`LIES`.

    Raises
    ------
    UsageError
        A number is out of range, or the table holds too few products for a fleet.
    """
    if min(fleets, robots, on_table, rounds) < 1 or not 0 <= liars < robots:
        raise UsageError(
            "--fleets, --robots, --table and --rounds must be at least 1 and --liars fewer than "
            f"--robots, got {fleets}, {robots}, {on_table}, {rounds} and {liars}"
        )
    if lie not in LIES:
        raise UsageError(f"--lie: expected one of {', '.join(LIES)}, got {lie!r}")
    products = [product for product in read_attempts(path)["products"] if product["arms"]]
    if on_table > len(products):
        raise UsageError(f"a fleet takes {on_table} products, and the table has {len(products)}")
    settings = {
        **attempts_named(path), "robots": robots, "liars": liars, "on_table": on_table,
        "rounds": rounds, "cap": cap, "seed": seed, "lie": lie,
    }  # fmt: skip
    return Study("trust", "simulate.fleet.trust:trust_trial", settings, fleets, _describe)


def trust_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Play one fleet under all conditions.

    Returns
    -------
    ``row`` has the share of first tries that held and the mean attempts of each condition; the
    rest how many reports each liar had made when it was named, or -1, and how many truthful robots
    are named in the end, and were for a while.
    """
    table = attempts_of(settings)
    products = [product for product in table["products"] if product["arms"]]
    player = Player(Policy(), gripper_named(str(table["settings"]["hand"])), settings["cap"])
    robots, liars = settings["robots"], settings["liars"]
    played = {
        name: _play(name, player, products, number, robots, liars, settings["on_table"],
                    settings["rounds"], settings["seed"], settings["lie"])
        for name in _CONDITIONS
    }  # fmt: skip
    row: list[float] = []
    for fleet in played.values():
        row += [float(np.mean([held for _, held in fleet.first])), float(np.mean(fleet.attempts))]
    named = played["weighed"].named
    return {
        "row": row,
        "named": [named.get(robot, -1) for robot in range(liars)],
        "falsely": sum(robot >= liars for robot in named),
        "for_a_while": sum(robot >= liars for robot in played["weighed"].ever),
    }


def summary_of(results: Results, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return what liars cost the others, and how soon they are named, as JSON data."""
    summary, better = _summary(np.array([result["row"] for result in results]))
    named = [n for result in results for n in result["named"]]
    robots, liars = settings["robots"], settings["liars"]
    return {
        "fleets": len(results), "robots": robots, "liars": liars,
        "products": settings["on_table"], "lie": settings["lie"],
        "conditions": summary,
        "weighed_less_left_out": better,
        "liars_named": sum(n >= 0 for n in named),
        "liars_named_within_50": sum(0 <= n <= 50 for n in named),
        "of_liars": len(named),
        "reports_until_named": None if max(named, default=-1) < 0
        else float(np.median([n for n in named if n >= 0])),
        "truthful_named": sum(result["falsely"] for result in results),
        "truthful_named_for_a_while": sum(result["for_a_while"] for result in results),
        "of_truthful": len(results) * (robots - liars),
    }  # fmt: skip


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results, settings)
    more = summary["weighed_less_left_out"]
    lines = (
        "weighing reports adds {:+.3f} [{:+.3f}, {:+.3f}] to leaving liars out".format(
            more["change"], *more["interval95"]
        ),
        f"named: {summary['liars_named']} of {summary['of_liars']} liars, "
        f"{summary['liars_named_within_50']} within 50 of their reports; "
        f"{summary['truthful_named']} of {summary['of_truthful']} truthful robots by mistake, "
        f"{summary['truthful_named_for_a_while']} for a while",
    )
    title = f"{len(results)} fleets of {settings['robots']} robots, {settings['liars']} of them "
    table = Table(title + "liars", COLUMNS, trust_rows(summary))
    return Report(summary, [table], lines, file="trust.json")


def _play(
    condition: str, player: Player, products: Sequence[Mapping[str, Any]], number: int, robots: int,
    liars: int, on_table: int, rounds: int, seed: int, lie: str,
) -> _Fleet:  # fmt: skip
    """Return one fleet under one condition; its luck depends on the number alone."""
    rng = stream(seed, _TRUST, number)
    drawn = [int(i) for i in rng.choice(len(products), on_table, replace=False)]
    meetings = [(robot, i) for robot in range(robots) for i in drawn for _ in range(rounds)]
    order = rng.permutation(len(meetings))
    fleet = _Fleet()
    for meeting in order.tolist():
        robot, i = meetings[meeting]
        # Drawn whether it is used or not, so that every condition meets with the same luck.
        luck, claims = Luck.draw(rng, player.cap), rng.random(player.cap) < 0.5
        reports = list(_heard(fleet, robot, fleet.reports.get(i, [])))
        if condition == "unheard":
            reports = [attempt for who, attempt in fleet.reports.get(i, []) if who >= liars]
        done = player.play(products[i], luck, reports if luck.recognised else ())
        lies = not condition.startswith("truthful") and robot < liars
        for attempt, held in zip(done, claims.tolist(), strict=False):
            report = ReportedGrasp(attempt.arm, _lie(lie, attempt.held, held)) if lies else attempt
            fleet.reports.setdefault(i, []).append((robot, report))
        fleet.count[robot] = fleet.count.get(robot, 0) + len(done)
        # What is asked is what the others lose by the lies, not the liars themselves.
        if robot >= liars and done:
            fleet.first.append((i, done[0].held))
            fleet.attempts.append(player.count(done))
        if condition in _JUDGED:
            _judge(fleet, is_weighed=condition != "left out")
    return fleet


def _heard(
    fleet: _Fleet, asking: int, reports: Sequence[tuple[int, ReportedGrasp]]
) -> Iterator[ReportedGrasp]:
    """Yield what a robot takes from the reports on a product; its own word counts in full."""
    for who, report in reports:
        weight = fleet.doubts.get(who, 1.0) if who != asking else 1.0
        if weight > 0:
            yield replace(report, weight=weight)


def _lie(lie: str, held: bool, anything: bool) -> bool:
    return {"flipped": not held, "held": True, "random": anything}[lie]


def _judge(fleet: _Fleet, is_weighed: bool) -> None:
    """Name robots that are found not to report truthfully, and weigh the others if asked."""
    counts: dict[tuple[int, int, int], list[int]] = {}
    for i, entries in fleet.reports.items():
        for robot, entry in entries:
            count = counts.setdefault((robot, i, entry.arm), [0, 0])
            count[0] += entry.held
            count[1] += 1
    reports = [
        Reports(str(robot), f"{i}/{arm}", held, n) for (robot, i, arm), (held, n) in counts.items()
    ]
    beliefs = {int(name): entry for name, entry in judge_honesty(reports).items()}
    contradicting = {robot for robot, entry in beliefs.items() if entry.contradicts}
    fleet.doubts = {robot: entry.weight if is_weighed else 1.0 for robot, entry in beliefs.items()}
    fleet.doubts |= dict.fromkeys(contradicting, 0.0)
    # Who is not contradicted any more is named no longer; `ever` remembers that it was.
    fleet.named = {robot: fleet.named.get(robot, fleet.count[robot]) for robot in contradicting}
    for robot in contradicting:
        fleet.ever.setdefault(robot, fleet.count[robot])


def _summary(rows: NDArray[np.float64]) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Return the figures of each condition, and what weighing reports adds to leaving some out.

    With 95 % intervals over fleets.
    """
    first = dict(zip(_CONDITIONS, rows[:, ::2].T, strict=True))
    attempts = dict(zip(_CONDITIONS, rows[:, 1::2].T, strict=True))
    figures = {
        name: {
            "first_try": round(float(first[name].mean()), 4),
            "attempts": round(float(attempts[name].mean()), 4),
            **_change(first[name] - first["truthful"]),
        }
        for name in _CONDITIONS
    }
    return figures, _change(first["weighed"] - first["left out"])


def _change(less: NDArray[np.float64]) -> dict[str, Any]:
    """Return the mean of a difference, and its 95 % interval."""

    def mean(i: NDArray[np.intp]) -> float:
        return float(less[i].mean())

    interval = [round(v, 4) for v in bootstrap(mean, len(less))]
    return {"change": round(float(less.mean()), 4), "interval95": interval}


def trust_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            _CONDITIONS[name], f"{figures['first_try']:.3f}",
            "{:+.3f} [{:+.3f}, {:+.3f}]".format(figures["change"], *figures["interval95"]),
            f"{figures['attempts']:.2f}",
        )
        for name, figures in summary["conditions"].items()
    ]  # fmt: skip
