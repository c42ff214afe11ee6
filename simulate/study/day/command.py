"""``rtask study day``: what robots remember of a simulated day, judged by what truly happened."""

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

__all__ = ["day", "summary_of"]

_VERDICTS = ("right", "not known", "wrong")
_CHART = "shares.png"


@study_command("rtask-day", with_preset=False)
@options.trials(1, "Number of days.")
@options.seed("every day")
@click.option("--hours", type=click.FloatRange(0.1, 24), default=8.0, show_default=True,
              help="Length of a day.")  # fmt: skip
@click.option("--things", "items", type=click.IntRange(4, 60), default=30, show_default=True,
              help="Things in the lab; a third of them are equal pairs.")  # fmt: skip
@click.option("--questions", type=click.IntRange(min=1), default=1000, show_default=True,
              help="Questions about each day.")  # fmt: skip
@click.option("--samples", type=click.IntRange(min=0), default=12_000, show_default=True,
              help="How often the graph is asked meanwhile how sure it is.")  # fmt: skip
def day(trials: int, seed: int, hours: float, items: int, questions: int, samples: int) -> Study:
    """Let three robots live a day at two tables, and ask what they remember of it.

    Robots and people move, lose, swap, cover and box things. Robots report what they see and do by
    the public operations; what truly happened is kept apart, and judges the answers.
    """
    settings = {
        "seed": seed, "hours": hours, "things": items, "questions": questions, "samples": samples,
    }  # fmt: skip
    return Study("day", "simulate.study.day.trial:run_trial", settings, trials, _describe)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results)
    asked = [[kind, *(str(counts[verdict]) for verdict in _VERDICTS)]
             for kind, counts in summary["verdicts"].items()]  # fmt: skip
    within = [[kind, str(each["samples"]), f"{each['share']:.3f}",
               "{:.3f} to {:.3f}".format(*each["share_95"])]
              for kind, each in summary["calibration"].items()]  # fmt: skip
    bars = [share_bar(kind, verdict, counts[verdict], sum(counts.values()))
            for kind, counts in summary["verdicts"].items() for verdict in _VERDICTS]  # fmt: skip
    bar_chart(folder / _CHART, "Questions about the day", "share of answers", bars)
    return Report(
        summary,
        [
            Table("Questions about the day", ("question", *_VERDICTS), asked),
            Table("Within the distance said with 90 %", ("place", "asked", "within", "95 %"),
                  within),
        ],
        [
            f"right {summary['right']:.4f}, not known {summary['not known']:.4f}, wrong "
            f"{summary['wrong']:.4f} of {summary['questions']}; right or not known "
            f"{summary['right'] + summary['not known']:.4f}",
            f"two places at one instant {summary['two_places']}; taken for another thing "
            f"{summary['taken_for_another']}; things {summary['things']}, in the graph "
            f"{summary['things_in_graph']}",
            f"a robot that arrived found {summary['found_at_first_look']} of "
            f"{summary['looked_for']} at first look",
        ],
        pictures=[_CHART],
    )  # fmt: skip


def summary_of(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of all days together."""
    verdicts: dict[str, Counter[str]] = {}
    within: dict[str, Counter[str]] = {}
    for result in results:
        for kind, counts in result["verdicts"].items():
            verdicts.setdefault(kind, Counter()).update(counts)
        for kind, each in result["calibration"].items():
            counted = {"samples": each["samples"], "within": each["within"]}
            within.setdefault(kind, Counter()).update(counted)
    totals = Counter[str]()
    for counts in verdicts.values():
        totals.update(counts)
    questions = sum(totals.values())
    summed = ("two_places", "taken_for_another", "things", "things_in_graph")
    return {
        "days": len(results),
        "questions": questions,
        **{verdict: totals[verdict] / max(questions, 1) for verdict in _VERDICTS},
        "verdicts": {
            kind: {verdict: counts[verdict] for verdict in _VERDICTS}
            for kind, counts in verdicts.items()
        },
        "calibration": {kind: _share(counts) for kind, counts in within.items()},
        **{name: sum(result[name] for result in results) for name in summed},
        **{
            name: sum(result["newcomer"][name] for result in results)
            for name in ("looked_for", "found_at_first_look")
        },
        "trials": [dict(result) for result in results],
    }  # fmt: skip


def _share(counts: Mapping[str, int]) -> dict[str, Any]:
    samples, within = counts["samples"], counts["within"]
    return {
        "samples": samples, "within": within, "share": within / samples,
        "share_95": list(wilson(within, samples)),
    }  # fmt: skip
