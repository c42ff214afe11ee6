"""The writing side of a knowledge base: rights, updates, transactions, loads."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import Quad

from rtask.kb.commit.access import Access
from rtask.kb.commit.bulk import TripleText, bulk_add
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.delta import UpdateDataset, run_update
from rtask.kb.commit.transaction import Transaction
from rtask.kb.searching import Searching
from rtask.rdf.terms import Graph, NamedNode, iri

__all__ = ["Writing"]


class Writing(Searching):
    """One commit at a time, each wholly or not at all."""

    def access(self, agent: str | None = None, access: Access | None = None) -> Access:
        """Return the rights of a caller on this knowledge base.

        A named agent has a robot's rights unless ``access`` says more; nobody in particular is
        the program that opened the knowledge base, an admin.
        """
        rights = access or (Access(agent, "robot") if agent else Access())
        return rights.bind(self.graphs, self.catalogue.is_ontology, self.plain)

    def may_write(self, agent: str | None, graph: NamedNode | str) -> bool:
        """Whether an agent may change a graph."""
        return self.access(agent).may_write(iri(graph))

    def update(
        self,
        text: str,
        agent: str | None = None,
        note: str | None = None,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        *,
        access: Access | None = None,
        base: str | None = None,
        if_version: int | None = None,
    ) -> Commit:
        """Run a SPARQL update as one commit.

        Parameters
        ----------
        agent, access
            Who writes: a name (a robot's rights), or rights given by a server.
        note
            Kept with the provenance.
        using, named
            The dataset of WHERE, where the text names none.
        if_version
            Refuse unless the last commit has this number.

        Raises
        ------
        QuerySyntaxError
            With line and column.
        ForbiddenError
            Naming the graph; nothing is stored.
        InconsistentError
            The change contradicts what is there; nothing is stored.
        """
        request = Request(self.access(agent, access), note, if_version=if_version)
        dataset = UpdateDataset(tuple(map(iri, using)), tuple(map(iri, named)), base)
        text = self._looked_up(text)
        overlay = self._writer.begin()
        try:
            run_update(overlay, text, request.access, dataset)
        except BaseException:
            self._writer.cancel()
            raise
        return self._writer.finish(overlay, request)

    def transaction(
        self,
        agent: str | None = None,
        note: str | None = None,
        *,
        access: Access | None = None,
        if_version: int | None = None,
    ) -> Transaction:
        """Return a context manager whose changes become one commit; arguments as in update."""
        request = Request(self.access(agent, access), note, if_version=if_version)
        return Transaction(self._writer, self.blobs, request)

    def commit_block(self, request: Request) -> Transaction:
        """Return a transaction for rooms that set more than agent and note."""
        return Transaction(self._writer, self.blobs, request)

    def bulk_add(self, quads: Iterable[Quad] | TripleText, graph: Graph, request: Request) -> int:
        """Add more statements than a commit may hold; return how many were derived.

        One atomic step for the statements, then a commit for what follows from them.
        """
        try:
            return bulk_add(self._writer, self._files, self._inference, quads, graph, request)
        finally:
            self.readers.invalidate()
            self.index.invalidate()
