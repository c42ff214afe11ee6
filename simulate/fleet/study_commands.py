"""Commands of ``rtask study`` for studies of many fleets, with whole arms or replayed."""

from __future__ import annotations

import json
from pathlib import Path

import click
from click.core import ParameterSource

from rtask.errors import UsageError
from rtask.kb.durability.settings import write_durably
from simulate import options
from simulate.study.commands import print_table

__all__ = ["attempts", "demo", "sharing", "trust"]


@click.command()
@click.option("-n", "--count", default=60, show_default=True, help="Number of products.")
@options.products(default="hard")
@click.option("--gripper", default="panda", show_default=True, help="nao, panda, or jaw:STROKE.")
@click.option("--grasps", default=24, show_default=True, help="Grasps of each product.")
@click.option("--tries", default=3, show_default=True, help="Tries of each grasp.")
@options.seed("products and noise")
@options.workers
@options.resume
@options.out("rtask-attempts")
@options.json_flag("counts")
def attempts(
    count: int,
    products: str,
    gripper: str,
    grasps: int,
    tries: int,
    seed: int,
    workers: int,
    resume: bool,
    out: Path,
    as_json: bool,
) -> None:
    """Try many grasps of many products with a hand without an arm.

    The table of attempts in the output folder, attempts.json, is what `rtask study sharing
    --from-attempts` replays fleets from.
    """
    from simulate.study.attempt_table import attempt_study, write_attempts
    from simulate.study.runner import run

    study = attempt_study(count, products, gripper, grasps, tries, seed)
    results = run(study, out, workers, resume)
    write_attempts(out / "attempts.json", results, study.settings)
    made = sum(len(arm["held"]) for product in results for arm in product["arms"])
    held = sum(sum(arm["held"]) for product in results for arm in product["arms"])
    if as_json:
        counts = {"products": len(results), "attempts": made, "held": held}
        click.echo(json.dumps({**counts, "path": str(out / "attempts.json")}))
        return
    click.echo(f"{made} attempts at {len(results)} products, {held} held: {out / 'attempts.json'}")


@click.command()
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
@options.runs_trials("rtask-sharing")
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
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure the effect of sharing: fleets with one graph, and with one graph per robot.

    Half of each robot's objects are known to the robots before it; the other half are new to all.
    """
    from simulate.fleet.headroom import headroom_words
    from simulate.fleet.sharing import (
        COLUMNS,
        sharing_rows,
        sharing_study,
        show,
        write_sharing_report,
    )
    from simulate.study.runner import run

    if from_attempts is not None:
        _refuse_given(
            "robots", "objects", "prior", "products", "kinds", "look_alikes", "workers", "preset",
            "resume",
        )  # fmt: skip
        _replay(from_attempts, fleets, on_table, seed, out, as_json)
        return
    study = sharing_study(
        fleets, robots, objects, on_table, seed, prior, preset, products=products, kinds=kinds,
        look_alikes=look_alikes,
    )  # fmt: skip
    summary = write_sharing_report(out, run(study, out, workers, resume), study.settings)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Attempts to first success", COLUMNS, sharing_rows(summary))
    for what, gain in summary["shared_less_not_shared"].items():
        for measure, value in gain.items():
            click.echo(
                f"shared less not shared, {what}, {measure.replace('_', ' ')}: "
                f"{show(value, '+.2f')}, {value['n']} encounters"
            )
    for condition, value in summary["last_less_first"].items():
        click.echo(f"last less first, {condition}: {show(value, '+.2f')}")
    for condition, value in summary["headroom"].items():
        click.echo(f"headroom won by the last robot, {condition}: {headroom_words(value)}")
    click.echo(f"report  {out / 'report.json'}, {out / 'sharing.png'}")


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


def _replay(table: Path, fleets: int, on_table: int, seed: int, out: Path, as_json: bool) -> None:
    """Replay fleets from a table of attempts and print what sharing was worth."""
    from simulate.fleet.replay import COLUMNS, replay, replay_rows
    from simulate.fleet.sharing import MAX_ATTEMPTS
    from simulate.study.attempt_table import read_attempts

    summary = replay(read_attempts(table), fleets, on_table, MAX_ATTEMPTS, seed)
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "replay.json", json.dumps(summary, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table(
        f"{fleets} fleets of two robots, attempts to first success", COLUMNS, replay_rows(summary)
    )
    click.echo(
        f"the best grasp of each product holds {summary['oracle_first_try']:.2f} of the time"
    )
    for robot, effect in summary["causes"].items():
        low, high = effect["interval95"]
        click.echo(
            f"{robot.replace('_', ' ')} without reasoning about hidden causes: "
            f"{effect['without']:.2f} attempts; with it: {effect['with']:.2f}, "
            f"{effect['change']:+.2f} [{low:+.2f}, {high:+.2f}]"
        )
    click.echo(f"report  {out / 'replay.json'}")


@click.command()
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
@options.runs_trials("rtask-demos")
def demo(
    demos: int,
    robots: int | None,
    objects: int | None,
    max_attempts: int,
    seed: int,
    products: str,
    kinds: tuple[str, ...],
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure how often a demo shows what sharing is worth.

    Runs `rtask demo` on many seeds without its processes: the second robot and the last of each
    work with the graph and without.
    """
    from simulate.demo.orchestrate import objects_on_table, robots_in_all
    from simulate.fleet.demos import COLUMNS, demo_rows, demo_study, demo_words, write_demos
    from simulate.study.runner import run

    number = objects_on_table(products, objects)
    count = robots_in_all(products, kinds, robots)
    study = demo_study(demos, count, number, seed, products, kinds, max_attempts, preset)
    summary = write_demos(out, run(study, out, workers, resume), study.settings)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Robots with the graph and without", COLUMNS, demo_rows(summary))
    for line in demo_words(summary):
        click.echo(line)
    click.echo(f"report  {out / 'report.json'}")


@click.command()
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
@options.out("rtask-trust")
@options.json_flag("figures")
def trust(
    from_attempts: Path,
    fleets: int,
    robots: int,
    liars: int,
    lie: str,
    on_table: int,
    rounds: int,
    seed: int,
    out: Path,
    as_json: bool,
) -> None:
    """Measure what robots that report falsely cost the others, and how soon they are named."""
    from simulate.fleet.sharing import MAX_ATTEMPTS
    from simulate.fleet.trust import COLUMNS, replay_trust, trust_rows
    from simulate.study.attempt_table import read_attempts

    summary = replay_trust(
        read_attempts(from_attempts), fleets, robots, liars, on_table, rounds, MAX_ATTEMPTS, seed,
        lie,
    )  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    write_durably(out / "trust.json", json.dumps(summary, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table(
        f"{fleets} fleets of {robots} robots, {liars} of them liars", COLUMNS, trust_rows(summary)
    )
    more = summary["weighed_less_left_out"]
    click.echo(
        "weighing reports adds {:+.3f} [{:+.3f}, {:+.3f}] to leaving liars out".format(
            more["change"], *more["interval95"]
        )
    )
    click.echo(
        f"named: {summary['liars_named']} of {summary['of_liars']} liars, "
        f"{summary['liars_named_within_50']} within 50 of their reports; "
        f"{summary['truthful_named']} of {summary['of_truthful']} truthful robots by mistake, "
        f"{summary['truthful_named_for_a_while']} for a while"
    )
    click.echo(f"report  {out / 'trust.json'}")
