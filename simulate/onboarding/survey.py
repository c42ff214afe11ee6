"""Survey of URDF files: which can be read, and what they describe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtask.errors import RobotError, UsageError
from simulate.onboarding.hands import arm_ends, find_hands
from simulate.robots.robot_files import bare_robot

__all__ = ["Surveyed", "survey_files"]


@dataclass(frozen=True)
class Surveyed:
    """One file.

    Parameters
    ----------
    path
        Of the file.
    error
        Why it cannot be read; empty if it can.
    warnings
        Gaps that were filled.
    joints
        Number of moving joints.
    hands
        Links that carry fingers which open.
    arms
        Links at the ends of chains of three or more joints, if there is no hand.
    """

    path: str
    error: str = ""
    warnings: tuple[str, ...] = ()
    joints: int = 0
    hands: tuple[str, ...] = ()
    arms: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the findings as JSON data."""
        return asdict(self)

    def line(self) -> str:
        """Return the findings as one line of text."""
        if self.error:
            return f"FAIL {self.path}: {self.error.removeprefix(f'{self.path}: ')}"
        hands = f"hands: {', '.join(self.hands)}" if self.hands else f"{len(self.arms)} arms"
        gaps = f", {len(self.warnings)} gaps filled" if self.warnings else ""
        return f"ok   {self.path}: {self.joints} joints, {hands}{gaps}"


def survey_files(files: Iterable[Path], strict: bool = False) -> Iterator[Surveyed]:
    """Yield what each URDF file shows; a folder stands for all below it."""
    for file in files:
        if not file.exists():
            raise UsageError(f"{file}: there is no such file or folder")
        paths = sorted(file.rglob("*.urdf")) if file.is_dir() else [file]
        for path in paths:
            yield _surveyed(path, strict)


def _surveyed(path: Path, strict: bool) -> Surveyed:
    try:
        robot, warnings = bare_robot(path, name=path.stem, strict=strict)
    except RobotError as error:
        return Surveyed(str(path), str(error))
    hands = tuple(hand.wrist for hand in find_hands(robot))
    ends = () if hands else tuple(arm_ends(robot))
    return Surveyed(str(path), "", warnings, len(robot.joints), hands, ends)
