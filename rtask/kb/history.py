"""Who wrote or withdrew what, and when: read from the journal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pyoxigraph import Quad

from rtask.errors import UnsupportedError
from rtask.kb.journal import JournalFile, Record
from rtask.kb.terms import Graph

__all__ = ["HistoryEntry", "history"]


@dataclass(frozen=True)
class HistoryEntry:
    """What one commit did to the statements that were asked for.

    Parameters
    ----------
    time
        ISO 8601, UTC.
    agent
        Name of the writer, ``None`` for the program itself.
    """

    seq: int
    time: str
    agent: str | None
    note: str | None
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]


def history(
    journal: object,
    matches: Callable[[Quad], bool],
    agent: str | None = None,
    since: int = 0,
) -> Iterator[HistoryEntry]:
    """Yield the commits that touched matching statements, oldest first.

    Raises
    ------
    UnsupportedError
        For a store in memory, which keeps no journal.
    """
    if not isinstance(journal, JournalFile):
        raise UnsupportedError("this store keeps no journal; its provenance graph can be queried")
    for record in journal.records(since):
        if agent is not None and record.header.get("agent") != agent:
            continue
        entry = _entry(record, matches)
        if entry.added or entry.removed:
            yield entry


def _entry(record: Record, matches: Callable[[Quad], bool]) -> HistoryEntry:
    return HistoryEntry(
        record.seq,
        str(record.header.get("time", "")),
        record.header.get("agent"),
        record.header.get("note"),
        tuple(filter(matches, record.added())),
        tuple(filter(matches, record.removed())),
    )


def matcher(
    subject: object, predicate: object, value: object, graph: Graph | None, kept: set[Graph]
) -> Callable[[Quad], bool]:
    """Return a test for a pattern; ``None`` fits everything but the graphs in ``kept``."""

    def fits(quad: Quad) -> bool:
        return (
            (subject is None or quad.subject == subject)
            and (predicate is None or quad.predicate == predicate)
            and (value is None or quad.object == value)
            and (quad.graph_name == graph if graph is not None else quad.graph_name not in kept)
        )

    return fits
