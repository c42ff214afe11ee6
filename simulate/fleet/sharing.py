"""The study of sharing: many small fleets with one graph, and with one graph per robot.

A trial is a fleet whose robots work one after the other in this process: the first encounters only
unknown objects; for the n-th, half of the objects are known to the n - 1 robots before it. Then all
but the first, for which nothing would change, repeat the work with a graph of their own. Nothing
depends on real time, so a trial is determined by its seed and number alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import rtask
from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.scratch import ScratchFolder
from simulate.demo.report import attempts_to_success
from simulate.fleet.assignment import FleetPlan, MemberJob, plan_fleet
from simulate.fleet.figures import objects_tried, recognised_products, score_identities
from simulate.fleet.headroom import headroom_won, headroom_words
from simulate.fleet.member import Member
from simulate.robots import describe
from simulate.study.chart import Line, line_chart
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap
from simulate.world.seeds import mix_seed

__all__ = [
    "COLUMNS",
    "MAX_ATTEMPTS",
    "sharing_rows",
    "sharing_study",
    "sharing_trial",
    "summarise_sharing",
]

COLUMNS = (
    "graph", "robot", "attempts, common", "first try, common", "attempts, own", "recognised",
    "false", "memory first, held",
)  # fmt: skip

Condition = Literal["shared", "not shared"]
MAX_ATTEMPTS = 6
"""At one object."""

_CONDITIONS: tuple[Condition, ...] = ("shared", "not shared")


def sharing_study(
    fleets: int,
    robots: int,
    objects: int,
    on_table: int,
    seed: int,
    prior: bool,
    preset: str,
    products: str = "plain",
    kinds: Sequence[str] = ("nao",),
    look_alikes: bool = False,
) -> Study:
    """Return the study of a number of fleets, each with its own products and tables.

    Parameters
    ----------
    kinds
        Kinds of the robots, in turn.
    look_alikes
        Whether all robots but the first meet products that only look like those of the first: a
        control, in which what was learned misleads.

    Raises
    ------
    UsageError
        If a number is out of range, or the products have no secret in which they could differ.
    """
    if look_alikes and products == "plain":
        raise UsageError("plain products are what they look like; look-alikes need --products hard")
    plan_fleet(robots, objects, on_table, seed, products)
    for kind in kinds:
        describe(kind)
    return Study(
        "what sharing is worth",
        "simulate.fleet.sharing:sharing_trial",
        {
            "seed": seed, "robots": robots, "objects": objects, "on_table": on_table,
            "prior": prior, "preset": preset, "max_attempts": MAX_ATTEMPTS,
            "products": products, "kinds": list(kinds), "look_alikes": look_alikes,
        },
        fleets, _describe,
    )  # fmt: skip


def sharing_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Run one fleet with and without sharing; return its encounters as JSON data."""
    seed = mix_seed(int(settings["seed"]), number)
    robots = int(settings["robots"])
    with rtask.open(":memory:", reason=False) as kb:
        shared = [_life(kb, settings, seed, index) for index in range(robots)]
    alone = [shared[0]]
    for index in range(1, robots):
        with rtask.open(":memory:", reason=False) as kb:
            alone.append(_life(kb, settings, seed, index))
    plan = _plan(settings, seed)
    return {
        "common": [name for table in plan.common for name in table],
        "shared": shared,
        "not shared": alone,
        "says": f"fleet {number + 1} has worked both ways",
    }


def _plan(settings: Mapping[str, Any], seed: int) -> FleetPlan:
    return plan_fleet(
        int(settings["robots"]), settings["objects"], settings["on_table"], seed,
        str(settings["products"]),
    )  # fmt: skip


def _life(kb: KnowledgeBase, settings: Mapping[str, Any], seed: int, index: int) -> dict[str, Any]:
    """Run one robot until all its tables are clear."""
    plan = _plan(settings, seed)
    name, kinds = f"robot-{index + 1}", settings["kinds"]
    job = MemberJob(
        name, index, "", seed, plan.tables(index), int(settings["max_attempts"]),
        bool(settings["prior"]), "", preset=str(settings["preset"]),
        robot=str(kinds[index % len(kinds)]), look_alikes=index > 0 and settings["look_alikes"],
    )  # fmt: skip
    with (
        ScratchFolder("assets") as assets,
        rtask.connect(kb, agent=name) as client,
    ):
        member = Member(job, client, lambda event, about: None, assets)
        tables = [member.clear(number) for number in range(len(job.tables))]
    return {"name": name, "tables": tables}


