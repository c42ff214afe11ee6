"""``rtask study why``: how often the cause of an injected failure is found, and mended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from simulate import options
from simulate.study.chart import bar_chart, share_bar
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import wilson

__all__ = ["summary_of", "why"]

_COLUMNS = ("injected", "failures", "cause first", "among three", "mended", "said to mend",
            "of these mended", "by the same again")  # fmt: skip
_CHART = "shares.png"
_RESAMPLED = 10_000
"""Resamples of the bootstrap."""


@study_command("rtask-why", with_preset=False)
@options.trials(60, "Number of failures; twelve kinds take turns.")
@options.seed("every failure")
@click.option(
    "--open",
    "is_open",
    is_flag=True,
    help="Four kinds instead that no hypothesis is about and no change mends.",
)
@click.option("--try", "tries", is_flag=True, help="Also try each change on branches.")
def why(trials: int, seed: int, is_open: bool, tries: bool) -> Study:
    """Measure how often `rtask why` names the cause of an injected failure, and mends it.

    After some attempts of a Nao and a Panda at a table, one fails for a cause that the graph does
    not know. The change that the answer proposes is carried out under the same cause. The lab has
    no dynamics. With --open the right answer is that the cause is unknown. With --try the first
    change that held when it was tried on a branch is compared with the first one that was not.
    """
    path = "simulate.study.why.trial:run_trial"
    settings = {"seed": seed, **({"is_open": True} if is_open else {}),
                **({"tries": True} if tries else {})}  # fmt: skip
    return Study("why", path, settings, trials, _describe)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = summary_of(results)
    rows = [[kind, *(str(row[name]) for name in _COLUMNS[1:])]
            for kind, row in summary["by_kind"].items()]  # fmt: skip
    lines = []
    for name, words in (("right", "cause first"), ("held", "the change held"),
                        ("again", "the same again held")):  # fmt: skip
        low, high = summary[f"{name}_95"]
        lines.append(f"{words}: {summary[name]} of {summary['failures']}, {low:.2f} to {high:.2f}")
    lines.append(f"said to mend: {summary['said']}, of which {summary['said_held']} did")
    lines.append(
        f"processor time of a question: mean {summary['asked_s']:.2f} s, longest "
        f"{summary['longest_s']:.2f} s"
    )
    if settings.get("tries"):
        lines += _trial_lines(results)
    bars = [
        share_bar(kind, name, row[name], row["failures"])
        for kind, row in summary["by_kind"].items() for name in ("cause first", "mended")
    ]  # fmt: skip
    bar_chart(folder / _CHART, "Injected failures", "share", bars)
    return Report(summary, [Table("Injected failures", _COLUMNS, rows)], lines, pictures=[_CHART])


def _trial_lines(results: Results) -> list[str]:
    """Say whether the change that held in a trial holds more often than the one before it."""
    gains = np.array([result["best_holds"] - result["first_holds"] for result in results])
    rng = np.random.default_rng(0)
    means = rng.choice(gains, (_RESAMPLED, len(gains))).mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    lines = []
    for verdict in ("held", "failed", "not_tried"):
        of = [result["first_holds"] for result in results if result["verdict"] == verdict]
        share = f", of which {np.mean(of):.2f} hold in truth" if of else ""
        lines.append(f"first change {verdict.replace('_', ' ')} in the trial: {len(of)}{share}")
    claims = [result for result in results if result["mends"]]
    wrong = sum(1 - result["first_holds"] for result in claims)
    claimed = [result for result in claims if result["verdict"] != "failed"]
    wrong_tried = sum(1 - result["best_holds"] for result in claimed)
    times = [result["tried_s"] for result in results]
    return [
        *lines,
        f"another change held first: {sum(result['is_other'] for result in results)}",
        f"holds in truth, untried: {np.mean([r['first_holds'] for r in results]):.3f}, tried: "
        f"{np.mean([r['best_holds'] for r in results]):.3f}, gain {gains.mean():.3f} "
        f"({low:.3f} to {high:.3f})",
        f"said to mend, and does not: untried {wrong:.1f} of {len(claims)}, tried "
        f"{wrong_tried:.1f} of {len(claimed)}",
        f"processor time of a trial: mean {np.mean(times):.2f} s, longest {max(times):.2f} s",
    ]


def summary_of(results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of a study."""
    number = len(results)
    counts = {
        "right": sum(result["is_right"] for result in results),
        "held": sum(result["holds"] for result in results),
        "again": sum(result["again_holds"] for result in results),
    }
    said = [result for result in results if result["mends"]]
    times = [result["asked_s"] for result in results]
    kinds = dict.fromkeys(result["kind"] for result in results)
    return {
        "failures": number, **counts,
        "said": len(said), "said_held": sum(result["holds"] for result in said),
        **{f"{name}_95": list(wilson(count, number)) for name, count in counts.items()},
        "asked_s": sum(times) / max(number, 1), "longest_s": max(times, default=0.0),
        "by_kind": {kind: _row([r for r in results if r["kind"] == kind]) for kind in kinds},
        "trials": [dict(result) for result in results],
    }  # fmt: skip


def _row(results: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    return {
        "failures": len(results), "cause first": sum(r["is_right"] for r in results),
        "among three": sum(r["is_among_three"] for r in results),
        "mended": sum(r["holds"] for r in results),
        "said to mend": sum(r["mends"] for r in results),
        "of these mended": sum(r["mends"] and r["holds"] for r in results),
        "by the same again": sum(r["again_holds"] for r in results),
    }  # fmt: skip
