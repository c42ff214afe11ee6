"""Commands of ``rtask study`` that measure grasping, learners and the thesis's tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from simulate import options
from simulate.study.command import study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["grasping", "judging", "learn", "table4", "table5"]


@study_command("rtask-grasping")
@options.trials(100, "Number of objects; kinds alternate.")
@options.seed("every trial")
@click.option("--attempts", default=3, show_default=True, help="Attempts per object.")
@options.robot
def grasping(trials: int, seed: int, attempts: int, robot: str, preset: str) -> Study:
    """Measure how often objects are held and placed, with perception in the loop."""
    from simulate.study.grasping_report import grasping_study

    return grasping_study(trials, seed, attempts, preset, robot)


@study_command("rtask-judging")
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
def judging(
    trials: int, seed: int, robot: str, products: str, difficult: float, preset: str
) -> Study:
    """Measure how often a robot's own judgement of its grasps agrees with ground truth.

    In difficult attempts, friction, mass and grasp errors vary widely, so that many of them fail.
    With any --products but plain ones, each trial fills a box with four products whose best grasp
    cannot be seen, each held anywhere along its length.
    """
    from simulate.study.judging import judging_study

    return judging_study(trials, seed, robot, preset, difficult, products)


@study_command("rtask-learning")
@click.option(
    "--objects", default=100, show_default=True, help="Number of objects; kinds alternate."
)
@options.seed("every object and choice")
@click.option(
    "--orders", default=20, show_default=True, help="Number of orders in which learners see them."
)
def learn(objects: int, seed: int, orders: int, preset: str) -> Study:
    """Compare learners on the simulated outcomes of many grasps of many objects."""
    from simulate.study.learning.report import outcome_study

    return outcome_study(objects, seed, preset=preset, orders=orders)


@study_command("rtask-table4", what="times", with_preset=False, processes=1)
@click.option("--objects", default=111, show_default=True, help="Objects in the store.")
@options.seed("products and views")
@click.option("--repeats", default=10, show_default=True, help="Repetitions of each query.")
def table4(objects: int, seed: int, repeats: int) -> Study:
    """Time the retrieval of objects, as in Table 4 of Gatto 2016.

    A server holds a view of each of 111 products, as many as the thesis's data set; four are then
    queried over the websocket with new views.
    """
    from simulate.study.tables import retrieval_study

    return retrieval_study(objects, seed, repeats)


@study_command("rtask-table5", what="times", processes=1)
@click.option("--repeats", default=3, show_default=True, help="Successful grasps per kind.")
@options.seed("products and places")
def table5(repeats: int, seed: int, preset: str) -> Study:
    """Time grasps from (X, Y, theta), as in Table 5 of Gatto 2016."""
    from simulate.study.tables import grasp_study

    return grasp_study(repeats, seed, preset)
