"""The command ``rtask study push-grasps``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from simulate import options
from simulate.study.command import study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["push_grasps"]


@study_command("rtask-push-grasps", "push-grasps")
@options.trials(5, "Trials of each grasp with the part itself.")
@click.option("--prints", default=40, show_default=True, type=click.IntRange(0, 10_000),
              help="Printed parts for each grasp: perturbed copies, an exact hand.")  # fmt: skip
@options.seed("plan, errors of the hand and printed parts")
def push_grasps(trials: int, prints: int, seed: int, preset: str) -> Study:
    """Carry out three push grasps of Object M with a Panda, as in Kehoe 2014, 3.7.

    The robot images a plug on its table, plans on the contour, and carries out the best grasp and
    two of lower quality: a jaw pushes until the part is flat, the hand closes and lifts. The part
    itself is grasped with an inexact hand, printed copies of it with an exact one.
    """
    from simulate.study.pushes.report import push_study

    if trials < 1:
        raise click.BadParameter(f"at least 1, got {trials}", param_hint="--trials")
    return push_study(trials, prints, seed, preset)
