"""What a run of an entry gives: figures of ours beside the thesis's, notes and pictures."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from simulate.study.declaration import Study
from simulate.study.intervals import wilson
from simulate.study.runner import run

__all__ = ["Compared", "Result", "Setting", "Verdict", "counted", "is_busy", "overall", "share_of"]

Verdict = Literal["reproduced", "better", "worse", "different", "too few to tell", "not compared"]

_GRAVITY: tuple[Verdict, ...] = (
    "worse", "different", "too few to tell", "not compared", "reproduced", "better",
)  # fmt: skip
"""Verdicts, the one to lead with first."""

_WIDEST_SHARE = 0.4
"""A share known no better than this agrees with nearly every figure."""
_SMALLER = "(--fast)"
"""Ends the note on each size that is smaller than the thesis's."""


def is_busy() -> bool:
    """Whether more wants to run here than there are cores, so that the clock tells of others."""
    return os.getloadavg()[0] > len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Setting:
    """How an entry is run.

    Parameters
    ----------
    fast
        Smaller sizes, so that all entries together end within half an hour on two cores; each
        result says what was made smaller.
    seed
        Determines every draw.
    images
        Folder of photographs of 640 x 480 that stand in for the first thesis's; None = simulated.
    journals
        Folder for the journals of studies; None = they are run here, without one.
    resume
        Whether to take over the trials that an interrupted run left there.
    workers
        Processes for the trials of studies with a journal.
    """

    fast: bool = True
    seed: int = 0
    images: Path | None = None
    journals: Path | None = None
    resume: bool = False
    workers: int = 1

    def trials(self, study: Study) -> list[dict[str, Any]]:
        """Run the trials of a study, those that its journal lacks, and return their results."""
        if self.journals is None:
            return study.in_process()
        described = json.dumps([study.name, study.settings], sort_keys=True).encode()
        name = f"{study.slug}-{hashlib.sha256(described).hexdigest()[:8]}"
        return run(study, self.journals / name, self.workers, self.resume)

    def size(self, whole: int, fast: int) -> int:
        """Return the size to use."""
        return min(fast, whole) if self.fast else whole

    def shrunk(self, what: str, whole: int, fast: int) -> tuple[str, ...]:
        """Return the note that a size is smaller than the thesis's; none where it is not."""
        return (
            (f"{what}: {fast} instead of {whole} {_SMALLER}",) if self.fast and fast < whole else ()
        )


@dataclass(frozen=True)
class Compared:
    """A figure of ours and the thesis's.

    Parameters
    ----------
    what
        What is measured, with the stand-in where there is one.
    ours, theirs
        None where there is no such figure.
    unit
        Of both; "" for shares and counts.
    interval
        95 % interval of ours.
    tolerance, reason
        Difference up to which both count as equal, and why so much.
    better
        Which way is better; "" where neither is.
    widest
        Width of the interval above which it says nothing, although it holds theirs.
    because
        Why ours is worse or may be, for the list of figures that are.
    """

    what: str
    ours: float | None
    theirs: float | None = None
    unit: str = ""
    interval: tuple[float, float] | None = None
    tolerance: float | None = None
    reason: str = ""
    better: Literal["higher", "lower", ""] = ""
    widest: float = math.inf
    because: str = ""

    def __post_init__(self) -> None:
        if self.tolerance is not None and not self.reason:
            raise ValueError(f"{self.what}: a tolerance needs a reason")

    @property
    def verdict(self) -> Verdict:
        """How ours compares: reproduced if the interval holds theirs, or within the tolerance."""
        if self.ours is None or self.theirs is None:
            return "not compared"
        if self.interval is not None and self.interval[0] <= self.theirs <= self.interval[1]:
            is_wide = self.interval[1] - self.interval[0] > self.widest
            return "too few to tell" if is_wide else "reproduced"
        off = self.ours - self.theirs
        if self.tolerance is not None and abs(off) <= self.tolerance:
            return "reproduced"
        if off == 0:
            return "too few to tell"  # equal, with neither an interval nor a tolerance
        if not self.better:
            return "different"
        return "better" if (off > 0) == (self.better == "higher") else "worse"

    def to_json(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "what": self.what,
            "ours": self.ours,
            "interval95": None if self.interval is None else list(self.interval),
            "theirs": self.theirs,
            "unit": self.unit,
            "verdict": self.verdict,
            "tolerance": self.tolerance,
            "tolerance_reason": self.reason or None,
            "because": self.because or None,
        }


@dataclass(frozen=True)
class Result:
    """What one run gave.

    Parameters
    ----------
    rows
        In the order of the thesis.
    notes
        Sentences on what differs from the thesis's set-up, stand-ins and shrunk sizes first.
    pictures
        SVG documents (str) or PNG images (bytes), by caption.
    stand_in
        What stands in for what the thesis did not publish, if not what the entry says.
    """

    rows: tuple[Compared, ...] = ()
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, str | bytes] = field(default_factory=dict)
    stand_in: str = ""

    @property
    def is_smaller(self) -> bool:
        """Whether a size is smaller than the thesis's."""
        return any(_SMALLER in note for note in self.notes)

    @property
    def verdict(self) -> Verdict:
        """The gravest verdict of all rows."""
        return overall(row.verdict for row in self.rows)


def overall(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the gravest of some verdicts: one worse row makes the whole worse.

    >>> overall(["better", "worse", "reproduced"])
    'worse'
    """
    given = set(verdicts)
    compared = given - {"not compared"}
    return next((v for v in _GRAVITY if v in (compared or given)), "not compared")


def counted(what: str, ours: float, theirs: float | None = None, **more: Any) -> Compared:
    """Return a number that follows from a construction, without chance: equal or not."""
    return Compared(what, ours, theirs, tolerance=0.0, reason="counted, without chance", **more)


def share_of(what: str, hits: int, n: int, theirs: float | None = None, **more: Any) -> Compared:
    """Return a share with its interval (Wilson 1927) beside the thesis's."""
    share = hits / n if n else None
    return Compared(what, share, theirs, interval=wilson(hits, n), widest=_WIDEST_SHARE, **more)
