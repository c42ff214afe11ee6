"""From URDF files to first grasps: each becomes a robot, closes its hand, grasps products."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rtask.errors import RobotError, RtaskError
from rtask.scratch import ScratchFolder
from simulate.onboarding.check import check_closing, check_grasps
from simulate.onboarding.guess import NoHandError, guess_robot
from simulate.robots.robot_files import save_robot

__all__ = ["FirstGrasps", "first_grasps"]

_NAME = "tried"


@dataclass(frozen=True)
class FirstGrasps:
    """What became of one file.

    Parameters
    ----------
    file
        Its path.
    error
        Why it is no robot; empty if it is.
    joints
        Of each arm.
    hand
        Link that carries it, or the gripper that was hung on.
    reach
        Share of the table in reach, 0..1.
    closes
        Whether each hand held a box and closed further on nothing.
    held, placed, grasps
        Products held and placed at the first try, out of how many.
    cpu_s
        Processor time from the file to the last grasp, s.
    """

    file: str
    error: str = ""
    joints: tuple[int, ...] = ()
    hand: str = ""
    reach: float = 0.0
    closes: bool = False
    held: int = 0
    placed: int = 0
    grasps: int = 0
    cpu_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the row as JSON data."""
        return asdict(self)

    def line(self) -> str:
        """Return the row as one line of text."""
        if self.error:
            return f"FAIL {self.file}: {self.error.removeprefix(f'{self.file}: ')}"
        arms = " and ".join(f"{count} joints" for count in self.joints)
        closes = "closes" if self.closes else "does not close on a box"
        return (
            f"{'ok  ' if self.held else 'FAIL'} {self.file}: {arms}, hand {self.hand} {closes}, "
            f"reaches {self.reach:.0%}, held {self.held} and placed {self.placed} of "
            f"{self.grasps}, {self.cpu_s:.0f} s of processor time"
        )


def first_grasps(
    files: Iterable[Path],
    *,
    gripper: str | None,
    grasps: int,
    preset: str,
    seed: int,
    workers: int,
) -> Iterator[FirstGrasps]:
    """Yield what becomes of each URDF file, as it comes; nothing of it is kept.

    Parameters
    ----------
    files
        The files.
    gripper
        Hand for those that show none, as of :func:`~simulate.robots.attaching.gripper_of`.
    grasps
        Products for each robot, one on the table at a time.
    preset, seed, workers
        Of the physics, the products and the processes.
    """
    for file in files:
        with ScratchFolder("robot") as folder:
            try:
                with _robots_in(folder):
                    yield _tried(file, folder, gripper, grasps, preset, seed, workers)
            except RtaskError as error:
                yield FirstGrasps(str(file), str(error))


def _tried(
    file: Path, folder: Path, gripper: str | None, grasps: int, preset: str, seed: int, workers: int
) -> FirstGrasps:
    start = _cpu_s()
    hung = None
    try:
        made = guess_robot(file, _NAME)
    except NoHandError as error:
        if gripper is None:
            raise RobotError(str(error)) from error
        hung, made = gripper, guess_robot(file, _NAME, gripper=gripper)
    save_robot(made.settings, made.guessed, folder / f"{_NAME}.toml")
    arms = made.robot.arms.values()
    row = FirstGrasps(
        str(file),
        joints=tuple(len(arm.joints) for arm in arms),
        hand=hung or ", ".join(arm.wrist for arm in arms),
        reach=round(made.share, 3),
        closes=all(finding.passed for finding in check_closing(made.robot)),
    )
    _, rows = check_grasps(
        _NAME, grasps, folder / "grasps", preset=preset, seed=seed, workers=workers
    )
    return replace(
        row,
        held=sum(bool(grasp["held"]) for grasp in rows),
        placed=sum(bool(grasp["placed"]) for grasp in rows),
        grasps=grasps,
        cpu_s=round(_cpu_s() - start, 1),
    )


def _cpu_s() -> float:
    """Return the processor time of this process and of its ended children, s."""
    return sum(os.times()[:4])


@contextmanager
def _robots_in(folder: Path) -> Iterator[None]:
    """Let names of robots, in child processes too, mean the settings in a folder."""
    before = os.environ.get("RTASK_ROBOTS")
    os.environ["RTASK_ROBOTS"] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ["RTASK_ROBOTS"]
        else:
            os.environ["RTASK_ROBOTS"] = before
