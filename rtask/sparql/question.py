"""A query as a reader gets it."""

from __future__ import annotations

import json
from dataclasses import dataclass

__all__ = ["Question"]


@dataclass(frozen=True)
class Question:
    """A query as a reader gets it.

    Parameters
    ----------
    default_graphs, named_graphs
        IRIs, or ``None`` for what the text or the store says.
    union
        Whether the default graph is the union of all.
    media_type
        ``None`` for the one that is read fastest here.
    max_rows, max_bytes
        Where the answer is broken off.
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
        """Return the message's payload."""
        return json.dumps(
            {
                "text": self.text,
                "base": self.base,
                "default": self.default_graphs,
                "named": self.named_graphs,
                "type": self.media_type,
                "gzip": self.gzip,
                "rows": self.max_rows,
                "bytes": self.max_bytes,
                "union": self.union,
            }
        ).encode()
