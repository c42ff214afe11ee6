"""The study of demos: one after the other, each as ``rtask demo`` runs it, without its processes.

A trial is the demo of one seed: the robots work one after the other on one graph, each at its own
table with the same products; the second and the last work once more, at the same table, with a
graph of their own. Nothing depends on real time, so a trial is determined by its seed alone.

The rules by which a change is judged:

- The seeds are consecutive from the first, which is chosen before anything is run; each is shown.
- The default of ``rtask demo`` is a set of products and kinds of robots for which the robots that
  are compared need fewer attempts with the graph in most demos, on seeds not used to develop it.
- The measure is the number of attempts to the first success
  (:func:`simulate.demo.report.attempts_to_success`; one more than permitted where there was none)
  at each product in reach that a compared robot tried with the graph and without.
- Sharing shows if the interval of the mean paired difference, resampled over demos, lies below 0.
- A demo shows it if the compared robots need fewer attempts in all with the graph than without, and
  contradicts it if they need more than two more.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rtask
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.scratch import ScratchFolder
from simulate.demo.lessons import closed_where_held, lessons_of
from simulate.demo.orchestrate import Settings
from simulate.demo.processes import RobotJob
from simulate.demo.report import attempts_to_success
from simulate.demo.robot_process import clear_table, make_body
from simulate.fleet.figures import objects_tried
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap

__all__ = [
    "COLUMNS",
    "demo_rows",
    "demo_study",
    "demo_trial",
    "demo_words",
    "summarise_demos",
]

COLUMNS = (
    "seed", "products", "attempts with the graph", "attempts without", "robot by robot",
    "first tries held with", "first tries held without", "lessons recalled",
    "remembered first grasps held",
)  # fmt: skip

_TOLERATED = 2
"""Attempts more than without the graph that do not yet contradict the benefit of sharing."""


def demo_study(
    demos: int,
    robots: int,
    objects: int,
    seed: int,
    products: str,
    kinds: Sequence[str],
    max_attempts: int,
    preset: str,
) -> Study:
    """Return the study of a number of demos with consecutive seeds.

    Parameters
    ----------
    seed
        Of the first demo.
    kinds
        Kinds of the robots, in turn; empty = the kind that suits the products.

    Raises
    ------
    UsageError
        A number is out of range, or there is no robot for comparison.
    """
    if robots < 2:
        raise UsageError(
            f"--robots must be at least 2, the last of which is compared, got {robots}"
        )
    demo = Settings(
        Path(), seed=seed, objects=objects, robots=robots, products=products, kinds=tuple(kinds)
    )
    return Study(
        "demos",
        "simulate.fleet.demos:demo_trial",
        {
            "seed": seed, "robots": robots, "objects": objects, "products": products,
            "kinds": [demo.kind_of(index) for index in range(robots)],
            "compared": list(demo.compared), "max_attempts": max_attempts, "preset": preset,
        },
        demos, _describe,
    )  # fmt: skip


def demo_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Run one demo with sharing, and some of its robots without; return both as JSON data."""
    seed, started = int(settings["seed"]) + number, time.process_time()
    robots = range(int(settings["robots"]))
    with rtask.open(":memory:", reason=False) as kb:
        shared = [_work(kb, settings, seed, index) for index in robots]
    alone = []
    for index in settings["compared"]:
        with rtask.open(":memory:", reason=False) as kb:
            alone.append(_work(kb, settings, seed, index))
    result = {
        "seed": seed,
        "shared": shared,
        "compared": settings["compared"],
        "alone": alone,
        "cpu_s": round(time.process_time() - started, 1),
    }
    figures = _figures(result, int(settings["max_attempts"]))["robots"]
    return {**result, "says": f"seed {seed}: {'; '.join(map(_robot_words, figures))}"}


def _work(kb: KnowledgeBase, settings: Mapping[str, Any], seed: int, index: int) -> dict[str, Any]:
    """Let one robot clear its table with a graph."""
    kind = str(settings["kinds"][index])
    job = RobotJob(
        f"{kind}-{index + 1}", index, "", seed, int(settings["objects"]),
        int(settings["max_attempts"]), "", "", preset=str(settings["preset"]), robot=kind,
        products=str(settings["products"]),
    )  # fmt: skip
    with (
        ScratchFolder("assets") as assets,
        rtask.connect(kb, agent=job.name) as client,
    ):
        body = make_body(job, assets)
        try:
            done = clear_table(job, body, client, tell=lambda event, about: None)
        finally:
            body.close()
    assert done is not None
    return done