def summarise_sharing(results: Sequence[Mapping[str, Any]], max_attempts: int) -> dict[str, Any]:
    """Return the figures of all fleets as JSON data.

    Intervals are over products, each with all its encounters, because an object that is easy to
    hold is so for every robot.
    """
    meetings = _meetings(results, max_attempts)
    robots = sorted({robot for _, robot, _, _ in meetings})
    rows = []
    for condition in _CONDITIONS:
        for robot in robots:
            mine = {k: v for k, v in meetings.items() if k[:2] == (condition, robot)}
            common = {k: v for k, v in mine.items() if k[3][1]}
            own = {k: v for k, v in mine.items() if not k[3][1]}
            right, false = _identities(results, condition, robot)
            rows.append(
                {
                    "graph": condition,
                    "robot": robot,
                    "attempts_common": _over_products(common),
                    "first_try_common": _over_products({k: v == 1 for k, v in common.items()}),
                    "attempts_own": _over_products(own),
                    "recognised": right,
                    "false_identities": false,
                    "memory_first": _memory_first(results, condition, robot),
                }
            )
    return {
        "fleets": len(results),
        "robots": rows,
        "shared_less_not_shared": {
            "common": _gain(meetings, common=True),
            "own": _gain(meetings, common=False),
        },
        "last_less_first": {
            condition: _last_less_first(meetings, condition, robots) for condition in _CONDITIONS
        },
        "headroom": {condition: headroom_won(results, condition) for condition in _CONDITIONS},
    }


# Key of an encounter: graph, number of robot and fleet, product and whether it is common.
_Key = tuple[str, int, int, tuple[str, bool]]
_Values = Mapping[_Key, float]


def _meetings(results: Sequence[Mapping[str, Any]], cap: int) -> dict[_Key, float]:
    """Return the attempts of each encounter with a product."""
    return {
        (condition, index + 1, fleet, (m["product"], m["product"] in result["common"])): float(
            attempts_to_success(m, cap)
        )
        for fleet, result in enumerate(results)
        for condition in _CONDITIONS
        for index, robot in enumerate(result[condition])
        for m in objects_tried(robot)
    }


def _identities(
    results: Sequence[Mapping[str, Any]], condition: Condition, robot: int
) -> tuple[int, int]:
    """Return how many objects the n-th robots recognised correctly and falsely."""
    scored = [
        score_identities({"robots": result[condition]})[f"robot-{robot}"]
        if condition == "shared"
        else score_identities({"robots": [result[condition][robot - 1]]})[f"robot-{robot}"]
        for result in results
    ]
    return sum(right for right, _ in scored), sum(false for _, false in scored)


def _memory_first(
    results: Sequence[Mapping[str, Any]], condition: Condition, robot: int
) -> dict[str, int]:
    """Return how many objects the n-th robots recognised rightly and tried, at how many of them the
    first grasp came from memory, and how many of these held and were not lost on the way.
    """
    met: list[Mapping[str, Any]] = []
    for result in results:
        robots = result[condition][:robot]
        products = recognised_products(robots if condition == "shared" else robots[-1:])
        met += [
            encounter
            for encounter in objects_tried(robots[-1])
            if encounter["attempts"] and encounter["recognised"]
            if products.get(encounter["recognised"]) == encounter["product"]
        ]
    recalled = [encounter for encounter in met if encounter["attempts"][0]["source"] == "memory"]
    held = sum(encounter["tries_to_success"] == 1 for encounter in recalled)
    return {"known": len(met), "recalled": len(recalled), "held": held}


