"""Commands of ``rtask study`` for studies of many fleets, with whole arms or replayed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from rtask.errors import UsageError
from simulate import options
from simulate.study.command import study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["attempts", "demo", "sharing", "trust", "unforeseen"]


@study_command("rtask-attempts", what="counts", with_preset=False)
@click.option("-n", "--count", default=60, show_default=True, help="Number of products.")
@options.products(default="hard")
@click.option("--gripper", default="panda", show_default=True, help="nao, panda, or jaw:STROKE.")
@click.option("--grasps", default=24, show_default=True, help="Grasps of each product.")
@click.option("--tries", default=3, show_default=True, help="Tries of each grasp.")
@options.seed("products and noise")
def attempts(count: int, products: str, gripper: str, grasps: int, tries: int, seed: int) -> Study:
    """Try many grasps of many products with a hand without an arm.

    The table of attempts in the output folder, attempts.json, is what `rtask study sharing
    --from-attempts` replays fleets from.
    """
    from simulate.study.attempt_table import attempt_study

    return attempt_study(count, products, gripper, grasps, tries, seed)


@study_command("rtask-sharing")
@click.option("--fleets", default=5, show_default=True, help="Fleets, each with its own products.")
@click.option("--robots", default=3, show_default=True, help="Robots per fleet.")
@options.objects_per_robot
@options.objects_on_table
@options.seed()
@options.prior(default=False)
@options.products(default="plain")
@options.robots_in_turn
@click.option(
    "--look-alikes",
    is_flag=True,
    help="As a control: the later robots meet products that only look like those of the first.",
)
@click.option(
    "--from-attempts",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Replay fleets of two robots from this table instead; see `rtask study attempts`.",
)
def sharing(
    fleets: int,
    robots: int,
    objects: int,
    on_table: int,
    seed: int,
    prior: bool,
    products: str,
    kinds: tuple[str, ...],
    look_alikes: bool,
    from_attempts: Path | None,
    preset: str,
) -> Study:
    """Measure the effect of sharing: fleets with one graph, and with one graph per robot.

    Half of each robot's objects are known to the robots before it; the other half are new to all.
    """
    from simulate.fleet.sharing import sharing_study

    if from_attempts is not None:
        _refuse_given(
            "robots", "objects", "prior", "products", "kinds", "look_alikes", "preset",
        )  # fmt: skip
        from simulate.fleet.replay import replay_study
        from simulate.fleet.sharing import MAX_ATTEMPTS

        return replay_study(from_attempts, fleets, on_table, MAX_ATTEMPTS, seed)
    return sharing_study(
        fleets, robots, objects, on_table, seed, prior, preset, products=products, kinds=kinds,
        look_alikes=look_alikes,
    )  # fmt: skip


def _refuse_given(*names: str) -> None:
    """Refuse options that do not concern a replay: the table has settled what they say."""
    context = click.get_current_context()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is ParameterSource.COMMANDLINE:
            raise UsageError(
                f"{parameter.opts[0]} does not concern fleets replayed with --from-attempts: they "
                "are of two robots, and the table says the rest"
            )


@study_command("rtask-unforeseen", with_preset=False)
@click.option("-n", "--count", default=10, show_default=True, help="Products of each family.")
@click.option("--fleets", default=20, show_default=True, help="Fleets, each with its own luck.")
@click.option("--gripper", default="panda", show_default=True, help="nao, panda, or jaw:STROKE.")
@options.seed("products and choices")
def unforeseen(count: int, fleets: int, gripper: str, seed: int) -> Study:
    """Measure memory and causes on products whose secret no cause explains.

    Families whose secret is a cause that the graph infers stand beside ones of which it is none.
    """
    from simulate.fleet.unforeseen import unforeseen_study

    return unforeseen_study(count, fleets, gripper, seed)


@study_command("rtask-demos")
@click.option("-n", "--demos", default=10, show_default=True, help="Demos, with consecutive seeds.")
@options.robots_of_demo()
@options.objects_of_demo()
@click.option("--attempts", "max_attempts", default=6, show_default=True, help="Per object.")
@options.seed("the first demo; the next has the next seed")
@options.products(default="fragile")
@click.option(
    "--robot",
    "kinds",
    multiple=True,
    help="Kinds of the robots, in turn (nao, panda); repeatable.  [default: as the products need]",
)
def demo(
    demos: int,
    robots: int | None,
    objects: int | None,
    max_attempts: int,
    seed: int,
    products: str,
    kinds: tuple[str, ...],
    preset: str,
) -> Study:
    """Measure how often a demo shows what sharing is worth.

    Runs `rtask demo` on many seeds without its processes: the second robot and the last of each
    work with the graph and without.
    """
    from simulate.demo.orchestrate import objects_on_table, robots_in_all
    from simulate.fleet.demos import demo_study

    number = objects_on_table(products, objects)
    count = robots_in_all(products, kinds, robots)
    return demo_study(demos, count, number, seed, products, kinds, max_attempts, preset)


@study_command("rtask-trust", with_preset=False)
@click.option(
    "--from-attempts",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Table of attempts to replay from; see `rtask study attempts`.",
)
@click.option("--fleets", default=20, show_default=True, help="Fleets, each with its own products.")
@click.option("--robots", default=10, show_default=True, help="Robots per fleet.")
@click.option("--liars", default=2, show_default=True, help="Robots that report falsely.")
@click.option(
    "--lie",
    default="flipped",
    show_default=True,
    type=click.Choice(["flipped", "held", "random"]),
    help="What they report: the opposite, that all held, or anything.",
)
@options.objects_on_table
@click.option("--rounds", default=3, show_default=True, help="Times each robot meets each object.")
@options.seed()
def trust(
    from_attempts: Path,
    fleets: int,
    robots: int,
    liars: int,
    lie: str,
    on_table: int,
    rounds: int,
    seed: int,
) -> Study:
    """Measure what robots that report falsely cost the others, and how soon they are named."""
    from simulate.fleet.sharing import MAX_ATTEMPTS
    from simulate.fleet.trust import trust_study

    return trust_study(
        from_attempts, fleets, robots, liars, on_table, rounds, MAX_ATTEMPTS, seed, lie
    )
