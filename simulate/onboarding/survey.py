"""Survey of URDF files: which can be read, what they describe, and in how many a hand is found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtask.errors import RobotError, UsageError
from simulate.onboarding.hand_words import hand_joints
from simulate.onboarding.hands import MIN_ARM_JOINTS, arm_ends, find_hands, unmeasured_hand
from simulate.robots.robot_files import bare_robot

__all__ = ["Recall", "SurveyLog", "Surveyed", "recall_by_maker", "survey_files"]

_PACKAGE = re.compile(r"[_-](descriptions?|models?|data|support|urdf|robots?)$", re.I)
_UNREADABLE = (RobotError, ValueError, ArithmeticError, LookupError, RecursionError, OSError)
"""The last ones of files for which no reader was prepared: a survey goes on after them."""


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
        Links that carry fingers which open, measured on their shapes.
    arms
        Links at the ends of chains of three or more joints, if there is no hand.
    maker
        Folder of the maker or package: the nearest above the file whose name ends in
        ``_description``, ``_models`` or the like, else the first below the folder surveyed.
    named
        Moving joints whose names speak of fingers, jaws or a gripper: the file shows a hand.
    alone
        Those of ``hands`` that have no arm.
    unmeasured
        Links of a hand that only names show, and why it cannot be measured.
    """

    path: str
    error: str = ""
    warnings: tuple[str, ...] = ()
    joints: int = 0
    hands: tuple[str, ...] = ()
    arms: tuple[str, ...] = ()
    maker: str = ""
    named: tuple[str, ...] = ()
    alone: tuple[str, ...] = ()
    unmeasured: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the findings as JSON data."""
        return asdict(self)

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> Surveyed:
        """Return the findings that :meth:`to_json` gave."""
        values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}
        return cls(**values)

    def line(self) -> str:
        """Return the findings as one line of text."""
        if self.error:
            return f"FAIL {self.path}: {self.error.removeprefix(f'{self.path}: ')}"
        names = [f"{name} (no arm)" if name in self.alone else name for name in self.hands]
        shows = f"hands: {', '.join(names)}" if names else f"{len(self.arms)} arms"
        if self.named and not self.hands:
            shows += f", no hand found, but {self.unmeasured or ', '.join(self.named[:3])}"
        gaps = f", {len(self.warnings)} gaps filled" if self.warnings else ""
        return f"ok   {self.path}: {self.joints} joints, {shows}{gaps}"


@dataclass(frozen=True)
class Recall:
    """In how many files of a maker that show a hand one is found.

    Parameters
    ----------
    maker
        As of :class:`Surveyed`.
    shown
        Files whose joints are named after a hand.
    recognised
        Those of them in which a hand is found.
    unmeasured
        Those of the others whose fingers have no shapes, or limits that leave no motion.
    """

    maker: str
    shown: int
    recognised: int
    unmeasured: int = 0


class SurveyLog:
    """File of findings, one JSON object a line, to which a survey adds as it goes.

    A survey that was cut goes on with the files that are not in it.

    Parameters
    ----------
    path
        The file; it is made, or continued. A last line that was cut is dropped.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rows: list[Surveyed] = []
        try:
            text = path.read_bytes() if path.exists() else b""
            whole = text[: text.rfind(b"\n") + 1]
            self.rows = [Surveyed.from_json(json.loads(line)) for line in whole.splitlines()]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(whole) if whole != text else path.touch()
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}") from error
        except (ValueError, TypeError) as error:
            raise UsageError(f"{path}: no file of a survey: {error}") from error

    def add(self, row: Surveyed) -> None:
        """Write the findings about a file."""
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row.to_json()) + "\n")


def survey_files(
    files: Iterable[Path], strict: bool = False, skipped: Iterable[str] = ()
) -> Iterator[Surveyed]:
    """Yield what each URDF file shows; a folder stands for all below it.

    Parameters
    ----------
    files
        Files and folders.
    strict
        Count a file with gaps as one that cannot be read.
    skipped
        Paths that are left out, as they were surveyed before.
    """
    done = set(skipped)
    for file in files:
        if not file.exists():
            raise UsageError(f"{file}: there is no such file or folder")
        paths = sorted(file.rglob("*.urdf")) if file.is_dir() else [file]
        for path in paths:
            if str(path) not in done:
                yield _surveyed(path, strict, file if file.is_dir() else file.parent)


def recall_by_maker(rows: Iterable[Surveyed]) -> list[Recall]:
    """Return, by maker, in how many of the files that show a hand one is found."""
    by_maker: dict[str, list[Surveyed]] = {}
    for row in rows:
        if row.named:
            by_maker.setdefault(row.maker, []).append(row)
    return [
        Recall(
            maker, len(own), sum(bool(row.hands) for row in own),
            sum(bool(row.unmeasured) for row in own),
        )
        for maker, own in sorted(by_maker.items())
    ]  # fmt: skip


def _surveyed(path: Path, strict: bool, below: Path) -> Surveyed:
    maker = _maker(path, below)
    try:
        robot, warnings = bare_robot(path, name=path.stem, strict=strict)
        hands_on = find_hands(robot)
    except _UNREADABLE as error:
        return Surveyed(str(path), str(error) or type(error).__name__, maker=maker)
    hands = tuple(hand.wrist for hand in hands_on)
    ends = () if hands else tuple(arm_ends(robot))
    alone = tuple(hand.wrist for hand in hands_on if len(hand.joints) < MIN_ARM_JOINTS)
    return Surveyed(
        str(path), "", warnings, len(robot.joints), hands, ends, maker,
        tuple(hand_joints(robot)), alone, "" if hands else unmeasured_hand(robot),
    )  # fmt: skip


def _maker(path: Path, below: Path) -> str:
    inside = path.relative_to(below).parts[:-1]
    for name in inside[::-1]:
        if _PACKAGE.search(name):
            return name
    return inside[0] if inside else below.resolve().name
