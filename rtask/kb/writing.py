"""Methods that write: updates, transactions, bulk loads and access rights."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from pyoxigraph import Quad

from rtask.errors import UnsupportedError
from rtask.kb.commit.access import Access
from rtask.kb.commit.bulk import BulkLoad, TripleText, bulk_add
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.delta import UpdateDataset, prepare, run_update
from rtask.kb.commit.transaction import Transaction
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.updating import UpdateOrder, commit_update, needs_reader
from rtask.kb.searching import Searching
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import GraphName, NamedNode, iri
from rtask.sparql.untouched import why_untouched

__all__ = ["Writing"]

_EMPTYING = frozenset(("CLEAR", "DROP"))


class Writing(Searching):
    """Atomic commits, one at a time.

    Attributes
    ----------
    bulk_loads
        How often statements were stored outside of commits, which subscribers do not hear of.
    """

    bulk_loads: int = 0

    def access(self, agent: str | None = None, access: Access | None = None) -> Access:
        """Return the rights of a caller on this knowledge base.

        A named agent has a robot's rights unless ``access`` grants others. Without a name, the
        caller is the program that opened the knowledge base, which is an admin.
        """
        rights = access or (Access(agent, "robot", of_owner=True) if agent else Access())
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
        limits: UpdateLimits | None = None,
    ) -> Commit:
        """Run a SPARQL update as one commit.

        Parameters
        ----------
        agent, access
            The author: a name, which has a robot's rights, or rights assigned by a server.
        note
            Free text, stored in the provenance record.
        using, named
            Dataset of WHERE clauses whose own text names none.
        if_version
            Refuse unless the last commit has this number.
        limits
            Bounds for updates from untrusted callers: an update whose WHERE reads the store is
            evaluated in a separate process, which is stopped at these limits. With ``None`` it
            runs in this process, unbounded.

        Raises
        ------
        QuerySyntaxError
            The text does not parse; gives line and column.
        QueryTimeout, QueryTooExpensive, BusyError
            The update exceeds ``limits``, or too many such updates are waiting; nothing is stored.
        TooMuchFollowsError
            More follows from the change than it may cause; nothing is stored.
        ForbiddenError
            The caller may not write a graph, which the error names; nothing is stored.
        InconsistentError
            The change contradicts stored data or the ontology; nothing is stored.
        """
        reasoning = None if limits is None else limits.reasoning
        request = Request(
            self.access(agent, access), note, if_version=if_version, reasoning=reasoning
        )
        dataset = UpdateDataset(tuple(map(iri, using)), tuple(map(iri, named)), base)
        text = self._expand_services(text)
        if limits is not None and self.readers.evaluate_updates and needs_reader(text):
            order = UpdateOrder(
                text, request.access, dataset, limits, self._ontologies(), self.store.is_view
            )
            done = commit_update(order, request, self.readers, self._writer, lambda: self.seq)
            return self._with_remark(done, text, request.access, base)
        prepared = prepare(text, dataset, request.access.home())
        kinds = {operation.kind for operation in prepared.update.operations}
        self.check_change(
            prepared.added, prepared.removed, access=request.access, empties=bool(kinds & _EMPTYING)
        )
        request = replace(request, size=prepared.added + prepared.removed)
        done = self._writer.commit(
            lambda change: run_update(change, prepared, request.access, limits), request
        )
        return self._with_remark(done, text, request.access, base)

    @staticmethod
    def _with_remark(done: Commit, text: str, access: Access, base: str | None) -> Commit:
        if done.added or done.removed:
            return done
        return replace(done, remark=why_untouched(text, access.home(), base))

    def _ontologies(self) -> tuple[str, ...]:
        names = self.store.named_graphs()
        return tuple(
            graph.value
            for graph in names
            if isinstance(graph, NamedNode) and self.catalogue.is_ontology(graph)
        )

    def transaction(
        self,
        agent: str | None = None,
        note: str | None = None,
        *,
        access: Access | None = None,
        if_version: int | None = None,
    ) -> Transaction:
        """Return a context manager whose changes become one commit; see :meth:`update`."""
        request = Request(self.access(agent, access), note, if_version=if_version)
        return Transaction(self._writer, self.blobs, request)

    def check_change(
        self, added: int, removed: int = 0, *, access: Access, empties: bool = False
    ) -> None:
        """Refuse a change that is too large for its author before the writers' lock is taken.

        Parameters
        ----------
        added, removed
            Statements.
        empties
            Whether the author's own graph is emptied besides.

        Raises
        ------
        TooLargeError
            Naming the bound, and how to split the change.
        """
        if empties and not self.plain:  # the only graph of those who have a bound
            removed += self.catalogue.triple_count(access.home())
        self._writer.committer.check_size(added, removed, access)

    def commit_work(
        self,
        work: Callable[[Transaction], object],
        note: str | None = None,
        *,
        access: Access | None = None,
        if_version: int | None = None,
        size: int = 0,
    ) -> Commit:
        """Make a commit of what a function does in a transaction; see :meth:`update`.

        Unlike the block of :meth:`transaction`, the function can be called again, so that others
        write while it is found out whether too much follows from the change.

        Parameters
        ----------
        size
            How many statements the change is known to have.
        """
        request = Request(self.access(None, access), note, if_version=if_version, size=size)

        def make(change: Overlay) -> None:
            work(Transaction.of(change, self._writer, self.blobs, request))

        return self._writer.commit(make, request)

    def commit_block(self, request: Request) -> Transaction:
        """Return a transaction with all conditions of a request."""
        return Transaction(self._writer, self.blobs, request)

    def write_queue(self) -> tuple[int, float]:
        """Return how many threads wait to write, and for how long the first has waited (s)."""
        return self._writer.queue()

    def stop_deriving(self) -> None:
        """End what takes long of the writes under way, e.g. before closing; they are refused.

        Commits of few statements from which little follows are still stored. Others, and updates
        that readers evaluate, raise `BusyError`.
        """
        self._writer.stop_deriving()
        self.readers.stop_updates()

    def bulk_add(
        self, quads: Iterable[Quad] | TripleText, graph: GraphName, request: Request
    ) -> BulkLoad:
        """Add more statements than a commit may hold.

        The statements are stored in one atomic step, followed by a commit of the statements
        derived from them.
        """
        if self._files.is_branch:
            raise UnsupportedError("a branch takes statements in commits only")
        try:
            return bulk_add(self._writer, self._files, self._inference, quads, graph, request)
        finally:
            self.bulk_loads += 1
            self.readers.invalidate()
            self.index.invalidate()
