"""``rtask learn benchmark`` and ``rtask grasp train``: compare learners, train a classifier."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import json_option, print_json
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import UsageError

__all__ = ["learn", "train"]


@click.group()
def learn() -> None:
    """Compare algorithms that learn to grasp."""


@learn.command()
@click.option(
    "--seeds", default=20, show_default=True, type=click.IntRange(1), help="Runs of each learner."
)
@click.option(
    "--objects", default=72, show_default=True, type=click.IntRange(4), help="Objects in a run."
)
@click.option(
    "--worlds",
    default=5,
    show_default=True,
    type=click.IntRange(1),
    help="Sets of objects; runs take them in turn.",
)
@click.option("--only", default="", metavar="TEXT", help="Only learners whose names contain this.")
@click.option(
    "--workers",
    default=2,
    show_default=True,
    type=click.IntRange(1),
    help="Processes; changes only the time.",
)
@click.option(
    "--save-plot",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the learning curves to this file (SVG).",
)
@json_option
def benchmark(
    seeds: int, objects: int, worlds: int, only: str, workers: int, save_plot: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Let every learner grasp simulated objects.

    Compares the learners of Gatto 2016 on quadrants, bandits over grasp candidates, and priors from
    geometry and from the graph. For each it prints the attempts to the first success and the share
    of first attempts that held: over all objects, over the first and last third of them, and for
    families never met before. Numbers behind a slash were measured earlier on another set of
    objects.
    """
    from grasp.learning.comparison import ROWS, compare
    from grasp.learning.report import curves_svg, table, text
    from grasp.learning.simulated import WorldSettings

    rows = [row for row in ROWS if only in f"{row.group} {row.name}"]
    if not rows:
        names = ", ".join(sorted({row.name for row in ROWS}))
        raise UsageError(f"no learner's name contains {only!r}; there are: {names}")
    with announce_compilation(), Working(f"{len(rows)} learners, {seeds} runs each"):
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


@click.command()
@click.argument("views", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File for the model (numbers and text, no code).",
)
@click.option(
    "--model",
    "kind",
    type=click.Choice(["boosting", "svm"]),
    default="boosting",
    show_default=True,
    help="Boosting over 26 statistics, or a linear SVM over image gradients.",
)
@click.option(
    "--seed", default=0, show_default=True, help="Random seed of the split and the training."
)
@json_option
def train(views: Path, out: Path, kind: str, seed: int, as_json: bool) -> None:
    """Train a classifier of grasp candidates on VIEWS, a file of `rtask study grasp-views`.

    The model estimates the probability that a candidate found in a single view holds the whole
    object. It is calibrated on a quarter of the objects, which are kept out of the training. Needs
    the extra `classifier`.
    """
    from grasp.spatial.hand_search.classifier import GraspSamples
    from grasp.spatial.hand_search.classifier import train as train_on

    try:
        with Working("training"):
            model = train_on(GraspSamples.load(views), "svm" if kind == "svm" else "boosting", seed)
    except (ValueError, ImportError) as error:
        raise UsageError(str(error)) from error
    model.save(out)
    about = model.about
    if as_json:
        print_json({"path": str(out), "kind": kind, "gripper": model.gripper, **about})
        return
    click.echo(
        f"{kind} for {model.gripper}, {about['samples']} candidates on {about['objects']} objects: "
        f"{out}"
    )
