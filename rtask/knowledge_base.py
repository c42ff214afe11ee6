"""The embedded knowledge base: one store, its named graphs, its blobs, its reasoner."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from pyoxigraph import RdfFormat

from rtask.kb.commit.commit import Commit
from rtask.kb.core import GraphCore
from rtask.rdf.terms import NamedNode
from rtask.sparql.place_service import PLACE_SERVICE, with_places

if TYPE_CHECKING:
    from rtask.asking.check.findings import Finding
    from rtask.interop.rdflib_dataset import KnowledgeDataset
    from rtask.loader.load import LoadReport
    from rtask.model.dynamic import Vocabulary
    from rtask.model.session import Session
    from rtask.tasks import Tasks
    from rtask.world import World

__all__ = ["KnowledgeBase"]


class KnowledgeBase(GraphCore):
    """A graph that robots share; made by :func:`rtask.open`.

    Reading is possible from any thread, writing is one commit at a time. Use it as a context
    manager, or call :meth:`close`.

    The methods defined here import what they need when they are called, so that opening a graph
    loads neither the object layer nor other libraries.

    Attributes
    ----------
    graphs
        Names of the graphs.
    blobs
        Byte strings that the graph refers to.
    folder
        Where the graph is stored; ``None`` in memory.
    store
        The quads; for reading only.
    """

    def load(
        self,
        source: Path | str | bytes | BinaryIO,
        format: RdfFormat | str | None = None,
        **options: Any,
    ) -> LoadReport:
        """Load a file, a folder, bytes or a known IRI; see :func:`rtask.loader.load.load`."""
        from rtask.loader.load import load

        return load(self, source, format=format, **options)

    def dump(
        self,
        path: Path | str | BinaryIO,
        format: RdfFormat | str | None = None,
        graphs: Iterable[NamedNode | str] | None = None,
        inferred: bool = False,
    ) -> int:
        """Write graphs to a file; see :func:`rtask.loader.export.dump`."""
        from rtask.loader.export import dump

        return dump(self, path, format, graphs, inferred)

    @property
    def world(self) -> World:
        """What is where, since when, and how sure; see :class:`rtask.world.World`."""
        from rtask.world import world_of

        return world_of(self)

    def _expand_services(self, text: str) -> str:
        text = super()._expand_services(text)
        return with_places(text, self.world.related) if PLACE_SERVICE in text else text

    @property
    def tasks(self) -> Tasks:
        """Plans for goals, from what robots can do; see :class:`rtask.tasks.Tasks`."""
        from rtask.tasks import Tasks

        return Tasks(self)

    def session(self, agent: str | None = None, **options: Any) -> Session:
        """Return a unit of work over Python objects; see :class:`rtask.model.Session`."""
        from rtask.model.session import Session

        return Session(self, agent, **options)

    def model(self, name: NamedNode | str) -> Vocabulary:
        """Return Python classes for a loaded ontology; see :func:`rtask.model.load_model`."""
        from rtask.model.dynamic import load_model

        return load_model(self, name)

    def rdflib(self, agent: str | None = None, *, writable: bool = False) -> KnowledgeDataset:
        """Return the graphs as an ``rdflib.Dataset``, whose default graph is their union.

        Parameters
        ----------
        agent
            Who writes.
        writable
            Collect changes, and commit them when the ``with`` block ends.
        """
        from rtask.interop.rdflib_dataset import KnowledgeDataset

        return KnowledgeDataset(self, agent, writable)

    def owlready(self, graphs: Iterable[NamedNode | str] | None = None) -> Any:
        """Return a fresh ``owlready2.World``; see :func:`rtask.interop.owlready.to_world`."""
        from rtask.interop.owlready import to_world

        return to_world(self, graphs)

    def check(self, text: str) -> list[Finding]:
        """Return the faults of a query that its answer would hide, certain ones first.

        Unknown terms, patterns that cannot match together, literals of another type, variables
        that connect nothing; each with its place and repairs. See :mod:`rtask.asking.check`.

        Raises
        ------
        QuerySyntaxError
            The text is no query; gives line and column.
        """
        from rtask.asking.check.checker import check

        return check(self, text)

    def update_from(
        self,
        world: Any,
        graph: NamedNode | str,
        agent: str | None = None,
        graphs: Iterable[NamedNode | str] | None = None,
    ) -> Commit | None:
        """Commit what changed in a world of :meth:`owlready`; ``graph`` takes it.

        See :func:`rtask.interop.owlready.update_from`.
        """
        from rtask.interop.owlready import update_from

        return update_from(self, world, graph, agent, graphs)
