"""Pending changes whose look-ups wait, so that one query answers them all."""

from __future__ import annotations

from pyoxigraph import NamedNode, Quad

from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import GraphName
from rtask.remote.store import RemoteStore

__all__ = ["PendingChange"]


class PendingChange(Overlay):
    """Changes that are written down first and compared with the store when somebody asks."""

    def __init__(self, store: GraphStore) -> None:
        assert isinstance(store, RemoteStore)
        self._dialect = store.dialect
        self._log: list[tuple[bool, Quad]] = []
        super().__init__(store)

    def add(self, quad: Quad) -> None:
        """Add a quad if absent, and create its graph."""
        self._log.append((True, self._dialect.canonical_quad(quad)))

    def remove(self, quad: Quad) -> None:
        """Remove a quad if present."""
        self._log.append((False, self._dialect.canonical_quad(quad)))

    def _resolve(self) -> None:
        log, self._log = self._log, []
        if not log:
            return
        assert isinstance(self.store, RemoteStore)
        graphs = (quad.graph_name for _, quad in log)
        named = {graph for graph in graphs if isinstance(graph, NamedNode)}
        # The catalogue's statements about the graphs change, too.
        self.store.prefetch([*(quad.subject for _, quad in log), *named, *self.store.catalogued])
        for adds, quad in log:
            if adds:
                super().add(quad)
            else:
                super().remove(quad)

    @property
    def removed(self) -> dict[Quad, None]:
        """Quads of the store that the change removes."""
        self._resolve()
        return self._removed

    @removed.setter
    def removed(self, quads: dict[Quad, None]) -> None:
        self._removed = quads

    @property
    def added(self) -> dict[Quad, None]:
        """Quads that the change adds."""
        self._resolve()
        return self._added

    @added.setter
    def added(self, quads: dict[Quad, None]) -> None:
        self._added = quads

    @property
    def created(self) -> dict[GraphName, None]:
        """Graphs that the change creates."""
        self._resolve()
        return self._created

    @created.setter
    def created(self, graphs: dict[GraphName, None]) -> None:
        self._created = graphs

    @property
    def dropped(self) -> dict[GraphName, None]:
        """Graphs that the change removes."""
        self._resolve()
        return self._dropped

    @dropped.setter
    def dropped(self, graphs: dict[GraphName, None]) -> None:
        self._dropped = graphs
