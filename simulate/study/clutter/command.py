"""The command ``rtask study piles``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from simulate import options

__all__ = ["piles"]


@click.command()
@options.trials(50, "Number of piles or tables.")
@click.option("--objects", default=None, type=click.IntRange(1, 20),
              help="Things in each; 6 in a pile, 10 on a table to clear.")  # fmt: skip
@click.option("--clear", is_flag=True, help="Clear the table instead of picking once.")
@click.option("--with-agent", "agent", is_flag=True,
              help="Clear by the robot's agent, which asks a graph that starts empty.")  # fmt: skip
@click.option("--pushes/--no-pushes", default=True,
              help="Whether what cannot be picked is pushed, for comparison.")  # fmt: skip
@click.option("--hand", default="", metavar="suction:RADIUS|three:OPENING|FILE",
              help="Hand of the Panda instead of its jaws, m; the piles are the same.")  # fmt: skip
@click.option("--pictures", is_flag=True, help="Draw each pile with its best grasps (PNG).")
@options.seed("things, piles, light, noise and choices")
@options.runs_trials("rtask-piles")
def piles(
    trials: int,
    objects: int | None,
    clear: bool,
    agent: bool,
    pushes: bool,
    hand: str,
    pictures: bool,
    seed: int,
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure how a Panda picks from piles of things that touch and lie on each other.

    Generated things are dropped and pushed together; the robot sees them through its noisy camera,
    plans on one cloud and grasps in full poses. With --clear it goes on until the table is empty,
    pushing what it cannot grasp; what arrives in a box is taken away. With --with-agent the robot's
    agent clears the table, as in the demo: it recognises, grasps, pushes and reports.
    """
    if pictures and hand:
        raise click.UsageError("--pictures draws jaws: leave out --hand")
    if agent and not clear:
        raise click.UsageError("--with-agent clears tables: give --clear as well")
    if not (pushes or clear):
        raise click.UsageError("--no-pushes is about clearing tables: give --clear as well")
    if hand:
        from simulate.robots import describe

        describe("panda", hand=hand)  # raises before a folder is made
    from simulate.study.clutter.report import (
        COLUMNS,
        clear_study,
        clutter_rows,
        pile_study,
        summarise_piles,
        summarise_tables,
        write_clutter_report,
    )
    from simulate.study.commands import print_table
    from simulate.study.runner import run

    study = (
        clear_study(trials, objects or 10, seed, preset, agent, pushes, hand)
        if clear
        else pile_study(
            trials, objects or 6, seed, preset, str(out / "piles") if pictures else "", hand
        )
    )
    results = run(study, out, workers, resume)
    summary = summarise_tables(results) if clear else summarise_piles(results)
    summary = write_clutter_report(out, summary, results, seed)
    if as_json:
        click.echo(json.dumps(summary))
        return
    title = "Cluttered tables cleared" if clear else "First picks from piles"
    print_table(title, COLUMNS, clutter_rows(summary))
    for name, part in summary.items():
        if name != "shares":
            click.echo(f"{name}: {json.dumps(part)}")
    click.echo(f"report  {out / 'report.json'}")
