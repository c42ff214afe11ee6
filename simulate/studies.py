"""The group ``rtask study``: measurements on simulated robots."""

from __future__ import annotations

import json
from itertools import chain
from pathlib import Path

import click

from rtask.errors import RobotError
from simulate.fleet.commands import requests
from simulate.fleet.study_commands import attempts, demo, sharing, trust, unforeseen
from simulate.study.asking.command import asking_price
from simulate.study.clutter.command import piles
from simulate.study.commands import grasping, judging, learn, table4, table5
from simulate.study.day.command import day
from simulate.study.paths.command import paths
from simulate.study.pushes.command import push_grasps
from simulate.study.quality.command import grasp_quality
from simulate.study.quality.hands_command import hands
from simulate.study.tasks.command import tasks
from simulate.study.why.command import why

__all__ = ["study"]


@click.group()
def study() -> None:
    """Measure grasping, sharing, learning and the tables of the theses on simulated robots.

    Each study prints a table and writes a report; with the same seed it gives the same figures.
    """


for _command in (
    asking_price, attempts, day, demo, grasp_quality, grasping, hands, judging, learn, paths, piles,
    push_grasps, requests, sharing, table4, table5, tasks, trust, unforeseen, why,
):  # fmt: skip
    study.add_command(_command)


@study.command("grasp-views")
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--gripper", default="panda", show_default=True, help="nao, panda, or jaw:STROKE.")
@click.option("--shapes", default=30, show_default=True, help="Shapes per family (of seven).")
@click.option(
    "--parts", default=0, show_default=True, help="Machined parts of ten further families, in all."
)
@click.option("--seed", default=0, show_default=True, help="Number of the first shape.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def grasp_views(out: Path, gripper: str, shapes: int, parts: int, seed: int, as_json: bool) -> None:
    """Write labelled grasp candidates from simulated single views to OUT (.npz).

    The input of `rtask grasp train`. A view takes about a tenth of a second.
    """
    from grasp.spatial.gripper_files import gripper_named
    from simulate.study import grasp_samples

    try:
        hand = gripper_named(gripper)
    except ValueError as error:
        raise RobotError(str(error)) from error
    meshes = chain(grasp_samples.shapes(shapes, seed), grasp_samples.machined(parts, hand))
    samples = grasp_samples.collect_samples(meshes, hand)
    samples.save(out)
    right = int(samples.right.sum())
    if as_json:
        about = {"path": str(out), "gripper": samples.gripper}
        click.echo(json.dumps({**about, "candidates": len(samples), "right": right}))
        return
    click.echo(f"{len(samples)} candidates for {samples.gripper}, {right} right: {out}")
