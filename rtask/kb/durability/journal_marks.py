"""Marks of a journal: where each record begins, when its commit was made, how much it changed.

They are read from the headers alone, once a process, and then only from what was written since: an
earlier state is found without reading, or checking, the records that it does not undo.
"""

from __future__ import annotations

import datetime as dt
import json
import threading
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rtask.errors import StoreError, UsageError
from rtask.rdf.terms import moment

__all__ = ["JournalMarks", "Mark"]


@dataclass(frozen=True)
class Mark:
    """Mark of one record.

    Parameters
    ----------
    seq
        Number of the commit.
    time_s
        Unix time of the commit by the clock of the machine that made it.
    changed
        Number of statements that it added and removed.
    segment, start
        Name of the segment, and offset of the record in it.
    """

    seq: int
    time_s: float
    changed: int
    segment: str
    start: int


@dataclass
class _Segment:
    """Marks of one segment, oldest first, and the offset up to which it has been read."""

    name: str
    seqs: array[int] = field(default_factory=lambda: array("q"))
    # Columns of numbers, 32 bytes a commit: a journal may have millions.
    times_s: array[float] = field(default_factory=lambda: array("d"))
    changed: array[int] = field(default_factory=lambda: array("q"))
    starts: array[int] = field(default_factory=lambda: array("q"))
    end: int = 0

    def read_on(self, path: Path, torn_end: bool) -> None:
        """Read the headers that were written since; the last one may be incomplete.

        Raises
        ------
        StoreError
            The segment is damaged, other than by a record torn at its end where that may be.
        """
        with path.open("rb") as file:
            size = file.seek(0, 2)
            # Another process has cut off records that were never wholly written.
            if size < self.end:
                self.forget(size)
            file.seek(self.end)
            while line := file.readline():
                mark = _read(line)
                if mark is None or self.end + len(line) + mark[3] > size:
                    # Of the last segment the end may be in the making; anywhere else it is damage.
                    if torn_end:
                        return
                    raise StoreError(
                        f"{path} has a damaged record before its end; restore a backup"
                    )
                for column, value in zip((self.seqs, self.changed), mark[:2], strict=True):
                    column.append(value)
                self.times_s.append(mark[2])
                self.starts.append(self.end)
                self.end = file.seek(self.end + len(line) + mark[3])

    def forget(self, size: int) -> None:
        """Forget the records that end after an offset."""
        while self.starts and self.end > size:
            self.end = self.starts.pop()
            for column in (self.seqs, self.times_s, self.changed):
                column.pop()

    def mark(self, k: int) -> Mark:
        """Return one mark."""
        return Mark(self.seqs[k], self.times_s[k], self.changed[k], self.name, self.starts[k])


class JournalMarks:
    """Marks of all records of a journal.

    Parameters
    ----------
    paths
        Returns the segments, oldest first.
    """

    def __init__(self, paths: Callable[[], Sequence[Path]]) -> None:
        self._paths = paths
        self._lock = threading.Lock()
        self._segments: dict[str, _Segment] = {}

    def after(self, seq: int) -> Iterator[Mark]:
        """Yield the marks of the commits after one, oldest first."""
        for segment in self._current():
            first = bisect_right(segment.seqs, seq)
            yield from (segment.mark(k) for k in range(first, len(segment.seqs)))

    def between(self, after: int, upto: int) -> Iterator[Mark]:
        """Yield the marks of the commits after one and up to another, oldest first."""
        for segment in self._current():
            first, end = bisect_right(segment.seqs, after), bisect_right(segment.seqs, upto)
            yield from (segment.mark(k) for k in range(first, end))

    def changed(self, after: int, upto: int) -> int:
        """Return how many statements the commits after one and up to another added and removed."""
        total = 0
        for segment in self._current():
            first, end = bisect_right(segment.seqs, after), bisect_right(segment.seqs, upto)
            total += sum(segment.changed[first:end])
        return total

    def at(self, time: dt.datetime) -> tuple[Mark | None, Mark | None]:
        """Return the first mark of all, and the last one whose clock showed no later time.

        Where the clock was set back, later commits may show earlier times: the number decides.
        """
        segments, time_s = self._current(), time.timestamp()
        first = next((segment.mark(0) for segment in segments if segment.seqs), None)
        for segment in reversed(segments):
            # One by one from the end and not by halves: clocks go back, so that times are not
            # sorted.
            for k in range(len(segment.seqs) - 1, -1, -1):
                if segment.times_s[k] <= time_s:
                    return first, segment.mark(k)
        return first, None

    def forget(self, segment: str, start: int) -> None:
        """Forget the record at an offset of a segment, and those after it: it was withdrawn."""
        with self._lock:
            if segment in self._segments:
                self._segments[segment].forget(start)

    def _current(self) -> list[_Segment]:
        with self._lock:
            segments = {}
            paths = self._paths()
            for path in paths:
                segment = self._segments.get(path.name) or _Segment(path.name)
                segment.read_on(path, torn_end=path == paths[-1])
                segments[path.name] = segment
            self._segments = segments
            return list(segments.values())


def _read(line: bytes) -> tuple[int, int, float, int] | None:
    """Return number, size of the change, time and bytes of a record; None if it is damaged."""
    try:
        header = json.loads(line)
        changed = int(header["added"]) + int(header["removed"])
        time_s = moment(header.get("time")).timestamp()
        return int(header["seq"]), changed, time_s, int(header["bytes"])
    except (ValueError, KeyError, TypeError, UsageError):
        return None
