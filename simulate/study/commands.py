"""Commands of ``rtask study`` that measure grasping, learners and the thesis's tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import click

from simulate import options

__all__ = ["grasping", "judging", "learn", "print_table", "table4", "table5"]


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of results."""
    from simulate.demo.console import Console

    Console().table(title, columns, rows)


@click.command()
@options.trials(100, "Number of objects; kinds alternate.")
@options.seed("every trial")
@click.option("--attempts", default=3, show_default=True, help="Attempts per object.")
@options.robot
@options.runs_trials("rtask-grasping")
def grasping(
    trials: int,
    seed: int,
    workers: int,
    attempts: int,
    robot: str,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure how often objects are held and placed, with perception in the loop."""
    from simulate.study.grasping_report import (
        COLUMNS,
        grasping_rows,
        grasping_study,
        write_grasping_report,
    )
    from simulate.study.runner import run

    results = run(grasping_study(trials, seed, attempts, preset, robot), out, workers, resume)
    summary = write_grasping_report(out, results, seed)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Grasping with perception in the loop", COLUMNS, grasping_rows(summary))
    for what in ("reasons_of_attempts", "reasons_of_objects_not_held", "reasons_not_placed"):
        click.echo(f"{what.replace('_', ' ')}: {json.dumps(summary[what])}")
    click.echo(f"report  {out / 'report.json'}, {out / 'held.png'}")


@click.command()
@options.trials(150, "Number of attempts, of which kinds alternate, or of boxes.")
@options.seed("every trial")
@options.robot
@options.products(default="plain")
@click.option(
    "--difficult",
    default=0.5,
    show_default=True,
    type=click.FloatRange(0, 1),
    help="Share of attempts with slippery or heavy objects and inexact grasps.",
)
@options.runs_trials("rtask-judging")
def judging(
    trials: int,
    seed: int,
    workers: int,
    robot: str,
    products: str,
    difficult: float,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure how often a robot's own judgement of its grasps agrees with ground truth.

    In difficult attempts, friction, mass and grasp errors vary widely, so that many of them fail.
    With --products hard, each trial fills a box with four products whose best grasp cannot be seen,
    each held anywhere along its length.
    """
    from simulate.study.judging import (
        COLUMNS,
        judging_rows,
        judging_study,
        write_judging_report,
    )
    from simulate.study.runner import run

    study = judging_study(trials, seed, robot, preset, difficult, products)
    results = run(study, out, workers, resume)
    summary = write_judging_report(out, results, seed)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Own judgement against ground truth", COLUMNS, judging_rows(robot, summary))
    click.echo(f"attempts that held nothing: {summary['not_held']['hits']}")
    click.echo(f"report  {out / 'report.json'}")


@click.command()
@click.option(
    "--objects", default=100, show_default=True, help="Number of objects; kinds alternate."
)
@options.seed("every object and choice")
@click.option(
    "--orders", default=20, show_default=True, help="Number of orders in which learners see them."
)
@options.runs_trials("rtask-learning")
def learn(
    objects: int,
    seed: int,
    workers: int,
    orders: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Compare learners on the simulated outcomes of many grasps of many objects."""
    from simulate.study.learning_report import (
        COLUMNS,
        learning_rows,
        outcome_study,
        write_learning_report,
    )
    from simulate.study.runner import run

    results = run(outcome_study(objects, seed, preset=preset), out, workers, resume)
    summary = write_learning_report(out, results, seed, orders)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Attempts to first success", COLUMNS, learning_rows(summary))
    click.echo(f"grasps that hold, over all choices: {json.dumps(summary['grasps'])}")
    click.echo(f"report and charts  {out}")


@click.command()
@click.option("--objects", default=111, show_default=True, help="Objects in the store.")
@options.seed("products and views")
@click.option("--repeats", default=10, show_default=True, help="Repetitions of each query.")
@options.json_flag("times")
def table4(objects: int, seed: int, repeats: int, as_json: bool) -> None:
    """Time the retrieval of objects, as in Table 4 of Gatto 2016.

    A server holds a view of each of 111 products, as many as the thesis's data set; four are then
    queried over the websocket with new views.
    """
    import os

    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out:
        os.dup2(2, 1)  # Bullet and Mesa write there
        from simulate.study.tables import table_4_times

        rows = table_4_times(objects, seed, repeats)
        _print_times(rows, as_json, out)


@click.command()
@click.option("--repeats", default=3, show_default=True, help="Successful grasps per kind.")
@options.seed("products and places")
@options.preset
@options.json_flag("times")
def table5(repeats: int, seed: int, preset: str, as_json: bool) -> None:
    """Time grasps from (X, Y, theta), as in Table 5 of Gatto 2016."""
    import os

    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out:
        os.dup2(2, 1)  # Bullet and Mesa write there
        from simulate.study.runner import Progress
        from simulate.study.tables import TABLE_5, grasp_times

        progress = Progress(repeats * len(TABLE_5), 0)
        _print_times(grasp_times(repeats, seed, preset, progress.step), as_json, out)


def _print_times(rows: Sequence[Mapping[str, Any]], as_json: bool, out: TextIO) -> None:
    if as_json:
        click.echo(json.dumps(list(rows)), out)
        return
    for number, row in enumerate(rows):
        if not number:
            click.echo("  ".join(f"{name:>12}" for name in row), out)
        cells = (f"{v:12.3f}" if isinstance(v, float) else f"{v!s:>12}" for v in row.values())
        click.echo("  ".join(cells), out)