def summarise_demos(results: Sequence[Mapping[str, Any]], max_attempts: int) -> dict[str, Any]:
    """Return the figures of all demos as JSON data, by the rules of this module."""
    demos = [_figures(result, max_attempts) for result in results]
    changes = [[with_it - alone for with_it, alone in demo["pairs"]] for demo in demos]
    pairs = [pair for demo in demos for pair in demo["pairs"]]
    return {
        "demos": demos,
        "attempts": [_mean([pair[k] for pair in pairs]) for k in (0, 1)],
        "first_try": [_mean([pair[k] == 1 for pair in pairs]) for k in (0, 1)],
        "change": _over_demos(changes),
        "fewer": sum(sum(change) < 0 for change in changes),
        "many_more": sum(sum(change) > _TOLERATED for change in changes),
        "lessons": _sums(demos, "lessons"),
        "robots": [
            _over_tables(robots, max_attempts)
            for robots in zip(*(demo["robots"] for demo in demos), strict=True)
        ],
    }


def _over_tables(robots: Sequence[Mapping[str, Any]], cap: int) -> dict[str, Any]:
    """Return the figures of one robot over all tables; a pair is with the graph and without."""
    changes = [sum(with_it - alone for with_it, alone in robot["pairs"]) for robot in robots]
    pairs = [pair for robot in robots for pair in robot["pairs"]]
    return {
        "robot": robots[0]["robot"],
        "attempts": [_mean([pair[k] for pair in pairs]) for k in (0, 1)],
        "first_try": [_mean([pair[k] == 1 for pair in pairs]) for k in (0, 1)],
        "never": [sum(pair[k] > cap for pair in pairs) for k in (0, 1)],
        "fewer": sum(change < 0 for change in changes),
        "more": sum(change > 0 for change in changes),
        "many_more": sum(change > _TOLERATED for change in changes),
    }


def _figures(result: Mapping[str, Any], cap: int) -> dict[str, Any]:
    """Return the figures of one demo; ``pairs`` are attempts with the graph and without."""
    robots = [
        _robot_figures(result["shared"][: index + 1], alone, cap)
        for index, alone in zip(result["compared"], result["alone"], strict=True)
    ]
    return {
        "seed": result["seed"],
        "robots": robots,
        "pairs": [pair for robot in robots for pair in robot["pairs"]],
        "from_memory": _sums(robots, "from_memory"),
        "lessons": _sums(robots, "lessons"),
        "cpu_s": result["cpu_s"],
    }


def _robot_figures(
    shared: Sequence[Mapping[str, Any]], apart: Mapping[str, Any], cap: int
) -> dict[str, Any]:
    """Return the figures of the last of ``shared``, which also worked without the others."""
    mine = {met["product"]: met for met in _tried(shared[-1])}
    alone = {met["product"]: met for met in _tried(apart)}
    # What only one of the two tried says nothing about the difference between them.
    both = sorted(mine.keys() & alone.keys())
    lessons = lessons_of(shared)
    assert lessons is not None
    chance = closed_where_held(shared[:-1], apart, knows_by_sight=False)
    first = [mine[name] for name in both if mine[name]["attempts"][0]["source"] == "memory"]
    return {
        "robot": shared[-1]["name"],
        "products": both,
        "pairs": [
            [attempts_to_success(mine[n], cap), attempts_to_success(alone[n], cap)] for n in both
        ],
        "from_memory": {
            "first": len(first),
            "held": sum(m["tries_to_success"] == 1 for m in first),
        },
        "lessons": {
            "won": lessons.won,
            "recalled": lessons.recalled,
            "followed": lessons.followed,
            "unreachable": lessons.unreachable,
            "held_elsewhere": sum(lessons.elsewhere.values()),
            "same_place": lessons.same_place,
            "places": lessons.places,
            "same_place_alone": chance[0],
            "places_alone": chance[1],
        },
        "elsewhere": dict(lessons.elsewhere),
    }


def _others(lessons: Mapping[str, int]) -> int:
    """Return how many lessons were neither recalled nor followed."""
    return lessons["won"] - lessons["recalled"] - lessons["followed"]


