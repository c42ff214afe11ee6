"""Commands of ``rtask simulate`` for several robots, and for requests to one."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Literal, TextIO

import click

from rtask.cli.options import option
from simulate.study.commands import print_table

__all__ = ["fetch", "run_fleet", "sharing"]

_FOLDER = click.Path(path_type=Path, file_okay=False)
_PRESETS = click.Choice(["faithful", "fast"])


def _interrupt(signum: int, frame: FrameType | None) -> None:
    """Stop as on Ctrl-C, for SIGTERM too."""
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
    told = FleetConsole()
    runs = []
    for on in {"on": [True], "off": [False], "both": [True, False]}[sharing]:
        name = "shared" if on else "not shared"
        settings = FleetSettings(
            data / name.replace(" ", "-"), robots, objects, on_table, seed, on, prior, in_line,
            preset=preset, kinds=tuple(kinds),
        )  # fmt: skip
        fleet = Fleet(settings, told)
        told.say(f"{robots} robots, {objects} objects each, experience {name}")
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
        _say_change("last robot less first", figures["last_less_first"])
    if sharing == "both":
        words = "shared less not shared, all robots but the first"
        _say_change(words, result["shared_less_not_shared"])
    click.echo(f"report  {data / 'report.json'}, {data / 'attempts.png'}")
    return result


def _say_change(words: str, change: Mapping[str, Any] | None) -> None:
    if change is not None and change["attempts"] is not None:
        low, high = change["interval95"]
        click.echo(
            f"attempts, {words}, over {change['products']} meetings with common products: "
            f"{change['attempts']:+.2f} [{low:+.2f}, {high:+.2f}]"
        )


@click.command()
@click.option("--fleets", default=5, show_default=True, help="Each on products of its own.")
@click.option("--robots", default=3, show_default=True, help="Of each fleet.")
@click.option("--objects", default=20, show_default=True, help="That each robot meets.")
@click.option("--table", "on_table", default=4, show_default=True, help="Of them at once.")
@click.option("--seed", default=0, show_default=True, help="Fixes products, tables and choices.")
@click.option("--prior/--no-prior", default=False, help="Whether geometry proposes grasps.")
@option(
    "--workers",
    former=["--processes"],
    default=2,
    show_default=True,
    help="Processes; changes only the time.",
)
@click.option(
    "--preset",
    default="faithful",
    show_default=True,
    type=_PRESETS,
    help="Physics and camera: as close to the real robot as possible, or fast.",
)
@click.option("--out", default="rtask-sharing", show_default=True, type=_FOLDER)
@click.option("--resume", is_flag=True, help="Go on with what is in the folder.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def sharing(
    fleets: int,
    robots: int,
    objects: int,
    on_table: int,
    seed: int,
    prior: bool,
    workers: int,
    preset: str,
    out: Path,
    resume: bool,
    as_json: bool,
) -> None:
    """Measure the effect of sharing: fleets with one graph, and with one graph per robot.

    Half of what a robot meets is met by the robots before it, half is new to all.
    """
    from simulate.fleet.sharing import (
        COLUMNS,
        sharing_rows,
        sharing_study,
        show,
        write_sharing_report,
    )
    from simulate.study.runner import run

    study = sharing_study(fleets, robots, objects, on_table, seed, prior, preset)
    summary = write_sharing_report(out, run(study, out, workers, resume), study.settings)
    if as_json:
        click.echo(json.dumps(summary))
        return
    print_table("Attempts to first success", COLUMNS, sharing_rows(summary))
    for what, gain in summary["shared_less_not_shared"].items():
        for measure, value in gain.items():
            click.echo(
                f"shared less not shared, {what}, {measure.replace('_', ' ')}: "
                f"{show(value, '+.2f')}, {value['n']} meetings"
            )
    for condition, value in summary["last_less_first"].items():
        click.echo(f"last less first, {condition}: {show(value, '+.2f')}")
    click.echo(f"report  {out / 'report.json'}, {out / 'sharing.png'}")


@click.command()
@click.argument("wanted")
@click.option("--seed", default=0, show_default=True, help="Fixes products, tables and choices.")
@click.option("--objects", default=5, show_default=True, help="On the table.")
@click.option("--robot", default="nao", show_default=True, help="Which robot.")
@option(
    "--server",
    former=["--url"],
    metavar="URL",
    default="",
    envvar="RTASK_SERVER",
    show_envvar=True,
    help="Server to ask, with the token in RTASK_TOKEN.  [default: an engine in this process]",
)
@click.option("--data", type=_FOLDER, help="Knowledge base to use; default: an empty one.")
@click.option("--taught/--untaught", default=True, help="A person has named the products before.")
@click.option(
    "--preset",
    default="faithful",
    show_default=True,
    type=_PRESETS,
    help="Physics and camera: as close to the real robot as possible, or fast.",
)
@click.option("--json", "as_json", is_flag=True, help="Print what came of it as JSON.")
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

    It looks at its table, asks the graph which of what it sees serves, and brings that; or it
    says why it cannot, and the exit code is 1.
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
            _say_fetched(done, out)
    if not done["placed"]:
        raise SystemExit(1)


def _say_fetched(done: Mapping[str, Any], out: TextIO) -> None:
    click.echo(f"sees {len(done['seen'])} objects", out)
    if done["placed"]:
        click.echo(f"brought {done['label']}: {done['text']}", out)
        return
    click.echo(done["text"], out)
    for reason in done["answer"]["reasons"]:
        click.echo(f"  {reason['code']}: {reason['text']}", out)
