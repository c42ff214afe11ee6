"""The command ``rtask study grasp-quality``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

__all__ = ["grasp_quality"]


@click.command("grasp-quality")
@click.option("--objects", default=90, show_default=True, help="Of each hand, families in turn.")
@click.option("-n", "--trials", default=4, show_default=True, type=click.IntRange(min=1),
              help="Draws for each object.")  # fmt: skip
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0),
              help="Fixes every object and draw.")  # fmt: skip
@click.option(
    "--ycb",
    default=None,
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of YCB models; every second one takes part.",
)
@click.option(
    "--ranked",
    default=6,
    show_default=True,
    type=click.IntRange(min=0),
    help="Grasps of each plan, from the best to the worst, for rank correlations; 0 = none.",
)
@click.option("--alone", is_flag=True,
    help="Carry out the planned grasps only: promises and coverage, without a comparison.",
)  # fmt: skip
@click.option("--workers", default=2, show_default=True, help="Processes; changes only the time.")
@click.option(
    "--out",
    default="rtask-grasp-quality",
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
)
@click.option("--resume", is_flag=True, help="Go on with what is in the folder.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def grasp_quality(
    objects: int,
    trials: int,
    seed: int,
    ycb: Path | None,
    ranked: int,
    alone: bool,
    workers: int,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Compare planned grasps with a trivial sampler's: lifted and shaken under pose errors.

    A hand without an arm, the Panda's at 20 N and the NAO's at 2 N, carries out the first grasp of
    a plan, the first by s_G alone and the sampler's, all under the same draws of pose error,
    friction and centre of mass. Differences are paired by object. Further grasps of each plan tell
    how well its scores rank them.
    """
    from simulate.study.commands import print_table
    from simulate.study.quality.report import (
        COLUMNS,
        quality_rows,
        quality_study,
        write_quality_report,
    )
    from simulate.study.runner import run

    models = str(ycb.resolve()) if ycb else ""
    study = quality_study(objects, trials, seed, models, ranked=ranked, alone=alone)
    summary = write_quality_report(out, run(study, out, workers, resume), seed)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("First grasps by physics", COLUMNS, quality_rows(summary))
    for hand, found in summary["coverage"].items():
        if found["n"]:
            low, high = found["interval95"]
            click.echo(
                f"{hand}: a grasp on {found['hits']} of {found['n']} graspable objects, "
                f"{found['share']:.3f} [{low:.3f}, {high:.3f}]"
            )
    for name, row in summary["calibration"].items():
        if row["n"]:
            _print_promises(name, row)
    for name, row in summary["ranks"].items():
        if row["grasps"]:
            click.echo(
                f"{name}: rank correlation of score and share held over all "
                f"{row['grasps']} grasps {_correlation(row['over'])}, within objects "
                f"{_correlation(row['within'])}; were the chances the truth, "
                f"{_number(row['attainable']['over'])} and "
                f"{_number(row['attainable']['within'])}; {json.dumps(row['spread'])}"
            )
    click.echo(f"no grasp found: {json.dumps(summary['none'])}")
    click.echo(f"gate: {json.dumps(summary['gate'])}")
    click.echo(f"report  {out / 'report.json'}")


def _print_promises(name: str, row: Mapping[str, Any]) -> None:
    """Print what was promised of a hand's picks beside what held."""
    click.echo(
        f"{name}: score {row['promised']:.3f}, held {row['held']:.3f}; calibration error of the "
        f"score {row['error']:.3f}, of the promise {row['error_by_factory']:.3f}, after 50 own "
        f"outcomes {row.get('error_after_50', float('nan')):.3f}; n {row['n']}"
    )
    click.echo(
        f"  promised / held by quarters: {_quarters(row['quarters'])}; widest gap "
        f"{row['widest_gap']:.3f}, by a map of the score alone {row['former_widest_gap']:.3f}; "
        f"squared error less that map's {_signed(row['less_former'])}"
    )
    if "quarters_after_50" in row:
        click.echo(
            f"  after 50 own outcomes: {_quarters(row['quarters_after_50'])}; widest gap "
            f"{row['widest_gap_after_50']:.3f}"
        )
    click.echo(
        f"  at least what is promised at 90 %: {row['covered']:.3f} {row['covered_95']} of the "
        f"objects, with margins from halves of them "
        f"{row.get('covered_by_halves', float('nan')):.3f}, of which their number explains "
        f"{row.get('expected_by_halves', float('nan')):.3f}"
    )


def _quarters(quarters: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(f"{part['promised']:.2f} / {part['held']:.2f}" for part in quarters)


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
