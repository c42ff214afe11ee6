"""Commands of ``rtask simulate`` for several robots, and for requests to one."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, TextIO

import click

from simulate import options
from simulate.study.command import print_table, study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["fetch", "requests", "run_fleet"]


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
@click.option(
    "--server",
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


@study_command("rtask-requests")
@options.trials(50, "Number of requests; the classes take turns.")
@click.option(
    "--objects",
    default=5,
    show_default=True,
    type=click.IntRange(min=5),
    help="Objects on each table; at least one of each class.",
)
@click.option(
    "--kind",
    "kinds",
    multiple=True,
    type=click.Choice(["ball", "bottle", "box", "can", "pen"]),
    help="Ask for this class only; may be repeated.",
)
@options.seed()
@options.robot
def requests(
    trials: int, objects: int, kinds: tuple[str, ...], seed: int, robot: str, preset: str
) -> Study:
    """Measure how often a robot brings what it is asked for, by class of object.

    Each request is one of `rtask simulate fetch` at a table of its own; whether the right product
    arrived is the simulator's truth, beside what the robot says.
    """
    from simulate.fleet.requests import request_study

    return request_study(trials, objects, seed, robot, preset, kinds)
