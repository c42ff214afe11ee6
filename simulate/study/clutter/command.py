"""The command ``rtask study piles``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from simulate import options
from simulate.study.command import study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["piles"]


@study_command("rtask-piles")
@options.trials(50, "Number of piles or tables.")
@click.option("--objects", default=None, type=click.IntRange(1, 20),
              help="Things in each; 6 in a pile, 10 on a table to clear.")  # fmt: skip
@click.option("--clear", is_flag=True, help="Clear the table instead of picking once.")
@click.option("--with-agent", "agent", is_flag=True,
              help="Clear by the robot's agent, which asks a graph that starts empty.")  # fmt: skip
@click.option("--pushes/--no-pushes", default=True,
              help="Whether what cannot be picked is pushed, for comparison.")  # fmt: skip
@click.option("--robot", default="", metavar="KIND",
              help="Robot whose arms take no full poses, such as nao, instead of the Panda; it "
              "clears tables by its agent.")  # fmt: skip
@click.option("--hand", default="", metavar="suction:RADIUS|three:OPENING|FILE",
              help="Hand of the Panda instead of its jaws, m; the piles are the same.")  # fmt: skip
@click.option("--pictures", is_flag=True, help="Draw each pile with its best grasps (PNG).")
@options.seed("things, piles, light, noise and choices")
def piles(
    trials: int,
    objects: int | None,
    clear: bool,
    agent: bool,
    pushes: bool,
    robot: str,
    hand: str,
    pictures: bool,
    seed: int,
    preset: str,
) -> Study:
    """Measure how a robot picks from piles of things that touch and lie on each other.

    Generated things are dropped and pushed together; the robot sees them through its noisy camera,
    plans on one cloud and grasps in full poses. With --clear it goes on until the table is empty,
    pushing what it cannot grasp; what arrives in a box is taken away. With --with-agent the robot's
    agent clears the table, as in the demo: it recognises, grasps, pushes and reports. A robot whose
    arms take no full poses, such as a Nao, clears plain products that touch, half before each hand.
    """
    if pictures and hand:
        raise click.UsageError("--pictures draws jaws: leave out --hand")
    if agent and not clear:
        raise click.UsageError("--with-agent clears tables: give --clear as well")
    if robot:
        _check_robot(robot, agent, hand)
    if not (pushes or clear):
        raise click.UsageError("--no-pushes is about clearing tables: give --clear as well")
    if hand:
        from simulate.robots import describe

        describe("panda", hand=hand)  # raises before a folder is made
    from simulate.study.clutter.report import clear_study, pile_study

    if clear:
        return clear_study(trials, objects or 10, seed, preset, agent, pushes, hand, robot)
    folder = click.get_current_context().params["out"]
    drawn = str(folder / "piles") if pictures else ""
    return pile_study(trials, objects or 6, seed, preset, drawn, hand)


def _check_robot(robot: str, by_agent: bool, hand: str) -> None:
    """Raise if a robot cannot take the place of the Panda."""
    from simulate.grasping.table_reach import takes_full_poses
    from simulate.robots import describe

    if takes_full_poses(describe(robot)):
        raise click.UsageError("--robot takes those whose arms take no full poses, such as nao")
    if not by_agent:
        raise click.UsageError(f"{robot} clears tables by its agent: give --clear --with-agent")
    if hand:
        raise click.UsageError("--hand is of the Panda: leave out --robot")