def _sums(robots: Sequence[Mapping[str, Any]], what: str) -> dict[str, int]:
    return {key: sum(robot[what][key] for robot in robots) for key in robots[0][what]}


def _tried(robot: Mapping[str, Any]) -> list[dict[str, Any]]:
    return objects_tried({"tables": [robot["encounters"]]})


def _mean(values: Sequence[float]) -> float | None:
    return round(float(np.mean(values)), 4) if values else None


def _over_demos(changes: Sequence[Sequence[int]]) -> dict[str, Any]:
    """Return the mean change over products with its 95 % interval over demos."""
    # Whole demos are drawn anew: products that share a table are not independent.
    groups = [change for change in changes if change]
    if not groups:
        return {"mean": None, "n": 0, "interval95": None}
    sums, counts = (np.array([f(group) for group in groups], dtype=float) for f in (sum, len))

    def mean(i: NDArray[np.intp]) -> float:
        return float(sums[i].sum() / counts[i].sum())

    return {
        "mean": round(mean(np.arange(len(groups))), 4),
        "n": int(counts.sum()),
        "interval95": [round(v, 4) for v in bootstrap(mean, len(groups))],
    }


def demo_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`, one row per seed."""
    return [
        (
            str(demo["seed"]),
            str(len(demo["pairs"])),
            *(str(sum(pair[k] for pair in demo["pairs"])) for k in (0, 1)),
            "; ".join(map(_robot_words, demo["robots"])),
            *(str(sum(pair[k] == 1 for pair in demo["pairs"])) for k in (0, 1)),
            "{recalled} of {won}".format(**demo["lessons"]),
            "{held} of {first}".format(**demo["from_memory"]),
        )
        for demo in summary["demos"]
    ]


def _robot_words(robot: Mapping[str, Any]) -> str:
    with_it, alone = (sum(pair[k] for pair in robot["pairs"]) for k in (0, 1))
    return f"{robot['robot']} {with_it}, alone {alone}"


def _over_tables_words(robot: Mapping[str, Any]) -> str:
    if None in robot["attempts"]:
        return f"{robot['robot']}: no product was tried both ways"
    with_it, alone = robot["attempts"]
    first_with, first_alone = robot["first_try"]
    return (
        f"{robot['robot']}: {with_it:.2f} attempts with the graph, {alone:.2f} without; "
        f"first tries that held {first_with:.2f} and {first_alone:.2f}; "
        f"fewer attempts in {robot['fewer']} demos, more in {robot['more']}, "
        f"of these more than {_TOLERATED} more in {robot['many_more']}; never delivered "
        f"{robot['never'][0]} and {robot['never'][1]}"
    )


def demo_words(summary: Mapping[str, Any]) -> list[str]:
    """Return what the demos show together, a sentence a line."""
    lessons, demos, change = summary["lessons"], len(summary["demos"]), summary["change"]
    if change["mean"] is None:
        return ["no product was tried both ways"]
    low, high = change["interval95"]
    with_it, alone = summary["attempts"]
    first_with, first_alone = summary["first_try"]
    return [
        f"attempts to the first success {with_it:.2f} with the graph, {alone:.2f} without: "
        f"{change['mean']:+.2f} [{low:+.2f}, {high:+.2f}] over {change['n']} products",
        f"first tries that held {first_with:.2f} with the graph, {first_alone:.2f} without",
        f"fewer attempts in {summary['fewer']} of {demos} demos, more than {_TOLERATED} more in "
        f"{summary['many_more']}",
        f"lessons recalled {lessons['recalled']} of {lessons['won']} won, and "
        f"{lessons['followed']} followed by a grasp of the robot's own at the same place; of the "
        f"other {_others(lessons)}, {lessons['held_elsewhere']} held at once elsewhere; "
        f"at {lessons['unreachable']} of those not recalled the graph's first grasp was remembered "
        "and the arm did not reach it",
        f"the hand first closed where an earlier robot had held at {lessons['same_place']} of "
        f"{lessons['places']}; the same robots without the graph, by chance, at "
        f"{lessons['same_place_alone']} of {lessons['places_alone']}",
        *map(_over_tables_words, summary["robots"]),
    ]


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = {"settings": dict(settings), **summarise_demos(results, settings["max_attempts"])}
    return Report(
        summary,
        [Table("Robots with the graph and without", COLUMNS, demo_rows(summary))],
        demo_words(summary),
    )
