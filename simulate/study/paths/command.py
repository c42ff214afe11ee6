"""``rtask study paths``: the work of planning paths with a memory of those that worked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from simulate import options
from simulate.study.chart import Bar, bar_chart
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap

__all__ = ["paths", "summary_of"]

_COLUMNS = ("table", "things", "need a search", "reached anew, recalled", "postures anew, recalled",
            "of the first way", "all checked, shortening too", "whole planning",
            "processor time", "way")  # fmt: skip
_CHART = "ratios.png"
_DRAWN = (("of_first", "until the first way"), ("work", "whole planning"), ("way_s", "way"))
_SHARES = ("checks", "of_first", "all", "work", "cpu_s", "way_s")


@study_command("rtask-paths", with_preset=False, processes=1)
@options.trials(40, "Number of fresh tables; open ones and those with boards take turns.")
@options.seed("every table")
@click.option("--robot", default="panda", show_default=True, help="Kind of robot.")
@click.option("--things", default=4, show_default=True, help="Things on a table.")
@click.option(
    "--before", default=30, show_default=True,
    help="Tables of each kind from which paths are remembered.",
)  # fmt: skip
def paths(trials: int, seed: int, robot: str, things: int, before: int) -> Study:
    """Measure what remembered paths save on fresh tables, beside planning each anew.

    For each thing the ways to it, into a box and home are planned twice with the same seeds.
    Planning anew and mending a recalled path take turns, and the first valid path is taken. Work is
    counted in postures that are checked for collisions, which are the same on every machine.
    """
    from simulate.robots import describe

    describe(robot)
    settings = {"seed": seed, "robot": robot, "things": things, "before": before}
    return Study("paths", "simulate.study.paths.trial:run_trial", settings, trials, _describe)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results)
    rows = []
    for kind, row in summary["tables"].items():
        reached = "{}, {}".format(*row["reached"])
        checks = "{:.0f}, {:.0f}".format(*row["median_checks"])
        counts = [kind, str(row["things"]), str(row["searched"]), reached, checks]
        rows.append([*counts, *(_words(row[name]) for name in _SHARES[1:])])
    verdicts = [f"{kind}: {row['verdict']}" for kind, row in summary["tables"].items()]
    bars = [
        Bar(kind, words, row[name]["ratio"], *row[name]["interval95"])
        for kind, row in summary["tables"].items() for name, words in _DRAWN
    ]  # fmt: skip
    bar_chart(folder / _CHART, f"{settings['robot']}: remembered over anew", "ratio", bars)
    title = f"{settings['robot']}: ratios are recalled / anew, with 95 % intervals"
    return Report(
        summary, [Table(title, _COLUMNS, rows)], verdicts,
        more={"trials": [dict(result) for result in results]}, pictures=[_CHART],
    )  # fmt: skip


def _words(ratio: Mapping[str, Any]) -> str:
    low, high = ratio["interval95"]
    return f"{ratio['ratio']:.2f} ({low:.2f} to {high:.2f})"


def summary_of(results: Results) -> dict[str, Any]:
    """Return, by kind of table, how often things were reached, and ratios of medians of the work.

    Only things of which a way planned anew is not straight are compared: the others need no memory.
    Intervals are of tables drawn anew.
    """
    kinds = dict.fromkeys(result["kind"] for result in results)
    return {"tables": {kind: _row([r for r in results if r["kind"] == kind]) for kind in kinds}}


def _row(results: Results) -> dict[str, Any]:
    searched = [
        [thing for thing in result["things"] if "planned" in thing["anew"]["origins"]]
        for result in results
    ]
    flat = [thing for table in searched for thing in table]
    reached = [sum(thing[way]["reached"] for thing in flat) for way in ("anew", "recalled")]
    figures = {name: _ratio(searched, name) for name in _SHARES}
    return {
        "tables": len(results), "things": sum(len(result["things"]) for result in results),
        "searched": len(flat), "reached": reached,
        "median_checks": [_median(searched, range(len(searched)), "checks", way)
                          for way in ("anew", "recalled")],
        **figures, "verdict": _verdict(reached, figures),
    }  # fmt: skip


def _verdict(reached: Sequence[int], figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Apply the rule by which robots recall paths or not; it was set before the first whole run."""
    if reached[1] < reached[0]:
        return "less is reached: not used"
    if figures["work"]["interval95"][1] >= 1:
        return "no less work for whole plans: not used"
    if figures["way_s"]["interval95"][1] > 1.05:
        return "ways are longer: not used"
    return "less work, as much is reached, and ways are as short: used"


def _value(thing: Mapping[str, Any], name: str, way: str) -> float:
    row = thing[way]
    return float(row["checks"] + row["shortening"] if name == "all" else row[name])


def _median(
    tables: Sequence[Sequence[Mapping[str, Any]]], chosen: Any, name: str, way: str
) -> float:
    """Return a median over the things that are reached in both ways."""
    values = [
        _value(thing, name, way)
        for number in chosen for thing in tables[number]
        if thing["anew"]["reached"] and thing["recalled"]["reached"]
    ]  # fmt: skip
    return float(np.median(values)) if values else 0.0


def _ratio(tables: Sequence[Sequence[Mapping[str, Any]]], name: str) -> dict[str, Any]:
    def ratio(chosen: Any) -> float:
        anew = _median(tables, chosen, name, "anew")
        return _median(tables, chosen, name, "recalled") / anew if anew else 1.0

    return {
        "ratio": ratio(range(len(tables))),
        "interval95": list(bootstrap(ratio, len(tables))),
    }
