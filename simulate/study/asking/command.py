"""``rtask study asking-price``: questions, goals and costs as the price of asking goes up."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from simulate import options
from simulate.study.chart import Line, line_chart
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import bootstrap

__all__ = ["asking_price", "summary_of"]

_PRICES = (0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0)
_COLUMNS = ("price of asking", "questions", "failed steps", "reached", "cost", "never asks: cost",
            "always asks: cost", "saved against the better one", "95 %")  # fmt: skip
_CHART = "costs.png"


@study_command("rtask-asking-price", "asking-price", with_preset=False)
@options.trials(30, "Number of labs, each with several goals.")
@options.seed("every lab")
@click.option("--things", default=6, show_default=True, help="Things in a lab.")
@click.option("--goals", default=3, show_default=True, help="Goals in a lab.")
@click.option(
    "--moved", type=click.FloatRange(0, 1), default=0.15, show_default=True,
    help="Chance that a thing is not where the graph has it.",
)  # fmt: skip
@click.option(
    "--failing-price", type=click.FloatRange(0), default=60.0, show_default=True,
    help="What a step that fails costs, in any unit.",
)  # fmt: skip
def asking_price(
    trials: int, seed: int, things: int, goals: int, moved: float, failing_price: float
) -> Study:
    """Measure what comes of goals as a question to a person gets dearer.

    Things slip with chances that robots know from six attempts each; a person who answers helps.
    Robots that weigh the price of asking work in the same labs as robots that never ask, and as
    robots that always do. The lab has no dynamics.
    """
    settings = {"seed": seed, "things": things, "goals": goals, "moved": moved,
                "failing": failing_price, "asking": list(_PRICES)}  # fmt: skip
    path = "simulate.study.asking.trial:run_trial"
    return Study("asking-price", path, settings, trials, _describe)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results, settings)
    rows = [
        [
            f"{row['price']:g}", str(row["questions"]), str(row["failed"]),
            f"{row['reached']} of {row['goals']}", f"{row['cost']:.1f}", f"{row['never']:.1f}",
            f"{row['always']:.1f}", f"{row['saved']:.1f}",
            "{:.1f} to {:.1f}".format(*row["saved_95"]),
        ]
        for row in summary["prices"]
    ]  # fmt: skip
    ends = [
        f"robots that {rule} ask: {row['questions']} questions, {row['failed']} failed steps, "
        f"{row['reached']} of {row['goals']} goals reached"
        for rule, row in summary["rules"].items()
    ]
    prices = [float(row["price"]) for row in summary["prices"]]
    costs = (("weighed", "cost"), ("never ask", "never"), ("always ask", "always"))
    line_chart(
        folder / _CHART, f"Costs of a lab, a failed step at {settings['failing']:g}",
        "price of a question", "cost of a lab",
        [Line(name, prices, [row[key] for row in summary["prices"]]) for name, key in costs],
    )  # fmt: skip
    return Report(
        summary,
        [Table(f"Costs of a lab, a failed step at {settings['failing']:g}", _COLUMNS, rows)], ends,
        more={"trials": [dict(result) for result in results]}, pictures=[_CHART],
    )  # fmt: skip


def summary_of(results: Results, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return counts over all labs and mean costs of a lab, with paired 95 % intervals.

    What is saved is the cost under the better of the two rules that do not weigh, at that price,
    less the cost of the robots that do.
    """
    failing = settings["failing"]
    prices = []
    for price in settings["asking"]:
        costs = {
            rule: np.array([_cost(result[rule], price, failing) for result in results])
            for rule in (f"{price:g}", "never", "always")
        }
        weighed = costs[f"{price:g}"]
        better = min(("never", "always"), key=lambda rule: float(costs[rule].mean()))
        saved = costs[better] - weighed
        prices.append(
            {
                "price": price, **_totals(results, f"{price:g}"), "cost": float(weighed.mean()),
                "never": float(costs["never"].mean()), "always": float(costs["always"].mean()),
                "better": better, "saved": float(saved.mean()),
                "saved_95": list(bootstrap(_mean_of(saved), len(saved))),
            }
        )  # fmt: skip
    return {
        "labs": len(results), "failing_price": failing, "prices": prices,
        "rules": {rule: _totals(results, rule) for rule in ("never", "always")},
    }  # fmt: skip


def _mean_of(values: np.ndarray[Any, Any]) -> Any:
    return lambda chosen: float(values[chosen].mean())


def _cost(result: Mapping[str, Any], asking: float, failing: float) -> float:
    return float(result["questions"] * asking + result["failed"] * failing)


def _totals(results: Results, rule: str) -> dict[str, int]:
    return {
        name: sum(result[rule][name] for result in results)
        for name in ("goals", "questions", "failed", "reached", "declined")
    }
