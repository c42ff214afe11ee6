"""The commands ``rtask demo`` and ``rtask simulate``."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import click
from click.core import ParameterSource

from rtask.errors import MissingExtraError, RobotError, UsageError
from rtask.extras import missing_libraries, needs_extra
from simulate import options
from simulate.act.commands import act_serve, act_test
from simulate.agent.decisions import Thresholds
from simulate.fleet.commands import fetch
from simulate.ros.commands import ros, ros2, ros_reach
from simulate.tasks.arms.command import crew
from simulate.tasks.commands import tasks
from simulate.tasks.why import why

__all__ = ["demo", "simulate"]


def _interrupt(signum: int, frame: FrameType | None) -> None:
    """Stop as on Ctrl-C, also on SIGTERM and if the shell ignores SIGINT."""
    raise KeyboardInterrupt


@click.command()
@options.seed()
@options.objects_of_demo()
@options.robots_of_demo()
@click.option(
    "--robot",
    "kinds",
    multiple=True,
    help="Kinds of the robots, in turn (nao, panda); repeatable.  [default: as the products need]",
)
@options.products(default="fragile")
@click.option(
    "--data",
    "-d",
    type=options.folder(),
    help="Folder for the store, the report and the logs.  "
    "[default: rtask-demo; with --recorded rtask-recorded]",
)
@click.option("--recorded", is_flag=True, help="Show a recorded run at once; needs no extra.")
@click.option(
    "--record",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also pack store and report into this file (.tar.xz), with small pictures.",
)
@click.option(
    "--films",
    is_flag=True,
    help="Also film each attempt with two cameras, for data sets of LeRobot.",
)
@click.option("--keep", is_flag=True, help="Continue with the store of an earlier run.")
@click.option("--gui", is_flag=True, help="Show the simulation in a window.")
@click.option("--stay", is_flag=True, help="Keep the endpoint running afterwards, until Ctrl-C.")
@click.option(
    "--attempts", default=6, show_default=True, help="Attempts per object; with --proof 3."
)
@click.option(
    "--min-grasp",
    default=Thresholds.grasp,
    show_default=True,
    type=click.FloatRange(0, 1),
    help="Least confidence in a grasp; below it an object is refused, and the graph says why.",
)
@click.option(
    "--cautious",
    is_flag=True,
    help="Compare --min-grasp with the lower end of the interval90 of a grasp, not with its mean.",
)
@click.option("--port", "-p", default=0, show_default=True, help="Port of the endpoint; 0 = free.")
@click.option("--details", is_flag=True, help="Also print tables of what each robot did.")
@click.option("--queries", is_flag=True, help="Also print SPARQL queries and their live answers.")
@click.option(
    "--proof",
    is_flag=True,
    help="One carton, three robots: alone, with the graph, with lessons of another product; then "
    "the teacher is withdrawn, and comes back.",
)
@click.option(
    "--weak",
    type=click.Choice(["left", "right"]),
    help="With --proof: end of the carton that breaks.  [default: asked on a terminal, else left]",
)
@click.option(
    "--page",
    is_flag=True,
    help="With --proof: pick that end in a browser, and watch there, until Ctrl-C.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")
def demo(
    seed: int,
    objects: int | None,
    robots: int | None,
    kinds: tuple[str, ...],
    products: str,
    data: Path | None,
    recorded: bool,
    record: Path | None,
    films: bool,
    keep: bool,
    gui: bool,
    stay: bool,
    attempts: int,
    min_grasp: float,
    cautious: bool,
    port: int,
    details: bool,
    queries: bool,
    proof: bool,
    weak: Literal["left", "right"] | None,
    page: bool,
    as_json: bool,
) -> None:
    """Watch a robot learn to grasp, and other robots benefit from it.

    Starts an endpoint on an embedded store and simulated robots that share it. The first encounters
    unknown objects; the next ones find them in the graph. Ends with a sentence that says what
    sharing gained in this run, and a report with pictures; --details and --queries print tables and
    SPARQL queries on the live store as well. --recorded shows pages, report and pictures of an
    earlier run in seconds.

    --proof takes --weak, --page, --seed, --robot, --attempts, --data, --port, --stay and --json,
    and no other options.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    _check_proof(proof)
    if recorded:
        from simulate.demo.recorded import show

        show(data or Path("rtask-recorded"), port, as_json)
        return
    if missing_libraries("simulate"):
        needed = needs_extra("simulate", "rtask demo")
        raise MissingExtraError(
            f"{needed}; `rtask demo --recorded` shows a recorded run without it", extra="simulate"
        )
    if proof:
        source = click.get_current_context().get_parameter_source("attempts")
        given = attempts if source is ParameterSource.COMMANDLINE else None
        _prove(weak, page, seed, kinds, given, data, port, stay, as_json)
        return
    from simulate.demo.console import Console
    from simulate.demo.orchestrate import Demo, Settings, objects_on_table, robots_in_all

    if gui and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RobotError("--gui needs a display and there is none; leave it out to run headless")
    data = data or Path("rtask-demo")
    settings = Settings(
        data, seed, objects_on_table(products, objects), robots_in_all(products, kinds, robots),
        attempts, keep, gui, port,
        kinds=kinds, products=products, min_grasp=min_grasp, cautious=cautious, details=details,
        queries=queries, small_pictures=record is not None, films=films,
    )  # fmt: skip
    result = Demo(settings, Console(results=not as_json)).run(stay)
    if record is not None:
        from simulate.demo.recorded import pack

        pack(data, record)
    if as_json:
        click.echo(json.dumps(result))


