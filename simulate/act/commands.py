"""``rtask simulate act-test`` and ``rtask simulate act-serve``."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.errors import RobotError, UsageError
from rtask.scratch import ScratchFolder
from simulate import options
from simulate.world.quiet import banner_on_stderr

if TYPE_CHECKING:
    from types import FrameType

    from simulate.act.trials import Trial
    from simulate.grasping.executor import Workcell

__all__ = ["act_serve", "act_test", "lay_objects"]

_seed = options.seed("goals and plans")
_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
_gui = click.option("--gui", is_flag=True, help="Show the simulation in a window.")
_n = click.option("--trials", "-n", "n", default=100, show_default=True, help="Random goals.")
_csv = click.option(
    "--csv",
    "csv_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write one line per goal, as it goes.",
)


def _of_trials(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of a test of random goals."""
    for add in (_gui, _json, _csv, _seed, _n, options.robot):
        command = add(command)
    return command


def _cell(robot: str, gui: bool) -> Workcell:
    from simulate.grasping.executor import Workcell

    if gui and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RobotError("--gui needs a display and there is none; leave it out to run headless")
    with banner_on_stderr():
        return Workcell(robot, gui=gui)


@click.group("act-test")
def act_test() -> None:
    """Test where a robot's arms can reach and place, and map their workspace."""


@act_test.command()
@_of_trials
def reach(robot: str, n: int, seed: int, csv_path: Path | None, as_json: bool, gui: bool) -> None:
    """Reach for imaginary objects at random positions."""
    from simulate.act.trials import reach_test

    _trials(reach_test, robot, n, seed, csv_path, as_json, gui)


@act_test.command()
@_of_trials
def place(robot: str, n: int, seed: int, csv_path: Path | None, as_json: bool, gui: bool) -> None:
    """Carry an imaginary object to random positions."""
    from simulate.act.trials import place_test

    _trials(place_test, robot, n, seed, csv_path, as_json, gui)


def _trials(
    run: Callable[..., list[Trial]],
    robot: str,
    n: int,
    seed: int,
    csv_path: Path | None,
    as_json: bool,
    gui: bool,
) -> None:
    from simulate.act.service import ActService
    from simulate.act.trials import csv_log, reasons

    if n < 1 or seed < 0:
        raise UsageError(f"-n {n} --seed {seed}: expected one goal or more and no negative seed")

    def show(trial: Trial) -> None:
        write(trial)
        if not as_json:
            error = "" if trial.error_m is None else f"{trial.error_m * 1000:6.1f}"
            click.echo(
                f"{trial.number:5d} {trial.x:8.3f} {trial.y:8.3f} {trial.z:8.3f} "
                f"{trial.theta:7.2f}  {trial.arm or '-':10} {error:>6} {trial.cpu_s:6.2f}  "
                f"{trial.reason}"
            )

    if not as_json:
        click.echo("    n        x        y        z   theta  arm            mm  CPU s  reason")
    with _cell(robot, gui) as cell, csv_log(csv_path) as write:
        done = run(ActService(cell, seed=seed), n, seed, show)
    reached = sum(trial.reached for trial in done)
    if as_json:
        result = {"robot": robot, "seed": seed, "n": n, "reached": reached,
                  "reasons": reasons(done), "trials": [vars(trial) for trial in done]}  # fmt: skip
        click.echo(json.dumps(result))
        return
    counted = ", ".join(f"{name} {count}" for name, count in reasons(done).items())
    click.echo(f"{robot}: reached {reached} of {n} ({counted})")


@act_test.command()
@options.robot
@click.option("--step", default=0.02, show_default=True, help="Size of a cell, m.")
@click.option("--heights", default="", help="Heights of the tool, m, such as 0.27,0.30.")
@click.option("--angles", default=12, show_default=True, help="Number of closing directions.")
@_seed
@click.option(
    "--out",
    default="workspace",
    show_default=True,
    type=click.Path(path_type=Path),
    help="Writes OUT.npz and OUT.png.",
)
@_json
def workspace(
    robot: str, step: float, heights: str, angles: int, seed: int, out: Path, as_json: bool
) -> None:
    """Map the share of closing directions that the gripper reaches in each cell."""
    from simulate.act.workspace import map_workspace
    from simulate.motion.arm_space import ArmSpace
    from simulate.robots import describe

    try:
        levels = tuple(float(part) for part in heights.split(",") if part.strip())
    except ValueError as error:
        raise UsageError(f"--heights {heights!r}: expected numbers separated by commas") from error
    started = time.process_time()
    space = ArmSpace(describe(robot))
    reach_map = map_workspace(space, step=step, heights=levels, angles=angles, seed=seed)
    npz, png = out.with_suffix(".npz"), out.with_suffix(".png")
    reach_map.write_npz(npz)
    reach_map.write_png(png)
    areas = reach_map.area_m2()
    if as_json:
        areas_cm2 = {f"{height:g}": round(area * 1e4, 1) for height, area in areas.items()}
        click.echo(json.dumps({"robot": robot, "area_cm2": areas_cm2, "npz": str(npz),
                               "png": str(png)}))  # fmt: skip
        return
    for height, area in areas.items():
        click.echo(f"tool at {height:.3f} m: half of the directions on {area * 1e4:.0f} cm2")
    click.echo(f"wrote {npz} and {png} ({time.process_time() - started:.0f} CPU s)")


@click.command("act-serve")
@click.argument("url", required=False)
@click.option(
    "--server",
    metavar="URL",
    envvar="RTASK_SERVER",
    show_envvar=True,
    help="Server to connect to; the same as URL.",
)
@click.option("--name", default="", help="The robot's name; with a token, the token's agent.")
@options.robot
@click.option("--objects", default=0, show_default=True, help="Objects put on the table.")
@_seed
@_gui
def act_serve(
    url: str | None,
    server: str | None,
    name: str,
    robot: str,
    objects: int,
    seed: int,
    gui: bool,
) -> None:
    """Provide the act service of a simulated robot on a server until Ctrl-C.

    Its arms also follow trajectories, as actions <arm>_controller/follow_joint_trajectory.
    The robot's token is taken from the environment variable RTASK_TOKEN.
    """

    address = url or server
    if not address:
        raise UsageError("no server given: use --server URL")

    from simulate.act.provider import ActProvider
    from simulate.act.service import ActService

    def interrupt(signum: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    with _cell(robot, gui) as cell, ScratchFolder("assets") as folder:
        standing = lay_objects(cell, objects, seed, folder)
        provider = ActProvider(
            ActService(cell, name, seed), address, name or robot, os.environ.get("RTASK_TOKEN")
        )

        def ready() -> None:
            event = {"event": "ready", "services": provider.services,
                     "actions": provider.actions, "objects": standing}  # fmt: skip
            click.echo(json.dumps(event))

        try:
            provider.serve(ready)
        except KeyboardInterrupt:
            click.echo(json.dumps({"event": "stopped"}))


def lay_objects(cell: Workcell, objects: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Put objects on the table; return name, centre of mass (m) and yaw (rad) of each."""
    import numpy as np

    from simulate.world.objects import sample_objects
    from simulate.world.scene import arrange, lay

    if objects < 1:
        return []
    rng = np.random.default_rng(seed)
    laid = lay(
        cell.world,
        arrange(sample_objects(rng, objects), rng, workplace=cell.world.workplace),
        folder,
    )
    standing = []
    for item in laid:
        pose = cell.world.object_pose(item.body)
        standing.append({"product": item.placement.spec.name, "x": pose.x, "y": pose.y, "z": pose.z,
                         "yaw": pose.yaw})  # fmt: skip
    return standing
