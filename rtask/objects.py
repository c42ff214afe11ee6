"""The graph as objects, and as other libraries see it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

from rtask.kb.base import Parts
from rtask.kb.commit.commit import Commit
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.interop.rdflib_dataset import KnowledgeDataset
    from rtask.knowledge_base import KnowledgeBase
    from rtask.model.dynamic import Vocabulary
    from rtask.model.session import Session

__all__ = ["Objects"]


class Objects(Parts):
    """Sessions, classes of any ontology, rdflib and owlready2."""

    def session(self, agent: str | None = None, **options: Any) -> Session:
        """Return a unit of work over Python objects; see :class:`rtask.model.Session`."""
        from rtask.model.session import Session

        return Session(cast("KnowledgeBase", self), agent, **options)

    def model(self, name: NamedNode | str) -> Vocabulary:
        """Return Python classes for a loaded ontology; see :func:`rtask.model.load_model`."""
        from rtask.model.dynamic import load_model

        return load_model(cast("KnowledgeBase", self), name)

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

        return KnowledgeDataset(cast("KnowledgeBase", self), agent, writable)

    def owlready(self, graphs: Iterable[NamedNode | str] | None = None) -> Any:
        """Return a fresh ``owlready2.World``; see :func:`rtask.interop.owlready.to_world`."""
        from rtask.interop.owlready import to_world

        return to_world(cast("KnowledgeBase", self), graphs)

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

        return update_from(cast("KnowledgeBase", self), world, graph, agent, graphs)
