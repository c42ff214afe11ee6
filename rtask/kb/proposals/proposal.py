"""A proposed change: its statements, its author and what became of it."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from pyoxigraph import Quad, RdfFormat, parse

__all__ = ["STATES", "Proposal", "State"]

State: TypeAlias = Literal["proposed", "adopted", "refused", "expired"]
STATES: tuple[State, ...] = ("proposed", "adopted", "refused", "expired")


@dataclass(frozen=True)
class Proposal:
    """A change without effect until it is adopted.

    Parameters
    ----------
    number
        Counts from 1 in each knowledge base.
    author
        Name of the robot or person; empty for a caller without one.
    added, removed
        Statements to assert and to withdraw, each with its graph, as N-Quads.
    rests_on
        Number of the last commit when it was made.
    reason
        What it is for, in the author's words or those of the refusal that led to it.
    state
        ``proposed`` until it is ``adopted`` or ``refused``, or has ``expired``.
    made, decided
        UTC; the second is ``None`` while it is open.
    decided_by, remark
        Who decided, and why.
    commit
        Number of the commit that adopted it.
    """

    number: int
    author: str
    added: str
    removed: str
    rests_on: int
    reason: str
    state: State
    made: dt.datetime
    decided: dt.datetime | None = None
    decided_by: str = ""
    remark: str = ""
    commit: int | None = None

    @property
    def is_open(self) -> bool:
        """Whether nobody has decided and it has not expired."""
        return self.state == "proposed"

    def quads(self) -> tuple[list[Quad], list[Quad]]:
        """Return the statements to assert and to withdraw."""
        return _read(self.added), _read(self.removed)

    def to_dict(self) -> dict[str, Any]:
        """Return the proposal as JSON-able values, statements as lines of N-Quads."""
        return {
            "number": self.number,
            "author": self.author,
            "state": self.state,
            "added": self.added.splitlines(),
            "removed": self.removed.splitlines(),
            "rests_on": self.rests_on,
            "reason": self.reason,
            "made": self.made.isoformat(),
            "decided": None if self.decided is None else self.decided.isoformat(),
            "decided_by": self.decided_by,
            "remark": self.remark,
            "commit": self.commit,
        }


def _read(text: str) -> list[Quad]:
    return [
        Quad(quad.subject, quad.predicate, quad.object, quad.graph_name)
        for quad in parse(text.encode(), format=RdfFormat.N_QUADS)
    ]
