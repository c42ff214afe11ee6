"""The commands ``rtask robot``: robots made from URDF files."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import (
    RowsAsTheyCome,
    announce_undo,
    json_option,
    listing_option,
    print_json,
    shown_rows,
)
from rtask.errors import UnknownRobotError, UsageError
from rtask.scratch import ScratchFolder
from simulate import options
from simulate.drivers.commands import reach

if TYPE_CHECKING:
    from simulate.onboarding.check import Finding
    from simulate.onboarding.guess import GuessedRobot, NoHandError

__all__ = ["robot"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")


@click.group()
def robot() -> None:
    """Make robots from URDF files, check them, and move the arms of real ones.

    A robot that was added is known by its name wherever a command takes --robot. Its settings are a
    TOML file in the folder RTASK_ROBOTS, by default ~/.local/share/rtask/robots.
    """


robot.add_command(reach)


@robot.command("list")
@listing_option
@json_option
def list_robots(limit: int | None, as_json: bool) -> None:
    """List the robots: built in, of installed packages, and added."""
    from simulate.robots import ROBOTS, known_robots
    from simulate.robots.robot_files import robot_names, robots_folder

    added = set(robot_names())
    rows = [
        {
            "name": name,
            "from": "built in"
            if name in ROBOTS
            else str(robots_folder() / f"{name}.toml")
            if name in added
            else "an installed package",
        }
        for name in known_robots()
    ]
    rows = shown_rows(rows, limit, as_json)
    if as_json:
        print_json(rows)
        return
    for row in rows:
        click.echo(f"{row['name']:20} {row['from']}")


@robot.command()
@click.argument("urdf", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--name", help="Name of the robot.  [default: the file's]")
@click.option(
    "--gripper",
    metavar="FILE|jaw:STROKE|suction:RADIUS|three:OPENING",
    help="Hang a gripper on the arm: a URDF file, plain jaws, a suction cup or three fingers of a "
    "size in m, or a file that describes one of the last two.",
)
@click.option(
    "--on", metavar="LINK", help="Link that carries the gripper.  [default: tool0, else the last]"
)
@click.option("--jaws", nargs=2, metavar="LINK LINK",
    help="Links that close on each other, where no hand is found: of a single moving jaw, the link "
    "that carries it is the other.",
)  # fmt: skip
@click.option("--srdf", type=click.Path(path_type=Path, dir_okay=False),
    help="SRDF of the robot: home posture and links that may touch are taken from it.",
)  # fmt: skip
@click.option("--strict", is_flag=True, help="Refuse a file with gaps instead of filling them.")
@click.option("--scale", type=float,
    help="Factor for shapes far larger than the robot: 0.001 if the file has them in mm.",
)  # fmt: skip
@click.option("--replace", is_flag=True, help="Replace a robot of the same name.")
@json_option
def add(
    urdf: Path,
    name: str | None,
    gripper: str | None,
    on: str | None,
    jaws: tuple[str, str] | None,
    srdf: Path | None,
    strict: bool,
    scale: float | None,
    replace: bool,
    as_json: bool,
) -> None:
    """Make a robot from a URDF file: find its arms, hands and cameras, and a table that suits it.

    What the file cannot mean as it is written is said at once, before any search.

    Everything that the file does not say is guessed, and marked so in the settings, which are there
    to be edited. If no hand is found, the command asks for the links of both jaws. Each hand is
    closed in simulation, on a box and on nothing: exit code 1 if it does not hold the box, though
    the settings are kept. `rtask robot check` tells whether the robot grasps.
    """
    from simulate.onboarding.check import check_closing
    from simulate.onboarding.guess import NoHandError, guess_robot
    from simulate.robots.robot_files import bare_robot, save_robot, set_aside
    from simulate.world.quiet import banner_on_stderr

    name = name or urdf.stem
    path = _settings_path(name, replace)
    if jaws is not None and gripper is not None:
        raise UsageError("--jaws names the robot's own links: it does not go with --gripper")
    guess = partial(
        guess_robot, urdf, name, gripper=gripper, on=on, srdf=srdf, strict=strict, scale=scale
    )
    _, warnings = bare_robot(urdf, name=name, strict=strict, gripper=gripper, on=on, scale=scale)
    # A search that finds no posture would blame the arm for what these say, were they printed last.
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)
    with banner_on_stderr():
        try:
            made = guess(jaws=jaws)
        except NoHandError as error:
            if gripper is not None or jaws is not None or as_json or not _can_ask():
                raise
            made = guess(jaws=_asked_jaws(error))
        closing = list(check_closing(made.robot))
    is_replaced = path.exists()
    if is_replaced:
        set_aside(path)
    save_robot(made.settings, made.guessed, path)
    if as_json:
        print_json(_as_json(name, path, made, closing))
    else:
        _print_added(name, path, made, closing)
        announce_undo("robot", "restore" if is_replaced else "remove", name)
    if not all(finding.passed for finding in closing):
        if not as_json:
            click.echo(
                "the hand does not hold a box: name other links with --jaws, or edit fingers, "
                "finger_closed and finger_open in the settings",
                err=True,
            )
        raise click.exceptions.Exit(1)


def _settings_path(name: str, replace: bool) -> Path:
    """Return where the settings of a new robot go, or refuse the name."""
    from simulate.robots import ROBOTS
    from simulate.robots.robot_files import robots_folder

    if not _NAME.fullmatch(name):
        raise UsageError(f"--name: {name!r}: expected letters, digits, - and _, a letter first")
    if name in ROBOTS:
        raise UsageError(f"--name: {name!r} is a built-in robot; choose another name")
    path = robots_folder() / f"{name}.toml"
    if path.exists() and not replace:
        raise UsageError(f"{path} exists; --replace replaces it, --name NAME keeps both")
    return path


def _as_json(
    name: str, path: Path, made: GuessedRobot, closing: Sequence[Finding]
) -> dict[str, Any]:
    arms = [
        {
            "name": arm.name,
            "joints": len(arm.joints),
            "hand": arm.wrist,
            "fingers": list(arm.fingers),
            "opening_m": arm.mouth,
        }
        for arm in made.robot.arms.values()
    ]
    return {
        "name": name,
        "settings": str(path),
        "arms": arms,
        "cameras": list(made.robot.cameras),
        "reach": round(made.share, 3),
        "closing": [finding.to_json() for finding in closing],
        "cannot": list(made.limits),
        "warnings": list(made.warnings),
    }


def _print_added(name: str, path: Path, made: GuessedRobot, closing: Sequence[Finding]) -> None:
    for arm in made.robot.arms.values():
        does = f"opens {1000 * arm.mouth:.0f} mm"
        if arm.cup is not None:
            does = f"sucks with {2000 * arm.cup.radius:.0f} mm"
        click.echo(f"{arm.name}: {len(arm.joints)} joints, hand on {arm.wrist}, {does}")
    for finding in closing:
        click.echo(f"{'ok  ' if finding.passed else 'FAIL'} {finding.name}: {finding.says}")
    for limit in made.limits:
        click.echo(f"cannot: {limit}")
    click.echo(f"reaches {made.share:.0%} of its table; settings: {path}")
    click.echo(f"next: rtask robot check {name}")


def _can_ask() -> bool:
    return sys.stdin.isatty()


def _asked_jaws(error: NoHandError) -> tuple[str, str]:
    """Return the links of both jaws, asked for on the terminal."""
    click.echo(f"{error}\nlinks: {', '.join(error.links)}", err=True)
    first = click.prompt("link of a jaw that moves", type=click.Choice(error.links), err=True,
        show_choices=False)  # fmt: skip
    second = click.prompt("link that it closes on", type=click.Choice(error.links), err=True,
        show_choices=False)  # fmt: skip
    return str(first), str(second)


@robot.command()
@click.argument("name")
@click.option("--grasps", default=10, show_default=True, help="Products to grasp; 0 = none.")
@options.seed("products, places and noise")
@options.preset
@options.workers()
@json_option
def check(name: str, grasps: int, seed: int, preset: str, workers: int, as_json: bool) -> None:
    """Check a robot: reach, home posture, closing hands, and grasps of products.

    Exit code 1 if it fails one. A grasp takes about five seconds.
    """
    from simulate.onboarding.check import check_grasps, check_robot_body
    from simulate.robots import describe
    from simulate.world.quiet import banner_on_stderr

    if grasps < 0:
        raise UsageError(f"--grasps must not be negative, got {grasps}")
    described = describe(name)
    rows: Sequence[Any] = []
    with banner_on_stderr():
        findings = list(check_robot_body(described, seed))
        if grasps:
            with ScratchFolder("robot") as folder:
                finding, rows = check_grasps(
                    name, grasps, folder, preset=preset, seed=seed, workers=workers
                )
            findings.append(finding)
    passed = all(finding.passed for finding in findings)
    if as_json:
        columns = ("product", "held", "placed", "reason")
        print_json(
            {
                "name": name,
                "passed": passed,
                "findings": [finding.to_json() for finding in findings],
                "grasps": [{key: row[key] for key in columns} for row in rows],
            }
        )
    else:
        for finding in findings:
            click.echo(f"{'ok  ' if finding.passed else 'FAIL'} {finding.name}: {finding.says}")
    if not passed:
        raise click.exceptions.Exit(1)


@robot.command()
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE..."
)
@click.option("--strict", is_flag=True, help="Count a file with gaps as one that cannot be read.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
    help="Write the findings to FILE as they come, one JSON object a line; files that are in it "
    "are not read again.",
)  # fmt: skip
@listing_option
@json_option
def survey(
    files: tuple[Path, ...], strict: bool, out: Path | None, limit: int | None, as_json: bool
) -> None:
    """Tell which URDF files can be read, and which arms and hands they show.

    A folder stands for all files *.urdf below it. At the end: in how many of the files that show a
    hand, by the names of their joints, one was found, by maker; and in how many it cannot be
    measured, because its fingers have no shapes or limits that leave no motion. Exit code 1 if a
    file cannot be read.
    """
    from simulate.onboarding.survey import SurveyLog, recall_by_maker, survey_files

    log = SurveyLog(out) if out is not None else None
    rows = list(log.rows) if log is not None else []
    before = len(rows)
    lines = RowsAsTheyCome(limit, as_json)
    for row in rows if as_json else ():
        lines.show(row.to_json(), "")
    for row in survey_files(files, strict, [row.path for row in rows]):
        if log is not None:
            log.add(row)
        rows.append(row)
        lines.show(row.to_json(), row.line())
    lines.end()
    if not as_json:
        if before:
            click.echo(f"{before} were surveyed before: {out}")
        makers = recall_by_maker(rows)
        for maker in makers:
            bare = f", {maker.unmeasured} not measurable" if maker.unmeasured else ""
            click.echo(
                f"hands in {maker.recognised:3} of {maker.shown:3} files{bare}: {maker.maker}"
            )
        shown = sum(maker.shown for maker in makers)
        recognised = sum(maker.recognised for maker in makers)
        if shown:
            click.echo(
                f"hands in {recognised} of {shown} files that name one ({recognised / shown:.2f}), "
                f"not measurable in {sum(m.unmeasured for m in makers)}, and in "
                f"{sum(bool(row.hands) for row in rows) - recognised} that name none"
            )
        read = sum(not row.error for row in rows)
        click.echo(f"{read} of {len(rows)} can be read")
    if any(row.error for row in rows):
        raise click.exceptions.Exit(1)


@robot.command("first-grasps")
@click.argument(
    "files",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE...",
)
@click.option("--gripper", metavar="FILE|jaw:STROKE|suction:RADIUS|three:OPENING",
    help="Hand for the arms that show none.",
)  # fmt: skip
@click.option("--grasps", default=4, show_default=True, type=click.IntRange(min=1),
    help="Products for each robot.",
)  # fmt: skip
@options.seed("products, places and noise")
@options.preset
@options.workers()
@listing_option
@json_option
def first_grasps_of(
    files: tuple[Path, ...], gripper: str | None, grasps: int, seed: int, preset: str,
    workers: int, limit: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Make a robot of each URDF file, let it grasp, and print a line for each as it comes.

    Nothing is kept. Exit code 1 if a file becomes no robot, or one holds nothing.
    """
    from simulate.onboarding.first_grasps import first_grasps
    from simulate.world.quiet import banner_on_stderr

    lines, holds = RowsAsTheyCome(limit, as_json), True
    tried = first_grasps(
        files, gripper=gripper, grasps=grasps, preset=preset, seed=seed, workers=workers
    )
    while True:
        with banner_on_stderr():
            row = next(tried, None)
        if row is None:
            break
        lines.show(row.to_json(), row.line())
        holds = holds and row.held > 0
    lines.end()
    if not holds:
        raise click.exceptions.Exit(1)


