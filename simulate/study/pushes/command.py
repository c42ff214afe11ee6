"""The command ``rtask study push-grasps``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from simulate import options

__all__ = ["push_grasps"]


@click.command("push-grasps")
@options.trials(5, "Trials of each grasp with the part itself.")
@click.option("--prints", default=40, show_default=True, type=click.IntRange(0, 10_000),
              help="Printed parts for each grasp: perturbed copies, an exact hand.")  # fmt: skip
@options.seed("plan, errors of the hand and printed parts")
@options.runs_trials("rtask-push-grasps")
def push_grasps(
    trials: int,
    prints: int,
    seed: int,
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Carry out three push grasps of Object M with a Panda, as in Kehoe 2014, 3.7.

    The robot images a plug on its table, plans on the contour, and carries out the best grasp and
    two of lower quality: a jaw pushes until the part is flat, the hand closes and lifts. The part
    itself is grasped with an inexact hand, printed copies of it with an exact one.
    """
    from simulate.study.commands import print_table
    from simulate.study.pushes.picture import draw_pushes
    from simulate.study.pushes.report import (
        COLUMNS,
        push_rows,
        push_study,
        summarise_pushes,
        write_push_report,
    )
    from simulate.study.runner import run

    if trials < 1:
        raise click.BadParameter(f"at least 1, got {trials}", param_hint="--trials")
    results = run(push_study(trials, prints, seed, preset), out, workers, resume)
    summary = summarise_pushes(results, seed, preset)
    summary = write_push_report(out, summary, results, seed)
    draw_pushes(out / "grasps.png", seed, preset)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Push grasps of Object M, carried out", COLUMNS, push_rows(summary))
    click.echo(f"report and picture  {out}")
