"""The method that undoes a commit by its inverse."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import Quad

import ontology
from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change, Commit, Request
from rtask.kb.writing import Writing
from rtask.rdf.terms import RDF_TYPE, GraphName, NamedNode

__all__ = ["BUNDLED", "Reverting"]

BUNDLED = "bundled ontology"
"""Note of the commits that load what comes with RTASK."""

_ONTOLOGY = NamedNode(ontology.PREFIXES["owl"] + "Ontology")
_UNLIMITED = 1 << 62
_CAUSE_MS = 10_000.0


class Reverting(Writing):
    """Undoing of commits."""

    def revert(
        self,
        seq: int,
        *,
        agent: str | None = None,
        access: Access | None = None,
        note: str | None = None,
    ) -> Commit:
        """Undo a commit: withdraw what it added, and assert what it removed.

        What follows is derived anew. The hidden causes that the engine keeps are left alone; it
        restates them from all attempts.

        Parameters
        ----------
        agent, access
            The author, as in :meth:`update`.

        Raises
        ------
        UnknownTermError
            There is no such commit, or none that changed asserted statements.
        UsageError
            It loaded the ontology that comes with RTASK.
        ConflictError
            It is undone already, a statement that it added has been withdrawn since, or later
            statements refer to what it introduced.
        ForbiddenError
            The caller may not write a graph that it changed.
        MissingBlobError
            The bytes that a statement to be restored names were deleted.
        """
        change = self._change(seq)
        if change.note == BUNDLED:
            raise UsageError(f"commit {seq} loaded the ontology that comes with RTASK; it stays")
        added, removed = self._own(change.added), self._own(change.removed)
        if not (added or removed):
            raise UnknownTermError(f"commit {seq} changed no statement that could be restored")
        gone = [quad for quad in added if quad not in self.store]
        restored = [quad for quad in removed if quad in self.store]
        # Nothing of it is left, and all that it removed is back: undone, whoever did it.
        if len(gone) + len(restored) == len(added) + len(removed):
            raise ConflictError(f"commit {seq} is already undone", commit=seq)
        if gone:
            raise ConflictError(
                f"{len(gone)} statements that commit {seq} wrote have changed since, "
                f"e.g. {gone[0]}; undo those changes first",
                commit=seq,
            )
        self._refuse_built_on(seq, added, removed)
        request = Request(
            self.access(agent, access),
            note=note or f"undo commit {seq}",
            kinds=self._kinds(added, removed),
            max_quads=_UNLIMITED,
            cause_ms=_CAUSE_MS,
            moves_records=True,
        )
        with self.commit_block(request) as tx:
            tx.remove_quads(added)
            tx.add_quads(removed)
        return tx.commit

    def _refuse_built_on(self, seq: int, added: list[Quad], removed: list[Quad]) -> None:
        """Refuse to withdraw the types of what statements of later commits refer to."""
        withdrawn = set(added)
        # A type that was exchanged comes back with what was removed.
        typed_again = {quad.subject for quad in removed if quad.predicate == RDF_TYPE}
        typed = {quad.subject for quad in added if quad.predicate == RDF_TYPE}
        for node in typed - typed_again:
            types = self.store.quads_for_pattern(node, RDF_TYPE, None, None)
            if any(quad not in withdrawn and self._counts(quad) for quad in types):
                continue
            for quad in self.store.quads_for_pattern(None, None, node, None):
                if quad not in withdrawn and self._counts(quad):
                    raise ConflictError(
                        f"later statements refer to {node}, which commit {seq} introduced, "
                        f"e.g. {quad}; undo those first",
                        commit=seq,
                    )

    def _counts(self, quad: Quad) -> bool:
        """Whether a statement is in a graph that somebody writes, and no union or record."""
        graph = quad.graph_name
        return isinstance(graph, NamedNode) and not self.graphs.is_system(graph)

    def _change(self, seq: int) -> Change:
        if not 0 < seq <= self.feed.last_seq:
            raise UnknownTermError(f"there is no commit {seq}; `rtask history` lists them")
        self.feed.require_retained(seq - 1)
        for change in self.feed.changes(seq - 1, seq):
            if change.commit.seq == seq:
                return change
        raise UnknownTermError(f"there is no commit {seq}; `rtask history` lists them")

    def _own(self, quads: Iterable[Quad]) -> list[Quad]:
        # Hidden causes follow from the attempts: they are nobody's statement.
        return [quad for quad in quads if quad.graph_name != self.graphs.causes]

    def _kinds(self, *parts: Iterable[Quad]) -> dict[GraphName, str]:
        """Return the class of the graphs that are ontologies, before the commit or now."""
        declared = {
            quad.graph_name
            for quads in parts
            for quad in quads
            if quad.predicate == RDF_TYPE and quad.object == _ONTOLOGY
        }
        graphs = {quad.graph_name for quads in parts for quad in quads}
        # Now, too: undoing may make a graph an ontology again, or end that it is one.
        present = {graph for graph in graphs if self.catalogue.is_ontology(graph)}
        return dict.fromkeys(declared | present, "OntologyGraph")
