"""``rtask learn``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import json_option, print_json


@click.group()
def learn() -> None:
    """Compare learners of grasping."""


@learn.command()
@click.option(
    "--seeds", default=20, show_default=True, type=click.IntRange(1), help="Lives of each learner."
)
@click.option("--objects", default=72, show_default=True, type=click.IntRange(4), help="In a life.")
@click.option(
    "--worlds",
    default=5,
    show_default=True,
    type=click.IntRange(1),
    help="Draws of objects; lives take them in turn.",
)
@click.option("--only", default="", metavar="TEXT", help="Learners whose names hold this.")
@click.option("--workers", default=2, show_default=True, type=click.IntRange(1), help="Processes.")
@click.option(
    "--save-plot",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the learning curves (SVG).",
)
@json_option
def benchmark(
    seeds: int, objects: int, worlds: int, only: str, workers: int, save_plot: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Grasp simulated objects with every learner.

    Attempts to the first success and first tries that held, over all objects, the first and last
    third of them, and families never met: the learners of Gatto 2016 on quadrants, candidates as
    arms, priors by geometry and from the graph. Numbers behind a slash were measured earlier on
    another draw of objects.
    """
    from grasp.learning.comparison import ROWS, compare
    from grasp.learning.report import curves_svg, table, text
    from grasp.learning.simulated import WorldSettings
    from rtask.errors import UsageError

    rows = [row for row in ROWS if only in f"{row.group} {row.name}"]
    if not rows:
        names = ", ".join(sorted({row.name for row in ROWS}))
        raise UsageError(f"no learner's name holds {only!r}; there are: {names}")
    results = compare(rows, seeds, worlds, WorldSettings(objects=objects), workers)
    if save_plot is not None:
        try:
            save_plot.write_text(curves_svg(results), "utf-8")
        except OSError as error:
            raise UsageError(f"{save_plot}: {error.strerror}") from error
    if as_json:
        print_json(table(results))
        return
    for line in text(results):
        click.echo(line)
    if save_plot is not None:
        click.echo(f"wrote {save_plot}")
