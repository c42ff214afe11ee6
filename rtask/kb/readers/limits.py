"""How many readers there are, and what a query may take."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

__all__ = ["ReaderLimits"]


@dataclass(frozen=True)
class ReaderLimits:
    """How many readers there are and what they may take.

    Parameters
    ----------
    count
        Queries that run at a time.
    reserved
        How many of these places are for point queries, see :mod:`rtask.sparql.query_cost`.
    updates
        Updates that are evaluated at a time.
    queue
        Queries that may wait for a reader.
    memory_bytes
        What one query may take.
    replica_max
        Largest store, in quads, that is copied into memory; readers of larger ones open snapshots.
    """

    count: int = field(default_factory=lambda: 2 + (os.cpu_count() or 1))
    reserved: int = 2
    updates: int = 2
    queue: int = 64
    memory_bytes: int = 2 << 30
    replica_max: int = 1_000_000
