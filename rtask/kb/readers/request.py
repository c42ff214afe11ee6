"""Queries as sent to readers, and the limits of readers."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from functools import lru_cache

__all__ = ["Question", "ReaderLimits"]


@dataclass(frozen=True)
class Question:
    """A query as it is sent to a reader.

    Parameters
    ----------
    default_graphs, named_graphs
        IRIs, or ``None`` to leave the choice to the text or the store.
    union
        Whether the default graph is the union of all graphs.
    media_type
        ``None`` for the type that is fastest to parse.
    max_rows, max_bytes
        Limits on the size of the answer.
    """

    text: str
    base: str | None = None
    default_graphs: tuple[str, ...] | None = None
    named_graphs: tuple[str, ...] | None = None
    media_type: str | None = None
    gzip: bool = False
    max_rows: int | None = None
    max_bytes: int | None = None
    union: bool = False

    def encode(self) -> bytes:
        """Return the message's payload: a line of JSON with the options, then the text."""
        options = _options(
            self.base,
            self.default_graphs,
            self.named_graphs,
            self.media_type,
            self.gzip,
            self.max_rows,
            self.max_bytes,
            self.union,
        )
        return options + self.text.encode("utf-8", "surrogatepass")


@lru_cache(maxsize=256)
def _options(
    base: str | None,
    default_graphs: tuple[str, ...] | None,
    named_graphs: tuple[str, ...] | None,
    media_type: str | None,
    gzip: bool,
    max_rows: int | None,
    max_bytes: int | None,
    union: bool,
) -> bytes:
    """Encode the options of a query; those of a client's queries rarely differ."""
    options = {
        "base": base,
        "default": default_graphs,
        "named": named_graphs,
        "type": media_type,
        "gzip": gzip,
        "rows": max_rows,
        "bytes": max_bytes,
        "union": union,
    }
    return json.dumps(options).encode() + b"\n"


@dataclass(frozen=True)
class ReaderLimits:
    """Number of readers and the limits of each.

    Parameters
    ----------
    count
        Number of queries that run at a time.
    reserved
        How many of these places are for quick queries (:func:`rtask.sparql.query_cost.is_quick`).
    updates
        Updates that are evaluated at a time.
    queue
        Queries that may wait for a reader.
    memory_bytes
        Memory that one query may use.
    replica_max
        Largest store, in quads, that is copied into memory; readers of larger ones open snapshots.
    """

    count: int = field(default_factory=lambda: 2 + (os.cpu_count() or 1))
    reserved: int = 2
    updates: int = 2
    queue: int = 64
    memory_bytes: int = 2 << 30
    replica_max: int = 1_000_000

    @property
    def long(self) -> int:
        """Number of queries that may run at a time, quick ones aside."""
        return max(1, self.count - self.reserved)
