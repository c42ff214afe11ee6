"""The journal of a knowledge base on a SPARQL server: a record beside each commit, in the store."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from rtask.kb.durability.journal import CommitRecord, Record, body_of, encode
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.writes import Writes
from rtask.remote.head import HeadGraph
from rtask.remote.store import RemoteStore

__all__ = ["RemoteJournal"]


class RemoteJournal:
    """Records that are stored in the same step as their commits.

    The commits' own notes are left out of the records: the store has them anyway.
    """

    def __init__(self, store: RemoteStore, graphs: Graphs) -> None:
        self._store = store
        self._records = HeadGraph(store.endpoints, store.dialect)
        self._left_out = (graphs.meta, graphs.provenance)

    def append(self, record: CommitRecord, change: Writes) -> None:
        """Give the store the record of the commit that it is about to store."""
        removed, added = (
            [quad for quad in quads if quad.graph_name not in self._left_out]
            for quads in (change.removed, change.added)
        )
        self._store.record = encode(record.header(), body_of(removed, added)).decode()

    def withdraw(self) -> None:
        """Forget the record: its commit was not stored."""
        self._store.record = None

    def sync(self, seq: int) -> None:
        """Do nothing: the server has acknowledged the commit with its record."""

    def records(self, since: int = 0) -> Iterator[Record]:
        """Yield the records of commits after ``since``, oldest first."""
        for _, text in self._records.records(since, self._store.head.seq):
            head, _, body = text.partition("\n")
            yield Record(json.loads(head), body.encode())

    def place_of(self, seq: int) -> tuple[str, int, list[Any]] | None:
        """Return a commit's number, and what tells it from another one of the same number.

        Records of very large commits are not kept; this is.
        """
        token = self._records.token(seq)
        return None if token is None else ("", seq, [seq, token, None])

    def records_from(self, _: str, start: int) -> Iterator[Record]:
        """Yield what tells a commit from others, and the records of those after it."""
        token = self._records.token(start)
        if token is not None:
            yield Record({"seq": start, "time": token}, b"")
        yield from self.records(start)

    def oldest(self) -> int | None:
        """Return the number of the oldest commit with a record."""
        return 1 if self._store.head.seq else None

    def close(self) -> None:
        """Do nothing."""
