"""Bounds of one update, and the meter that holds it to them while templates are filled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from pyoxigraph import Quad

from rtask.errors import QueryTooExpensive
from rtask.kb.commit.budget import ReasoningLimits
from rtask.rdf.bounds import MAX_LITERAL, characters, refuse_long_names

__all__ = ["Meter", "UpdateLimits"]


@dataclass(frozen=True)
class UpdateLimits:
    """Bounds of one update request, for all its operations together.

    Parameters
    ----------
    seconds
        Time within which the change must be computed.
    memory_bytes
        Memory in addition to the copy of the store.
    literal_bytes
        Length of one literal made by a template, in characters; in UTF-8 at most four times that.
    statements, delta_bytes
        Size of the change, counted as templates are filled.
    solutions
        Number of solutions of one WHERE.
    reasoning
        Bounds on what may follow from the change; those of its author's role where none are given.
    """

    seconds: float
    memory_bytes: int = 512 << 20
    literal_bytes: int = MAX_LITERAL
    statements: int = 200_000
    delta_bytes: int = 64 << 20
    solutions: int = 1_000_000
    reasoning: ReasoningLimits | None = None


class Meter:
    """Counts the statements that templates produce, before they are kept."""

    def __init__(self, limits: UpdateLimits | None = None) -> None:
        self._limits = limits
        self._statements = self._bytes = 0

    def solutions(self, rows: Iterable[Any]) -> Iterator[Any]:
        """Yield the solutions of a WHERE clause, up to the limit."""
        limits = self._limits
        for number, row in enumerate(rows):
            if limits is not None and number >= limits.solutions:
                raise _beyond("solutions", limits.solutions, "solutions of one WHERE")
            yield row

    def quads(self, quads: Iterable[Quad], stored: bool = False) -> Iterator[Quad]:
        """Yield statements, up to the limits of number and length.

        Parameters
        ----------
        quads
            Statements that are added or removed.
        stored
            Whether they are in the store already: a long literal may be removed or copied.
        """
        limits = self._limits
        if limits is None:
            yield from quads
            return
        for quad in quads:
            size = characters(quad.object)
            if size > limits.literal_bytes and not stored:
                raise _beyond("literal", limits.literal_bytes, "characters in one literal")
            if not stored:
                refuse_long_names(quad)
            self._statements += 1
            # A prefix of 16 kB makes a long IRI of each of a hundred thousand short names.
            self._bytes += len(str(quad))
            if self._statements > limits.statements:
                raise _beyond("statements", limits.statements, "statements")
            if self._bytes > limits.delta_bytes:
                raise _beyond("bytes", limits.delta_bytes, "bytes of statements")
            yield quad


def _beyond(limit: str, allowed: int, what: str) -> QueryTooExpensive:
    return QueryTooExpensive(
        f"the update makes more than {allowed} {what}; nothing was stored; split the update",
        limit=limit,
        allowed=allowed,
    )
