"""The command ``rtask study grasp-quality``."""

from __future__ import annotations

import json
from collections.abc import Mapping
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
    study = quality_study(objects, trials, seed, models, ranked=ranked)
    summary = write_quality_report(out, run(study, out, workers, resume), seed)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("First grasps by physics", COLUMNS, quality_rows(summary))
    for name, row in summary["calibration"].items():
        if row["n"]:
            click.echo(
                f"{name}: score {row['promised']:.3f}, held {row['held']:.3f}; calibration "
                f"error of the score {row['error']:.3f}, by the factory's map "
                f"{row['error_by_factory']:.3f}, after 50 own outcomes "
                f"{row.get('error_after_50', float('nan')):.3f}; at least what is promised at "
                f"90 %: {row['covered']:.3f} {row['covered_95']} of the objects, with margins "
                f"from halves of them {row.get('covered_by_halves', float('nan')):.3f}, of which "
                f"their number explains {row.get('expected_by_halves', float('nan')):.3f}; "
                f"n {row['n']}"
            )
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


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _correlation(correlation: Mapping[str, Any]) -> str:
    """Return a correlation with its interval and the number of objects."""
    if correlation["mean"] is None:
        return "-"
    low, high = correlation["interval95"]
    return f"{correlation['mean']:.2f} [{low:.2f}, {high:.2f}] (n {correlation['n']})"
