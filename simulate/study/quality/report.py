"""Report of the comparison of grasps: shares that held, paired intervals, calibration."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.recognition.metrics import expected_calibration_error
from grasp.arrays import FloatArray, IntArray
from grasp.learning.calibration import band_margin, fit_map
from grasp.spatial.scoring.holding import FACTORY, MARGIN
from simulate.study.intervals import mean_interval, share
from simulate.study.quality.ranks import OUTCOMES, rank_correlations
from simulate.study.quality.trial import HANDS, RULES
from simulate.study.runner import Study

__all__ = ["COLUMNS", "quality_rows", "quality_study", "summarise_quality", "write_quality_report"]

COLUMNS = ("hand, outcome", "objects", *RULES, "planned - confidence", "planned - sampler")
_OWN, _DRAWS = 50, 20
_HALVES, _FEWEST, _COVERAGE = 200, 9, 0.9

Results = Sequence[Mapping[str, Any]]


def quality_study(
    objects: int, trials: int, seed: int, ycb: str = "", preset: str = "fast", ranked: int = 0
) -> Study:
    """Return the comparison: for each hand ``objects`` objects with ``trials`` draws each.

    Of every plan, ``ranked`` grasps from the best to the worst are carried out, too.
    """
    settings = {
        "seed": seed, "trials": trials, "ycb": ycb, "preset": preset, "ranked": ranked
    }  # fmt: skip
    return Study(
        "picks of grasps", "simulate.study.quality.trial:quality_trial", settings,
        objects * len(HANDS),
    )  # fmt: skip


def summarise_quality(results: Results) -> dict[str, Any]:
    """Return the figures as JSON data.

    ``cases`` has one entry for each hand and outcome, and one over all: shares of each rule over
    the objects for which it and the planner found a grasp, and the planner's paired differences to
    the other rules with 95 % bootstrap intervals over objects. ``none`` counts objects without a
    grasp. ``gate`` says whether the planned pick may replace the former order. ``ranks`` has the
    rank correlations of scores with outcomes.
    """
    groups = {f"{hand}, {score}": [(r, outcome) for r in results if r["hand"] == hand]
              for hand in HANDS for outcome, score in OUTCOMES.items()}  # fmt: skip
    cases = {name: _case(group) for name, group in groups.items()}
    cases["all"] = _case([trial for group in groups.values() for trial in group])
    return {
        "objects": {hand: sum(r["hand"] == hand for r in results) for hand in HANDS},
        "none": {rule: sum(rule not in r["rules"] for r in results) for rule in RULES},
        "cases": cases,
        "calibration": {name: _promises(group) for name, group in groups.items()},
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


def _promises(group: Sequence[tuple[Mapping[str, Any], str]]) -> dict[str, Any]:
    """Compare what was promised of the planned picks with what held: raw, and by maps."""
    promised: list[float] = []
    held: list[bool] = []
    objects: list[int] = []
    for number, (result, outcome) in enumerate(group):
        pick = result["rules"].get(RULES[0])
        promise = None if pick is None else pick["promised"].get(OUTCOMES[outcome])
        if pick is not None and promise is not None:
            promised += [promise] * len(pick[outcome])
            held += [bool(h) for h in pick[outcome]]
            objects += [number] * len(pick[outcome])
    if not held:
        return {"n": 0}
    score = OUTCOMES[group[0][1]]
    learnt = _after_own_outcomes(score, np.array(promised), np.array(held), np.array(objects))
    mapped = np.array([FACTORY[score].chance(value) for value in promised])
    starts = np.flatnonzero(np.diff(objects, prepend=-1))
    shares = np.add.reduceat(np.array(held, dtype=np.float64), starts) / np.diff(
        starts, append=len(held)
    )
    learnt |= _covered(mapped[starts], shares, MARGIN[score])
    return {
        "n": len(held),
        "error_by_factory": round(expected_calibration_error(mapped, np.array(held)), 4),
        "gap_by_factory": round(abs(float(mapped.mean()) - float(np.mean(held))), 4),
        **learnt,
        "promised": round(float(np.mean(promised)), 4),
        "held": round(float(np.mean(held)), 4),
        "error": round(expected_calibration_error(np.array(promised), np.array(held)), 4),
    }


def _after_own_outcomes(
    score: str,
    promised: FloatArray,
    held: NDArray[np.bool_],
    objects: IntArray,
) -> dict[str, float]:
    """Return what a map from 50 outcomes promises of other objects: error and gap of the means.

    Means over 20 draws: half of the objects give the outcomes, the other half is judged.
    """
    rng = np.random.default_rng(0)
    numbers = np.unique(objects)
    errors, gaps = [], []
    for _ in range(_DRAWS if len(numbers) > 1 else 0):
        mine = rng.permutation(numbers)[: len(numbers) // 2]
        own = np.flatnonzero(np.isin(objects, mine))
        own = rng.permutation(own)[:_OWN]
        own_outcomes = zip(promised[own].tolist(), held[own].tolist(), strict=True)
        fitted = fit_map(own_outcomes, FACTORY[score])
        new = ~np.isin(objects, mine)
        chances = np.array([fitted.chance(score) for score in promised[new].tolist()])
        errors.append(expected_calibration_error(chances, held[new]))
        gaps.append(abs(float(chances.mean()) - float(held[new].mean())))
    if not errors:
        return {}
    return {
        "error_after_50": round(float(np.mean(errors)), 4),
        "gap_after_50": round(float(np.mean(gaps)), 4),
    }


def _covered(chances: FloatArray, shares: FloatArray, margin: float) -> dict[str, Any]:
    """Return of how many objects at least the promised share held, nine of ten being aimed at.

    By the factory's margin, with an interval; and by one from half of the objects over the other
    half: the mean over 200 draws, beside what it would be if no two objects were alike. That is
    above .9, as a margin is that of some object; the rest of the excess comes from ties.
    """
    least = np.maximum(chances - margin, 0.0)
    hits = share(int((shares >= least - 1e-9).sum()), len(shares))
    coverage = {"covered": round(hits["share"], 4), "covered_95": hits["interval95"]}
    rng, halves = np.random.default_rng(0), []
    for _ in range(_HALVES if len(shares) // 2 >= _FEWEST else 0):
        order = rng.permutation(len(shares))
        earlier, new = order[: len(order) // 2], order[len(order) // 2 :]
        margin = band_margin(chances[earlier], shares[earlier], _COVERAGE)
        least = np.maximum(chances[new] - margin, 0.0)
        halves.append(float((shares[new] >= least - 1e-9).mean()))
    if halves:
        places = len(shares) // 2 + 1
        rank = np.ceil(places * _COVERAGE - 1e-9)
        coverage["covered_by_halves"] = round(float(np.mean(halves)), 4)
        coverage["expected_by_halves"] = round(float(rank / places), 4)
    return coverage


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


def write_quality_report(folder: Path, results: Results, seed: int) -> dict[str, Any]:
    """Write ``report.json``; return the figures."""
    summary = {"seed": seed, **summarise_quality(results)}
    text = json.dumps({**summary, "results": list(results)}, indent=1)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    return summary