_OF_PROOF = frozenset(
    {"proof", "weak", "page", "seed", "kinds", "attempts", "data", "port", "stay", "as_json"}
)


def _check_proof(proof: bool) -> None:
    """Refuse options that do not concern a proof, and --weak without one."""
    context = click.get_current_context()
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        if proof and name not in _OF_PROOF:
            raise UsageError(f"{parameter.opts[0]} does not concern --proof")
        if not proof and name in ("weak", "page"):
            raise UsageError(f"--{name} is for --proof")


def _prove(
    weak: Literal["left", "right"] | None,
    page: bool,
    seed: int,
    kinds: tuple[str, ...],
    attempts: int | None,
    data: Path | None,
    port: int,
    stay: bool,
    as_json: bool,
) -> None:
    """Run ``rtask demo --proof``."""
    from simulate.demo.console import Console
    from simulate.demo.proof import Proof, ProofSettings
    from simulate.demo.proof_stage import Stage, StageConsole

    if len(kinds) > 1:
        raise UsageError("--proof takes one --robot: the three differ in what they know alone")
    folder = data or Path("rtask-proof")
    settings = ProofSettings(
        folder, weak or "left", seed, kinds[0] if kinds else "nao",
        attempts or ProofSettings.max_attempts, port,
    )  # fmt: skip
    console, stage = Console(results=not as_json), None
    if page:
        stage = Stage(folder / "report")
        console = StageConsole(stage, results=not as_json)
        click.echo(f"pick the end, and watch, at {stage.url}", err=True)
        settings = replace(settings, weak=weak or stage.wait() or "left")
        stage.pick(settings.weak)
    elif weak is None and sys.stdin.isatty():
        ends = click.Choice(["left", "right"])
        picked = click.prompt("Which end of the carton is to be weak", type=ends, err=True)
        settings = replace(settings, weak="right" if picked == "right" else "left")
    result = Proof(settings, console).run(stay and stage is None)
    if as_json:
        click.echo(json.dumps(result))
    if stage is not None:
        stage.finish()
        console.step(f"{stage.url} stays until Ctrl-C")
        threading.Event().wait()


@click.group(invoke_without_command=True)
@click.option("--robots", type=int, help="Run a fleet of this size, with the options below.")
@options.objects_per_robot
@options.objects_on_table
@options.seed()
@click.option(
    "--sharing",
    type=click.Choice(["on", "off", "both"]),
    default="on",
    show_default=True,
    help="One endpoint for all robots, one for each, or both in turn.",
)
@options.prior(default=True)
@click.option(
    "--in-line/--at-once",
    default=True,
    help="Whether each robot waits, table by table, for the one before it.",
)
@options.preset
@options.robots_in_turn
@click.option(
    "--data",
    "-d",
    default="rtask-fleet",
    show_default=True,
    type=options.folder(),
    help="Folder for stores, logs and the report.",
)
@options.json_flag()
@click.pass_context
def simulate(context: click.Context, /, robots: int | None, **options: Any) -> None:
    """Run a fleet of simulated robots (--robots), or one of the commands."""
    if context.invoked_subcommand is not None:
        return
    if robots is None:
        click.echo(context.get_help())
        return
    from simulate.fleet.commands import run_fleet

    run_fleet(robots, **options)


simulate.add_command(fetch)
simulate.add_command(act_test)
simulate.add_command(act_serve)
simulate.add_command(ros)
simulate.add_command(ros2)
simulate.add_command(tasks)
simulate.add_command(crew)
simulate.add_command(why)
simulate.add_command(ros_reach)


@simulate.command()
@click.argument("robot")
@click.option(
    "--legs",
    type=click.Choice(["fixed", "joints"]),
    help="Whether the legs, if any, are fixed or have joints.",
)
def urdf(robot: str, legs: Literal["fixed", "joints"] | None) -> None:
    """Print the URDF of a robot."""
    from simulate.robots import describe, urdf_text

    click.echo(urdf_text(describe(robot, **({"legs": legs} if legs else {}))))


@simulate.command()
@click.argument("out", type=click.Path(path_type=Path, dir_okay=False))
@options.robots_in_turn
@options.seed()
@click.option(
    "--objects",
    default=4,
    show_default=True,
    type=click.IntRange(min=1),
    help="Objects on each table.",
)
@click.option(
    "--recorded",
    is_flag=True,
    help="Show the pictures of the recorded demo: one robot fails, the next one holds.",
)
@options.json_flag("path")
def film(
    out: Path, kinds: tuple[str, ...], seed: int, objects: int, recorded: bool, as_json: bool
) -> None:
    """Film robots side by side, each grasping an object, to OUT (.webp, .png or .gif).

    A robot takes about a minute. --recorded takes seconds and shows what sharing is worth; the
    other options do not apply to it.
    """
    from simulate.robots import check_robot
    from simulate.study.film.robots import Film, film_robot, write_film
    from simulate.world.animation import check_film
    from simulate.world.quiet import banner_on_stderr

    check_film(out)
    if recorded:
        from simulate.study.film.sharing import write_recorded

        write_recorded(out)
        click.echo(json.dumps({"path": str(out)}) if as_json else str(out))
        return
    for kind in kinds:
        check_robot(kind)
    settings = Film(objects=objects, seed=seed)
    frames = []
    for kind in kinds:
        click.echo(f"filming {kind}", err=True)
        with banner_on_stderr():
            frames.append(film_robot(kind, settings))
    write_film(out, frames, settings)
    click.echo(json.dumps({"path": str(out)}) if as_json else str(out))
