"""Report of the comparison of grasps: shares that held, paired intervals, calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import mean_interval
from simulate.study.quality.promise_report import describe_fit
from simulate.study.quality.promised import coverage_of, promise_figures
from simulate.study.quality.ranks import OUTCOMES, rank_correlations
from simulate.study.quality.trial import HANDS, RULES
from simulate.study.quality.tried_fit import fit_tried
from simulate.study.quality.words import quality_words

__all__ = ["COLUMNS", "quality_rows", "quality_study", "summarise_quality"]

COLUMNS = ("hand, outcome", "objects", *RULES, "planned - confidence", "planned - sampler")


def quality_study(
    objects: int,
    trials: int,
    seed: int,
    ycb: str = "",
    preset: str = "fast",
    ranked: int = 0,
    alone: bool = False,
    made: int = 0,
    varied: bool = False,
    public: str = "",
    fit: bool = False,
) -> Study:
    """Return the comparison: for each hand ``objects`` objects with ``trials`` draws each.

    Of every plan, ``ranked`` grasps from the best to the worst are carried out, too. With ``alone``
    nothing is compared with it. With ``made`` so many generated hands take part instead of the
    Panda's and the NAO's, nothing is compared, and what the factory promises is fitted. With
    ``varied`` the generated objects are of the wider family. With ``public`` all objects are models
    of that folder. With ``fit`` the report has the maps that the generated objects would make.
    """
    settings: dict[str, Any] = {
        "seed": seed, "trials": trials, "ycb": ycb, "preset": preset, "ranked": ranked
    }  # fmt: skip
    if varied:  # a setting more only then: folders of former runs can be gone on with
        settings["varied"] = True
    if public:
        settings["public"] = public
    if fit:
        settings["fit"] = True
    if made:
        settings |= {"alone": True, "made": made, "ranked": 1}
        return Study(
            "promises of generated hands", "simulate.study.quality.trial:quality_trial", settings,
            objects * made, describe_fit,
        )  # fmt: skip
    if alone:  # the same
        settings["alone"] = True
    return Study(
        "picks of grasps", "simulate.study.quality.trial:quality_trial", settings,
        objects * len(HANDS), _describe,
    )  # fmt: skip


def summarise_quality(results: Results) -> dict[str, Any]:
    """Return the figures as JSON data.

    ``cases`` has one entry for each hand and outcome, and one over all: shares of each rule over
    the objects for which it and the planner found a grasp, and the planner's paired differences to
    the other rules with 95 % bootstrap intervals over objects. ``none`` counts objects without a
    grasp; ``coverage`` is the share of graspable objects with a planned grasp. ``gate`` says
    whether the planned pick may replace the former order. ``calibration`` sets promises beside what
    held, ``ranks`` has the rank correlations of scores with outcomes.
    """
    groups = {f"{hand}, {score}": [(r, outcome) for r in results if r["hand"] == hand]
              for hand in HANDS for outcome, score in OUTCOMES.items()}  # fmt: skip
    cases = {name: _case(group) for name, group in groups.items()}
    cases["all"] = _case([trial for group in groups.values() for trial in group])
    return {
        "objects": {hand: sum(r["hand"] == hand for r in results) for hand in HANDS},
        "none": {rule: sum(rule not in r["rules"] for r in results) for rule in RULES},
        "cases": cases,
        "coverage": {
            hand: coverage_of([r for r in results if r["hand"] == hand]) for hand in HANDS
        },
        "calibration": {
            f"{hand}, {score}": promise_figures(
                [r for r in results if r["hand"] == hand], outcome, score
            )
            for hand in HANDS
            for outcome, score in OUTCOMES.items()
        },
        "gate": _gate(cases),
        "ranks": {
            name: rank_correlations([result for result, _ in group], group[0][1])
            for name, group in groups.items()
            if group
        },
    }


def _case(group: Sequence[tuple[Mapping[str, Any], str]]) -> dict[str, Any]:
    all_three = [g for g in group if all(rule in g[0]["rules"] for rule in RULES)]
    case: dict[str, Any] = {
        rule: mean_interval([_share(r, rule, outcome) for r, outcome in all_three])
        for rule in RULES
    }
    for other in RULES[1:]:
        pairs = [g for g in group if {RULES[0], other} <= set(g[0]["rules"])]
        # The mean of both outcomes of one object is one observation, not two.
        objects: dict[tuple[str, str], list[float]] = {}
        for result, outcome in pairs:
            gain = _share(result, RULES[0], outcome) - _share(result, other, outcome)
            objects.setdefault((result["hand"], result["object"]), []).append(gain)
        case[f"minus {other}"] = mean_interval([float(np.mean(v)) for v in objects.values()])
    return case


def _share(result: Mapping[str, Any], rule: str, outcome: str) -> float:
    return float(np.mean(result["rules"][rule][outcome]))


def _gate(cases: Mapping[str, Any]) -> dict[str, bool]:
    """Judge the pick: never below the sampler's, above it overall, proven better than before."""
    each = [case for name, case in cases.items() if name != "all"]
    gains = [case["minus sampler"]["mean"] for case in each]
    overall, before = cases["all"]["minus sampler"], cases["all"]["minus confidence"]
    verdict = {
        "nowhere below the sampler": all(gain is not None and gain >= 0 for gain in gains),
        "above the sampler overall": overall["mean"] is not None and overall["mean"] > 0,
        "better than the former order": bool(before["interval95"] and before["interval95"][0] > 0),
    }
    return {**verdict, "passed": all(verdict.values())}


def quality_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    rows = []
    for name, case in summary["cases"].items():
        shares = [case[rule]["mean"] for rule in RULES]
        rows.append((
            name, str(case[RULES[0]]["n"]),
            *("-" if share is None else f"{share:.3f}" for share in shares),
            *(_difference(case[f"minus {other}"]) for other in RULES[1:]),
        ))  # fmt: skip
    return rows


def _difference(part: Mapping[str, Any]) -> str:
    """Format a paired difference with its interval.

    >>> _difference({"mean": 0.05, "n": 90, "interval95": [0.01, 0.09]})
    '+0.050 [+0.010, +0.090] n 90'
    """
    if part["mean"] is None:
        return "-"
    low, high = part["interval95"]
    return f"{part['mean']:+.3f} [{low:+.3f}, {high:+.3f}] n {part['n']}"


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = {"seed": settings["seed"], **summarise_quality(results)}
    lines = quality_words(summary)
    if settings.get("fit"):
        summary["fits"], more = _fits(results)
        lines += more
    return Report(
        summary,
        [Table("First grasps by physics", COLUMNS, quality_rows(summary))],
        lines,
        {"results": list(results)},
    )


def _fits(results: Results) -> tuple[dict[str, Any], list[str]]:
    """Return the maps that the picks on generated objects would make, and a line for each."""
    fits: dict[str, Any] = {}
    for outcome, score in OUTCOMES.items():
        try:
            made = fit_tried(results, outcome, score)
        except ValueError as error:
            return fits, [f"nothing was fitted: {error}"]
        fits[score] = {name: asdict(one) for name, one in made.items()}
    lines = [f"fitted, {score}, {name}: {numbers}" for score, by_hand in fits.items()
             for name, numbers in by_hand.items()]  # fmt: skip
    return fits, lines
