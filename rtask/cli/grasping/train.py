"""``rtask grasp train``: learn which candidates on a single view hold."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.errors import UsageError

__all__ = ["train"]


@click.command()
@click.argument("views", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The model: numbers and text, no code.",
)
@click.option(
    "--model",
    "kind",
    type=click.Choice(["boosting", "svm"]),
    default="boosting",
    show_default=True,
    help="Boosting over 15 statistics, or a linear machine over gradients of a picture.",
)
@click.option("--seed", default=0, show_default=True, help="Of the split and the training.")
def train(views: Path, out: Path, kind: str, seed: int) -> None:
    """Train a filter of grasp candidates on VIEWS, a file of `rtask simulate grasp-views`.

    The model gives the probability that a candidate found on one view holds the whole object,
    calibrated on a quarter of the objects that it did not learn from. Takes the extra
    `classifier`.
    """
    from grasp.spatial.hand_search.classifier import GraspSamples
    from grasp.spatial.hand_search.classifier import train as train_on

    try:
        model = train_on(GraspSamples.load(views), "svm" if kind == "svm" else "boosting", seed)
    except (ValueError, ImportError) as error:
        raise UsageError(str(error)) from error
    model.save(out)
    about = model.about
    click.echo(
        f"{kind} for {model.gripper}, {about['samples']} candidates on {about['objects']} objects: "
        f"{out}"
    )
