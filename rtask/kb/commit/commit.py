"""Values of the commit pipeline: who asks for a write, what was stored, what subscribers hear."""

from __future__ import annotations

import datetime as dt
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from pyoxigraph import Quad

from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import OF_ROBOTS, ReasoningLimits
from rtask.kb.commit.foreign.supports import Support
from rtask.kb.commit.inference import CAUSE_BUDGET_MS, Derivation
from rtask.kb.commit.validation import Violation
from rtask.kb.durability.blobs import Blob
from rtask.rdf.terms import GraphName, NamedNode

__all__ = ["MAX_EMPTIED", "MAX_QUADS", "Change", "Commit", "RecentChanges", "Request"]

_REMEMBERED = 1_000
MAX_QUADS = 200_000
MAX_EMPTIED = 2_000_000
"""Statements that a commit may remove by emptying whole graphs."""


@dataclass(frozen=True)
class Commit:
    """Result of a write.

    Parameters
    ----------
    seq
        Number of the commit, or of the previous one if nothing changed.
    added, removed
        Numbers of asserted statements added and removed.
    derived
        Number of statements that the reasoner added to the inferred graph.
    time
        UTC.
    activity
        The ``rt:WriteActivity``; ``None`` if nothing changed or no provenance is recorded.
    quarantined
        Number of contradictory statements moved to quarantine.
    warnings
        Violations that validation reported without rejecting the commit.
    shapes
        The SHACL shapes that validation applied to what changed; empty without validation.
    withdrawn
        Number of statements that the reasoner removed from the inferred graph.
    remark
        Why an update may have had no effect; ``None`` otherwise.
    """

    seq: int
    added: int
    removed: int
    derived: int
    time: dt.datetime
    activity: NamedNode | None
    quarantined: int = 0
    warnings: tuple[Violation, ...] = ()
    withdrawn: int = 0
    remark: str | None = None
    shapes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Change:
    """A commit as delivered to subscribers, with the exact statements."""

    commit: Commit
    agent: str | None
    note: str | None
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]
    inferred_added: Collection[Quad]
    inferred_removed: Collection[Quad]

    @property
    def graphs(self) -> frozenset[GraphName]:
        """The asserted graphs that changed."""
        return frozenset(quad.graph_name for quad in (*self.added, *self.removed))


class RecentChanges:
    """Graphs changed by each of the last commits; used while nobody writes.

    Commits that were not noted, such as those of another process, count as changes of all graphs.
    """

    def __init__(self) -> None:
        self._changes: deque[tuple[int, frozenset[GraphName]]] = deque(maxlen=_REMEMBERED)

    def note(self, change: Change) -> None:
        """Take note of a commit that was stored."""
        self._changes.append((change.commit.seq, change.graphs))

    def left_alone(self, graphs: Iterable[GraphName], since: int, until: int) -> bool:
        """Whether no commit after one, up to another, changed any of some asserted graphs.

        >>> RecentChanges().left_alone([], 3, 3), RecentChanges().left_alone([], 3, 4)
        (True, False)
        """
        asked, number = frozenset(graphs), until
        for seq, changed in reversed(self._changes):
            # A gap means that a commit is no longer remembered: then nothing is known of what it
            # changed.
            if number == since or seq != number or not changed.isdisjoint(asked):
                break
            number -= 1
        return number == since


@dataclass(frozen=True)
class Request:
    """Author and conditions of a commit.

    Parameters
    ----------
    kinds
        Classes of graphs whose class cannot be told from their IRI.
    sources
        The document that a graph was loaded from.
    recount
        Graphs that changed outside a commit; their triples are counted again.
    if_version
        Refuse unless the last commit has this number.
    check_blobs
        Refuse statements that name blobs missing from this knowledge base.
    max_quads
        Refuse to add, or to remove, more statements than this; graphs that are emptied whole may
        hold up to :data:`MAX_EMPTIED`.
    trusted
        Skip the check of rights; for derived data that the knowledge base itself writes.
    strict
        Refuse contradictory statements even where the policy is to quarantine them.
    cause_ms
        How long to look for the causes of a contradiction, in milliseconds.
    reasoning
        Bounds on what may follow; those of robots where none are given and the author is no
        admin.
    is_repeatable
        Whether the author can make the change again, so that a long derivation is first tried
        aside: :class:`LongDerivationError` says so.
    trial
        The derivation that was tried aside.
    supports
        What others' statements about the author's names were found to stand in the way of.
    size
        How many statements the change is known to have before it is made; large ones let waiting
        small ones go first.
    moves_records
        Whether the change may touch the quarantine, which only the knowledge base writes.
    permitted
        Statements of other graphs that the author may change in this commit, because the operation
        that it asked for decides on them; nothing else there.
    """

    access: Access
    note: str | None = None
    kinds: Mapping[GraphName, str] = field(default_factory=dict)
    sources: Mapping[GraphName, Blob] = field(default_factory=dict)
    recount: frozenset[GraphName] = frozenset()
    if_version: int | None = None
    check_blobs: bool = True
    trusted: bool = False
    strict: bool = False
    max_quads: int = MAX_QUADS
    cause_ms: float = CAUSE_BUDGET_MS
    reasoning: ReasoningLimits | None = None
    is_repeatable: bool = False
    trial: Derivation | None = None
    supports: tuple[Support, ...] = ()
    size: int = 0
    moves_records: bool = False
    permitted: frozenset[Quad] = frozenset()
    started: dt.datetime = field(default_factory=lambda: dt.datetime.now(dt.UTC))

    @property
    def reasoning_limits(self) -> ReasoningLimits | None:
        """Bounds on what may follow; ``None`` for those of the closure."""
        if self.reasoning is None and self.access.role != "admin":
            return OF_ROBOTS
        return self.reasoning
