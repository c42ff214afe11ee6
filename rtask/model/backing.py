"""Interface of the object layer to a knowledge base, in this process or on a server."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import islice
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from pyoxigraph import Quad

from rtask.kb.commit.commit import Change, Commit
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import DEFAULT, GraphName, NamedNode, Subject, Term, Value
from rtask.sparql.results import Solutions, Triples

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Backed", "Backing", "Local", "Statements", "Touched", "Work", "Writes", "backing_of"]

Touched: TypeAlias = "Collection[str] | None"
"""IRIs of the subjects that commits concerned; ``None`` if it is not known which."""


class Statements(Protocol):
    """Statements by pattern."""

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: Any = None,
    ) -> list[Quad]:
        """Return the statements that match; ``None`` matches everything."""


class Writes(Protocol):
    """Changes that become one commit."""

    def add(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Assert a statement."""

    def remove(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Withdraw a statement from one graph."""


Work: TypeAlias = "Callable[[Writes, Statements], None]"


class Backing(Protocol):
    """Operations that a knowledge base in this process and one on a server do differently."""

    def home(self, agent: str | None) -> GraphName:
        """Return the graph that an agent writes."""

    def derives(self) -> bool:
        """Whether the graph contains derived statements."""

    def about(self, subject: NamedNode, most: int) -> Iterable[tuple[str, Term]]:
        """Yield predicates and values of a subject, derived ones included, ``most`` at most."""

    def on_touched(self, listener: Callable[[Touched], None]) -> Callable[[], None]:
        """Call ``listener`` with the subjects of commits; return a function that ends this."""

    def write(
        self, work: Work, subjects: Collection[str], agent: str | None, note: str | None
    ) -> Commit:
        """Commit what ``work`` changes; nobody else commits between its reads and the commit.

        Parameters
        ----------
        work
            Is called with what takes the changes and with the statements that hold; again, with
            others, if somebody else was faster.
        subjects
            IRIs about which it will ask.
        """


class Backed(Statements, Protocol):
    """A knowledge base elsewhere that has Python objects."""

    @property
    def base(self) -> str:
        """IRI that starts every instance."""

    @property
    def graphs(self) -> Graphs:
        """Names of the graphs."""

    def query(self, text: str, *, inferred: bool = True) -> Solutions | bool | Triples:
        """Evaluate a SPARQL query."""

    def backing(self) -> Backing:
        """Return how it reads and writes objects."""


def backing_of(kb: GraphCore | Backed) -> Backing:
    """Return how a knowledge base reads and writes objects."""
    from rtask.kb.core import GraphCore

    return Local(kb) if isinstance(kb, GraphCore) else kb.backing()


class Local:
    """A knowledge base in this process."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb

    def home(self, agent: str | None) -> GraphName:
        """Return the graph that an agent writes."""
        return self._kb.access(agent).home()

    def derives(self) -> bool:
        """Whether there are derived statements: now, or when the graph was written."""
        kb = self._kb
        inferred = kb.store.quads_for_pattern(None, None, None, kb.graphs.inferred)
        return kb.reasons or next(iter(inferred), None) is not None

    def about(self, subject: NamedNode, most: int) -> Iterable[tuple[str, Term]]:
        """Yield predicates and values of a subject from the store."""
        quads = self._kb.store.quads_for_pattern(subject, None, None, DEFAULT)
        return ((quad.predicate.value, quad.object) for quad in islice(quads, most))

    def on_touched(self, listener: Callable[[Touched], None]) -> Callable[[], None]:
        """Call ``listener`` in the writer's thread, after each commit."""
        return self._kb.on_commit(lambda change: listener(_subjects(change)))

    def write(
        self, work: Work, subjects: Collection[str], agent: str | None, note: str | None
    ) -> Commit:
        """Commit what ``work`` changes; the writer's lock is held meanwhile."""
        with self._kb.transaction(agent=agent, note=note) as tx:
            work(tx, self._kb)
        return tx.commit


def _subjects(change: Change) -> set[str]:
    quads = (*change.added, *change.removed, *change.inferred_added, *change.inferred_removed)
    return {quad.subject.value for quad in quads if isinstance(quad.subject, NamedNode)}