def _over_products(values: _Values) -> dict[str, Any]:
    """Return the mean over encounters with its 95 % interval over products (cluster bootstrap)."""
    groups: dict[tuple[int, str], list[float]] = defaultdict(list)
    for (_, _, fleet, (product, _)), value in values.items():
        groups[fleet, product].append(float(value))
    if not groups:
        return {"mean": None, "n": 0, "products": 0, "interval95": None}
    sums = np.array([sum(group) for group in groups.values()])
    counts = np.array([len(group) for group in groups.values()])

    def mean(i: NDArray[np.intp]) -> float:
        return float(sums[i].sum() / counts[i].sum())

    low, high = bootstrap(mean, len(sums))
    return {
        "mean": round(float(sums.sum() / counts.sum()), 4),
        "n": int(counts.sum()),
        "products": len(sums),
        "interval95": [round(low, 4), round(high, 4)],
    }


def _gain(meetings: _Values, common: bool) -> dict[str, Any]:
    """Return the effect of sharing on attempts and first tries of all robots but the first."""
    pairs = {
        key: (value, meetings["not shared", *key[1:]])
        for key, value in meetings.items()
        if key[0] == "shared" and key[1] > 1 and key[3][1] is common
        if ("not shared", *key[1:]) in meetings
    }
    return {
        "attempts": _over_products({k: a - b for k, (a, b) in pairs.items()}),
        "first_try": _over_products({k: (a == 1) - (b == 1) for k, (a, b) in pairs.items()}),
    }


def _last_less_first(
    meetings: _Values, condition: Condition, robots: Sequence[int]
) -> dict[str, Any]:
    """Return the difference of the last robot's attempts from the first's on common products."""
    last = robots[-1] if robots else 0
    change: dict[_Key, float] = {
        (condition, last, fleet, what): value - meetings[condition, 1, fleet, what]
        for (graph, robot, fleet, what), value in meetings.items()
        if graph == condition and robot == last > 1 and what[1]
        if (condition, 1, fleet, what) in meetings
    }
    return _over_products(change)


def sharing_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            str(row["graph"]),
            str(row["robot"]),
            *(show(row[name]) for name in ("attempts_common", "first_try_common", "attempts_own")),
            str(row["recognised"]),
            str(row["false_identities"]),
            "{recalled} of {known}, {held}".format(**row["memory_first"]),
        )
        for row in summary["robots"]
    ]


def show(measure: Mapping[str, Any], form: str = ".2f") -> str:
    """Format a mean with its interval.

    >>> show({"mean": 1.5, "interval95": [1.0, 2.25]})
    '1.50 [1.00, 2.25]'
    """
    if measure["mean"] is None:
        return "-"
    low, high = measure["interval95"]
    return f"{measure['mean']:{form}} [{low:{form}}, {high:{form}}]"


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = {"settings": dict(settings), **summarise_sharing(results, settings["max_attempts"])}
    lines = []
    for what in ("common", "own"):
        for condition in _CONDITIONS:
            rows = [
                r for r in summary["robots"]
                if r["graph"] == condition and r[f"attempts_{what}"]["mean"] is not None
            ]  # fmt: skip
            values = [r[f"attempts_{what}"] for r in rows]
            if values:
                lines.append(
                    Line(
                        f"{what}, {condition}",
                        [r["robot"] for r in rows],
                        [m["mean"] for m in values],
                        [m["interval95"][0] for m in values],
                        [m["interval95"][1] for m in values],
                    )
                )
    if lines:
        line_chart(
            folder / "sharing.png", f"{len(results)} fleets, 95 % intervals over products",
            "robot", "attempts to first success", lines,
        )  # fmt: skip
    return Report(
        summary,
        [Table("Attempts to first success", COLUMNS, sharing_rows(summary))],
        _words(summary),
        pictures=["sharing.png"] if lines else [],
    )


def _words(summary: Mapping[str, Any]) -> list[str]:
    """Return what sharing was worth, a measure a line."""
    lines = [
        f"shared less not shared, {what}, {measure.replace('_', ' ')}: {show(value, '+.2f')}, "
        f"{value['n']} encounters"
        for what, gain in summary["shared_less_not_shared"].items()
        for measure, value in gain.items()
    ]
    for condition, value in summary["last_less_first"].items():
        lines.append(f"last less first, {condition}: {show(value, '+.2f')}")
    for condition, value in summary["headroom"].items():
        lines.append(f"headroom won by the last robot, {condition}: {headroom_words(value)}")
    return lines
