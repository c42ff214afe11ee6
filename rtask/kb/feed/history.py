"""History of statements, read from the journal."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from pyoxigraph import Quad

from rtask.kb.durability.journal import JournalWithHistory, NoJournal
from rtask.kb.feed.feed import Feed
from rtask.rdf.terms import LONG_AGO, GraphName, moment

__all__ = ["ClockJump", "HistoryEntry", "Period", "clock_jumps", "history", "matcher"]


@dataclass(frozen=True)
class HistoryEntry:
    """Effect of one commit on the matching statements.

    Parameters
    ----------
    time
        ISO 8601, UTC, by the clock of the machine that committed.
    agent
        Name of the author, or ``None`` for the program itself.
    clock_back_s
        By how many seconds the time is before that of an earlier commit among those read: the clock
        was wrong then, or is now.
    """

    seq: int
    time: str
    agent: str | None
    note: str | None
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]
    clock_back_s: float = 0.0


@dataclass(frozen=True)
class Period:
    """Range of commits, by number, time and author.

    Parameters
    ----------
    after, upto
        Commits numbered above ``after`` and up to ``upto``.
    start, end
        Commits at ``start`` or later and before ``end``.
    agent
        Name of the author.
    """

    after: int = 0
    upto: int | None = None
    start: dt.datetime | None = None
    end: dt.datetime | None = None
    agent: str | None = None

    def holds(self, time: object, agent: object) -> bool:
        """Whether a commit with this time and author is in the range."""
        if self.agent is not None and agent != self.agent:
            return False
        if self.start is None and self.end is None:
            return True
        at = moment(str(time or ""))
        return (self.start is None or at >= self.start) and (self.end is None or at < self.end)


def history(
    feed: Feed,
    journal: JournalWithHistory | NoJournal,
    matches: Callable[[Quad], bool],
    period: Period,
) -> Iterator[HistoryEntry]:
    """Yield the commits that touched matching statements, oldest first.

    For a store in memory, which has no journal, the history goes back as far as the feed's memory.
    """
    for entry in _entries(feed, journal, period):
        added = tuple(filter(matches, entry.added))
        removed = tuple(filter(matches, entry.removed))
        if added or removed:
            yield replace(entry, added=added, removed=removed)


def _entries(
    feed: Feed, journal: JournalWithHistory | NoJournal, period: Period
) -> Iterator[HistoryEntry]:
    upto = feed.last_seq if period.upto is None else period.upto
    clock = _Clock()
    # In memory there is no journal, but the feed keeps the last changes.
    if isinstance(journal, NoJournal):
        for change in feed.changes(period.after, upto):
            time = change.commit.time.isoformat()
            # For every commit, also those not shown: the clock is compared with the latest of all.
            back = clock.back_s(time)
            if period.holds(time, change.agent):
                added = (*change.added, *change.inferred_added)
                removed = (*change.removed, *change.inferred_removed)
                yield HistoryEntry(
                    change.commit.seq, time, change.agent, change.note, added, removed, back
                )
        return
    for record in journal.records(period.after):
        if record.seq > upto:
            return
        header = record.header
        back = clock.back_s(header.get("time"))
        if period.holds(header.get("time"), header.get("agent")):
            yield HistoryEntry(
                record.seq,
                str(header.get("time", "")),
                header.get("agent"),
                header.get("note"),
                tuple(record.added()),
                tuple(record.removed()),
                back,
            )


class _Clock:
    """Compares the times of commits, in their order."""

    _latest = LONG_AGO

    def back_s(self, time: object) -> float:
        """Return by how much a time is before the latest so far; 0 if it is not, or is unknown."""
        at = moment(str(time)) if time else LONG_AGO
        back = (self._latest - at).total_seconds() if time else 0.0
        self._latest = max(self._latest, at)
        return max(back, 0.0)


@dataclass(frozen=True)
class ClockJump:
    """A commit whose clock was behind that of an earlier commit.

    Parameters
    ----------
    seq, time
        Of the commit.
    back_s
        Seconds between the latest earlier time and this one.
    """

    seq: int
    time: str
    back_s: float


def clock_jumps(
    journal: JournalWithHistory | NoJournal, least_s: float = 1.0
) -> Iterator[ClockJump]:
    """Yield where the clock went back between two commits in a row, oldest first."""
    before = LONG_AGO
    for record in journal.records(0) if not isinstance(journal, NoJournal) else ():
        time = str(record.header.get("time") or "")
        if time:
            at = moment(time)
            if (before - at).total_seconds() >= least_s:
                yield ClockJump(record.seq, time, (before - at).total_seconds())
            before = at


def matcher(
    subject: object,
    predicate: object,
    value: object,
    graph: GraphName | None,
    graphs_shown: set[GraphName],
) -> Callable[[Quad], bool]:
    """Return a predicate for a pattern; ``None`` matches everything but the graphs in ``kept``."""

    def fits(quad: Quad) -> bool:
        return (
            (subject is None or quad.subject == subject)
            and (predicate is None or quad.predicate == predicate)
            and (value is None or quad.object == value)
            and (
                quad.graph_name == graph
                if graph is not None
                else quad.graph_name not in graphs_shown
            )
        )

    return fits
