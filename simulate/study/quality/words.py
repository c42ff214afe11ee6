"""What a study of grasp quality says below its table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["quality_words"]


def quality_words(summary: Mapping[str, Any]) -> list[str]:
    """Return coverage, promises, rank correlations and the gate, a line each."""
    lines = []
    for hand, found in summary["coverage"].items():
        if found["n"]:
            low, high = found["interval95"]
            lines.append(
                f"{hand}: a grasp on {found['hits']} of {found['n']} graspable objects, "
                f"{found['share']:.3f} [{low:.3f}, {high:.3f}]"
            )
    for name, row in summary["calibration"].items():
        if row["n"]:
            lines += _promises(name, row)
    for name, row in summary["ranks"].items():
        if row["grasps"]:
            lines.append(
                f"{name}: rank correlation of score and share held over all "
                f"{row['grasps']} grasps {_correlation(row['over'])}, within objects "
                f"{_correlation(row['within'])}; were the chances the truth, "
                f"{_number(row['attainable']['over'])} and "
                f"{_number(row['attainable']['within'])}; {json.dumps(row['spread'])}"
            )
    none, gate = json.dumps(summary["none"]), json.dumps(summary["gate"])
    return [*lines, f"no grasp found: {none}", f"gate: {gate}"]


def _promises(name: str, row: Mapping[str, Any]) -> list[str]:
    """Return what was promised of a hand's picks beside what held."""
    lines = [
        f"{name}: score {row['promised']:.3f}, held {row['held']:.3f}; calibration error of the "
        f"score {row['error']:.3f}, of the promise {row['error_by_factory']:.3f}, after 50 own "
        f"outcomes {row.get('error_after_50', float('nan')):.3f}; n {row['n']}",
        f"  promised / held by quarters: {_quarters(row['quarters'])}; widest gap "
        f"{row['widest_gap']:.3f} (right promises would show some {row['chance_gap']:.3f}), "
        f"by a map of the score alone {row['former_widest_gap']:.3f}; "
        f"squared error less that map's {_signed(row['less_former'])}",
    ]
    if "quarters_after_50" in row:
        lines.append(
            f"  after 50 own outcomes: {_quarters(row['quarters_after_50'])}; widest gap "
            f"{row['widest_gap_after_50']:.3f}"
        )
    lines.append(
        f"  at least what is promised at 90 %: {row['covered']:.3f} {row['covered_95']} of the "
        f"objects, nothing promised on {row['abstained']:.3f}, with margins from halves of them "
        f"{row.get('covered_by_halves', float('nan')):.3f}, of which their number explains "
        f"{row.get('expected_by_halves', float('nan')):.3f}"
    )
    return lines


def _quarters(quarters: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(
        f"{part['promised']:.2f} / {part['held']:.2f}" + _interval(part.get("gap_interval95"))
        for part in quarters
    )


def _interval(ends: Sequence[float] | None) -> str:
    """Return the interval of promised less held, if it is known.

    >>> _interval([-0.02, 0.05]), _interval(None)
    (' [-0.02, +0.05]', '')
    """
    return "" if ends is None else f" [{ends[0]:+.2f}, {ends[1]:+.2f}]"


def _signed(difference: Mapping[str, Any]) -> str:
    low, high = difference["interval95"]
    return f"{difference['mean']:+.4f} [{low:+.4f}, {high:+.4f}]"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _correlation(correlation: Mapping[str, Any]) -> str:
    """Return a correlation with its interval and the number of objects."""
    if correlation["mean"] is None:
        return "-"
    low, high = correlation["interval95"]
    return f"{correlation['mean']:.2f} [{low:.2f}, {high:.2f}] (n {correlation['n']})"
