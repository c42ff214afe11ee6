"""Commands of ``rtask simulate`` for several robots, and for requests to one."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Literal, TextIO

import click
from click.core import ParameterSource

from rtask.cli.options import option
from rtask.errors import UsageError
from rtask.kb.durability.settings import write_durably
from simulate import options
from simulate.study.commands import print_table

__all__ = ["attempts", "fetch", "requests", "run_fleet", "sharing", "trust"]


def _interrupt(signum: int, frame: FrameType | None) -> None:
    """Stop on SIGTERM in the same way as on Ctrl-C."""
    raise KeyboardInterrupt


def run_fleet(
    robots: int,
    objects: int,
    on_table: int,
    seed: int,
    data: Path,
    sharing: Literal["on", "off", "both"],
    prior: bool,
    in_line: bool,
    preset: str,
    as_json: bool,
    kinds: Sequence[str] = ("nao",),
) -> dict[str, Any]:
    """Run a fleet with sharing on, off or both, print its figures and write its report."""
    from simulate.demo.console import FleetConsole
    from simulate.fleet.figures import (
        COLUMNS,
        fleet_figures,
        fleet_rows,
        sharing_gain,
        write_fleet_report,
    )
    from simulate.fleet.orchestrate import Fleet, FleetSettings

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    console = FleetConsole()
    runs = []
    for on in {"on": [True], "off": [False], "both": [True, False]}[sharing]:
        name = "shared" if on else "not shared"
        settings = FleetSettings(
            data / name.replace(" ", "-"), robots, objects, on_table, seed, on, prior, in_line,
            preset=preset, kinds=tuple(kinds),
        )  # fmt: skip
        fleet = Fleet(settings, console)
        console.say(f"{robots} robots, {objects} objects each, experience {name}")
        done = fleet.run()
        runs.append((name, done, fleet_figures(done, fleet.plan)))
    write_fleet_report(data, runs)
    result: dict[str, Any] = {name: figures for name, _, figures in runs}
    if sharing == "both":
        result["shared_less_not_shared"] = sharing_gain(runs[0][1], runs[1][1], fleet.plan)
    if as_json:
        click.echo(json.dumps(result))
        return result
    for name, _, figures in runs:
        print_table(f"Experience {name}", COLUMNS, fleet_rows(figures))
        _print_change("last robot less first", figures["last_less_first"])
    if sharing == "both":
        words = "shared less not shared, all robots but the first"
        _print_change(words, result["shared_less_not_shared"])
    click.echo(f"report  {data / 'report.json'}, {data / 'attempts.png'}")
    return result


def _print_change(words: str, change: Mapping[str, Any] | None) -> None:
    if change is not None and change["attempts"] is not None:
        low, high = change["interval95"]
        click.echo(
            f"attempts, {words}, over {change['products']} encounters with common products: "
            f"{change['attempts']:+.2f} [{low:+.2f}, {high:+.2f}]"
        )


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

    The table of attempts in the output folder, attempts.json, is what `rtask simulate sharing
    --from-attempts` replays fleets from.
    """
    from simulate.study.attempt_table import attempt_study, write_attempts
    from simulate.study.runner import run

    study = attempt_study(count, products, gripper, grasps, tries, seed)
    results = run(study, out, workers, resume)
    write_attempts(out / "attempts.json", results, study.settings)
    made = sum(len(arm["held"]) for thing in results for arm in thing["arms"])
    held = sum(sum(arm["held"]) for thing in results for arm in thing["arms"])
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
    "--from-attempts",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Replay fleets of two robots from this table instead; see `rtask simulate attempts`.",
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
            "robots", "objects", "prior", "products", "kinds", "workers", "preset", "resume"
        )
        _replay(from_attempts, fleets, on_table, seed, out, as_json)
        return
    study = sharing_study(
        fleets, robots, objects, on_table, seed, prior, preset, products=products, kinds=kinds
    )
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
    for robot, found in summary["causes"].items():
        low, high = found["interval95"]
        click.echo(
            f"{robot.replace('_', ' ')} without reasoning about hidden causes: "
            f"{found['without']:.2f} attempts; with it: {found['with']:.2f}, "
            f"{found['change']:+.2f} [{low:+.2f}, {high:+.2f}]"
        )
    click.echo(f"report  {out / 'replay.json'}")


@click.command()
@click.option(
    "--from-attempts",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    help="Table of attempts to replay from; see `rtask simulate attempts`.",
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


@click.command()
@click.argument("wanted")
@options.seed()
@click.option(
    "--objects",
    default=5,
    show_default=True,
    type=click.IntRange(min=1),
    help="Objects on the table.",
)
@options.robot
@option(
    "--server",
    former=["--url"],
    metavar="URL",
    default="",
    envvar="RTASK_SERVER",
    show_envvar=True,
    help="Server to ask, with the token in RTASK_TOKEN.  [default: an engine in this process]",
)
@click.option(
    "--data", "-d", type=options.folder(), help="Knowledge base to use; default: a new one."
)
@click.option(
    "--taught/--untaught", default=True, help="Whether a person has named the products before."
)
@options.preset
@options.json_flag("outcome")
def fetch(
    wanted: str,
    seed: int,
    objects: int,
    robot: str,
    server: str,
    data: Path | None,
    taught: bool,
    preset: str,
    as_json: bool,
) -> None:
    """Ask a robot for a kind of object, such as "something to drink from".

    The robot looks at its table, asks the graph which of the objects fits, and brings it. If it
    cannot, it says why and the exit code is 1.
    """
    import os

    from simulate.fleet.request import Request, carry_out

    request = Request(
        wanted, seed, objects, robot, server, os.environ.get("RTASK_TOKEN"), data, taught,
        preset=preset,
    )  # fmt: skip
    # Bullet and Mesa write to file descriptor 1; the answer gets a private copy of it.
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out:
        os.dup2(2, 1)
        done = carry_out(request)
        if as_json:
            click.echo(json.dumps(done), out)
        else:
            _print_fetched(done, out)
    if not done["placed"]:
        raise SystemExit(1)


def _print_fetched(done: Mapping[str, Any], out: TextIO) -> None:
    click.echo(f"sees {len(done['seen'])} objects", out)
    if done["placed"]:
        click.echo(f"brought {done['label']}: {done['text']}", out)
        return
    click.echo(done["text"], out)
    for reason in done["answer"]["reasons"]:
        click.echo(f"  {reason['code']}: {reason['text']}", out)


@click.command()
@options.trials(50, "Number of requests; the classes take turns.")
@click.option(
    "--objects",
    default=5,
    show_default=True,
    type=click.IntRange(min=5),
    help="Objects on each table; at least one of each class.",
)
@options.seed()
@options.robot
@options.runs_trials("rtask-requests")
def requests(
    trials: int,
    objects: int,
    seed: int,
    robot: str,
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure how often a robot brings what it is asked for, by class of object.

    Each request is one of `rtask simulate fetch` at a table of its own; whether the right product
    arrived is the simulator's truth, beside what the robot says.
    """
    from simulate.fleet.requests import (
        COLUMNS,
        request_rows,
        request_study,
        write_request_report,
    )
    from simulate.study.runner import run

    study = request_study(trials, objects, seed, robot, preset)
    summary = write_request_report(out, run(study, out, workers, resume), study.settings)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Requests by class", COLUMNS, request_rows(summary))
    for kind, one in summary["classes"].items():
        if one["failed"] and kind != "all":
            click.echo(f"{kind} failed: {json.dumps(one['failed'])}")
    click.echo(f"report  {out / 'report.json'}")