@robot.command()
@click.argument("name")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object with the document.")
def srdf(name: str, as_json: bool) -> None:
    """Print the SRDF of a robot: groups, hands, home posture, links that may touch.

    With the URDF of `rtask simulate urdf` it describes the robot to MoveIt.
    """
    from simulate.robots import describe
    from simulate.robots.srdf import srdf_text

    text = srdf_text(describe(name))
    click.echo(json.dumps({"name": name, "srdf": text}) if as_json else text, nl=as_json)


@robot.command()
@click.argument("name")
@json_option
def remove(name: str, as_json: bool) -> None:
    """Forget a robot that was added; its URDF stays, and its settings until the next removal."""
    from simulate.robots.robot_files import robot_names, robots_folder, set_aside

    path = robots_folder() / f"{name}.toml"
    if name not in robot_names():
        names = ", ".join(robot_names()) or "none"
        raise UnknownRobotError(f"no robot {name!r} was added; there are: {names}")
    set_aside(path)
    if as_json:
        print_json({"name": name, "removed": str(path)})
    else:
        click.echo(f"removed {path}")
        announce_undo("robot", "restore", name)


@robot.command()
@click.argument("name")
@json_option
def restore(name: str, as_json: bool) -> None:
    """Bring back the settings of a robot that was removed or replaced; present ones go aside."""
    from simulate.robots.robot_files import restore_settings, robots_folder

    path = robots_folder() / f"{name}.toml"
    is_swapped = path.exists()
    restore_settings(path)
    if as_json:
        print_json({"name": name, "settings": str(path)})
    else:
        click.echo(f"restored {path}")
        announce_undo("robot", "restore" if is_swapped else "remove", name)
