"""``rtask study tasks``: how often random goals are reached although something comes between."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from simulate import options
from simulate.study.chart import bar_chart, share_bar
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import wilson

__all__ = ["summary_of", "tasks"]

_COLUMNS = ("event", "goals", "possible", "reached", "declined", "given up", "planned again")
_CHART = "shares.png"
_MOST_THINGS = 4
"""At which there is room for a hand between things on each table."""


@study_command("rtask-tasks", with_preset=False)
@options.trials(20, "Number of goals; events take turns.")
@options.seed("every goal")
@click.option("--things", default=6, show_default=True, help="Things in the lab.")
@click.option(
    "--slip", type=click.FloatRange(0, 1), default=0.1, show_default=True,
    help="Chance that a thing slips from the hand.",
)  # fmt: skip
@click.option("--no-events", is_flag=True, help="Let nothing come between.")
@click.option(
    "--arms", "tables", multiple=True, metavar="TABLE",
    help="Let whole arms carry it out in physics at this table: nao, panda or sorting (two Naos "
    "and a Panda). Several take turns; --slip does not apply. A goal takes 10 to 60 s of one core.",
)  # fmt: skip
def tasks(
    trials: int, seed: int, things: int, slip: float, no_events: bool, tables: tuple[str, ...]
) -> Study:
    """Measure how often random goals are reached in a lab of two tables with two robots each.

    In a third of the goals a thing has to change hands. In each, one event comes between: a person
    moves the thing, it falls, it is taken away, a person says no, a program is killed, an arm fails
    for good, or a door is shut. Of these, whole arms meet four: a person moves the thing, takes it
    out of the hand, or says no, and the program of a robot is killed with the thing in its hand.
    """
    from simulate.study.tasks import arms_trial
    from simulate.study.tasks.trial import EVENTS
    from simulate.tasks.arms.working import layouts_of

    if tables:
        layouts_of(tables)
        own = {"seed": seed, "things": min(things, _MOST_THINGS), "preset": "faithful",
               "tables": list(tables),
               "events": [] if no_events else list(arms_trial.EVENTS)}  # fmt: skip
        return Study("tasks", "simulate.study.tasks.arms_trial:run_trial", own, trials, _describe)
    events = [] if no_events else list(EVENTS)
    settings = {"seed": seed, "things": things, "slip": slip, "events": events}
    return Study("tasks", "simulate.study.tasks.trial:run_trial", settings, trials, _describe)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results)
    rows = [[name or "none", *(str(row[column]) for column in _COLUMNS[1:])]
            for name, row in summary["by_event"].items()]  # fmt: skip
    low, high = summary["reached_95"]
    bars = []
    for event in summary["by_event"]:
        ends = [result["result"] for result in results
                if result["event"] == event and _counts(result)]  # fmt: skip
        if ends:
            bars.append(share_bar(event or "none", "reached", ends.count("reached"), len(ends)))
    bar_chart(folder / _CHART, "Goals reached, by what came between", "share of those possible",
              bars)  # fmt: skip
    return Report(
        summary,
        [Table("Random goals", _COLUMNS, rows)],
        [
            f"reached {summary['reached']} of {summary['possible']} that could be, "
            f"{low:.2f} to {high:.2f}; {summary['handovers']} took several robots",
            f"lost from memory {summary['lost']}, at another place than remembered "
            f"{summary['wrong']}, stored twice {summary['twice']}; slowest repair "
            f"{summary['slowest_repair_s']:.2f} s of processor time",
            *_of_arms(results),
        ],
        pictures=[_CHART],
    )


def _of_arms(results: Results) -> list[str]:
    """Return what whole arms did, in a line for each kind of table; nothing for other bodies."""
    lines = []
    for table in dict.fromkeys(result["table"] for result in results if "table" in result):
        at = [result for result in results if result["table"] == table]
        able = [result for result in at if _counts(result)]
        reached = sum(result["result"] == "reached" for result in able)
        picks, held = (sum(result[name] for result in at) for name in ("picks", "held"))
        false = sum(not result["is_true"] for result in at)
        lines.append(
            f"table {table}: reached {reached} of {len(able)}, {held} of {picks} picks held; "
            f"reached by the robots' word but not in the physics {false}"
        )
    return lines


def summary_of(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of a study.

    Goals that a person declined, and those that no arm could reach after the event, are counted
    apart.
    """
    possible = [result for result in results if _counts(result)]
    reached = sum(result["result"] == "reached" for result in possible)
    events = dict.fromkeys(result["event"] for result in results)
    return {
        "goals": len(results),
        "possible": len(possible),
        "reached": reached,
        "reached_95": list(wilson(reached, len(possible))) if possible else [0.0, 1.0],
        "handovers": sum(result["robots"] > 1 for result in results),
        "lost": sum(result["lost"] for result in results),
        "wrong": sum(result["wrong"] for result in results),
        "twice": sum(result["twice"] for result in results),
        "slowest_repair_s": max((result["repair_s"] for result in results), default=0.0),
        "by_event": {event: _row(event, results) for event in events},
        "trials": [dict(result) for result in results],
    }


def _counts(result: Mapping[str, Any]) -> bool:
    """Whether a goal could be reached, and nobody declined it."""
    return bool(result["result"] != "declined" and result["possible"])


def _row(event: str, results: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    chosen = [result for result in results if result["event"] == event]
    ends = Counter(result["result"] for result in chosen)
    return {
        "goals": len(chosen), "possible": sum(r["possible"] for r in chosen),
        "reached": ends["reached"], "declined": ends["declined"],
        "given up": ends["given_up"], "planned again": sum(r["repairs"] for r in chosen),
    }  # fmt: skip
