"""The embedded knowledge base: one store, its named graphs, its blobs, its reasoner."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

from pyoxigraph import Quad, RdfFormat

from rtask.errors import UnsupportedError, UsageError
from rtask.kb import query as queries
from rtask.kb.access import Access
from rtask.kb.bulk import bulk_add, complete, finish_bulk
from rtask.kb.catalogue import Catalogue
from rtask.kb.commit import Change, Commit, Request
from rtask.kb.delta import UpdateDataset, run_update
from rtask.kb.folder import Files
from rtask.kb.history import HistoryEntry, history, matcher
from rtask.kb.inference import Inference
from rtask.kb.query import Bindings, QueryDataset
from rtask.kb.results import Solutions, Triples
from rtask.kb.terms import Graph, NamedNode, Subject, Value, iri, object_term, stored, subject_term
from rtask.kb.transaction import Transaction
from rtask.kb.writer import Writer

if TYPE_CHECKING:
    from rtask.kb.verify import Finding
    from rtask.loader.load import LoadReport
    from rtask.model.session import Session

__all__ = ["KnowledgeBase"]


class KnowledgeBase:
    """A graph that robots share; made by :func:`rtask.open`.

    Reading is possible from any thread, writing is one commit at a time. Use it as a context
    manager, or call :meth:`close`.

    Attributes
    ----------
    graphs
        Names of the graphs.
    blobs
        Byte strings that the graph names.
    folder
        Where it lives; ``None`` in memory.
    store
        The quads; for reading only.
    """

    def __init__(
        self,
        files: Files,
        catalogue: Catalogue,
        inference: Inference | None,
        writer: Writer,
    ) -> None:
        self.settings = files.settings
        self.graphs = catalogue.graphs
        self.store = files.store
        self.blobs = files.blobs
        self.folder = files.folder
        self.catalogue = catalogue
        self._files = files
        self._inference = inference
        self._writer = writer

    @property
    def base(self) -> str:
        """IRI that starts every instance and graph."""
        return self.settings.base

    @property
    def plain(self) -> bool:
        """Whether this is a bare SPARQL dataset: no union, inference or provenance."""
        return self.settings.plain

    @property
    def seq(self) -> int:
        """Number of the last commit."""
        return self._writer.committer.last_seq

    # Reading

    def query(
        self,
        text: str,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
    ) -> Solutions | bool | Triples:
        """Evaluate a SPARQL query.

        Parameters
        ----------
        inferred
            Whether derived statements are seen.
        default_graphs, named_graphs
            The dataset; both together replace what ``FROM`` in the text says. Without either,
            triple patterns see the union of all graphs.
        bindings
            Values of variables: a term or Python value, or a list of them.
        base
            IRI against which relative IRIs are resolved.

        Raises
        ------
        QuerySyntaxError
            With line and column.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = queries.bind(text, bindings or {})
        return queries.run(self.store, self.graphs, self.plain, text, dataset)

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT; the same as :meth:`query`, typed for rows."""
        answer = self.query(text, **options)
        if not isinstance(answer, Solutions):
            raise UnsupportedError("select() is for SELECT queries")
        return answer

    def serialize(
        self,
        text: str,
        media_type: str,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
    ) -> bytes:
        """Evaluate a query and return its answer in a media type; arguments as in :meth:`query`.

        Raises
        ------
        UsageError
            If the media type does not fit the kind of query.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = queries.bind(text, bindings or {})
        return queries.serialize(self.store, self.graphs, self.plain, text, media_type, dataset)

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: Graph | str | None = None,
    ) -> list[Quad]:
        """Return the statements that fit a pattern; ``None`` fits everything.

        Without a graph every named graph is searched, so a triple that two graphs hold comes
        twice.
        """
        where = iri(graph) if isinstance(graph, str) else graph
        pattern = (
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else object_term(value),
        )
        found = list(self.store.quads_for_pattern(*pattern, where))
        if where is not None or self.plain:
            return found
        return [quad for quad in found if isinstance(quad.graph_name, NamedNode)]

    # Writing

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

    def on_commit(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call ``listener`` with each commit, in order, after it is stored and durable.

        Returns
        -------
        A function that ends it.
        """
        return self._writer.listen(listener)

    def load(
        self, source: Path | str | bytes | BinaryIO, format: str | None = None, **options: Any
    ) -> LoadReport:
        """Load a file, a folder, bytes or a known IRI; see :func:`rtask.loader.load.load`."""
        from rtask.loader.load import load

        return load(self, source, format=format, **options)

    def bulk_add(self, quads: Iterable[Quad], graph: Graph, request: Request) -> int:
        """Add more statements than a commit may hold; return how many were derived.

        One atomic step for the statements, then a commit for what follows from them.
        """
        return bulk_add(self._writer, self._files, self._inference, quads, graph, request)

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

    def session(self, agent: str | None = None) -> Session:
        """Return a unit of work over Python objects; see :mod:`rtask.model`."""
        from rtask.model.session import Session

        return Session(self, agent)

    # Reasoning

    @property
    def reasons(self) -> bool:
        """Whether commits derive what follows from them."""
        return self._inference is not None

    def warm_up(self) -> None:
        """Build the closure now instead of at the first write."""
        if self._inference is not None:
            with self._writer.exclusive():
                self._inference.closure()

    def contradictions(self) -> list[Any]:
        """Return the contradictions in the asserted graphs."""
        with self._writer.exclusive():
            found: list[Any] = self._reasoner().closure().contradictions()
        return found

    def explain(
        self, subject: Subject | str, predicate: NamedNode | str, value: Value
    ) -> Any | None:
        """Return the proof of a statement, or ``None`` if it does not hold.

        See :class:`reasoner.proofs.Proof`; its leaves name the graphs that assert them.
        """
        triple = (subject_term(subject), iri(predicate), stored(object_term(value)))
        with self._writer.exclusive():
            return self._reasoner().explain(triple)

    def _reasoner(self) -> Inference:
        if self._inference is None:
            raise UnsupportedError("this knowledge base was opened without reasoning")
        return self._inference

    def rebuild(self, what: str = "inferred") -> Commit:
        """Derive the inferred graph again from the asserted ones; one commit of the difference.

        Raises
        ------
        UsageError
            If there is nothing of that name to rebuild.
        """
        if what not in ("inferred", "all"):
            raise UsageError(f"cannot rebuild {what!r}; one of inferred, all")
        self._reasoner()
        request = Request(self.access(), note="rebuild inferred", trusted=True)
        return finish_bulk(self._writer, self._inference, request)

    def complete_interrupted(self) -> bool:
        """Finish a large load that a crash interrupted; whether there was one."""
        return complete(self._writer, self._files, self._inference, self.access())

    def stats(self) -> dict[str, Any]:
        """Return counts: distinct triples, asserted and inferred statements, graphs, commits."""
        from rtask.kb.statistics import collect

        return collect(self)

    def history(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
        agent: str | None = None,
        since: int = 0,
    ) -> list[HistoryEntry]:
        """Return the commits that touched matching statements, oldest first.

        Without a graph, derived statements and the commits' own records are left out.
        """
        matches = matcher(
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else stored(object_term(value)),
            None if graph is None else iri(graph),
            {self.graphs.inferred, self.graphs.meta, self.graphs.provenance},
        )
        return list(history(self._files.journal, matches, agent, since))

    def verify(self, repair: bool = False) -> list[Finding]:
        """Compare what is derived with what it is derived from; see :mod:`rtask.kb.verify`."""
        from rtask.kb.verify import verify

        return verify(self, self._writer, self._inference, repair)

    # Life

    def backup(self, target: Path | str) -> dict[str, Any]:
        """Copy the knowledge base to a new folder; see :func:`rtask.kb.backup.backup`."""
        from rtask.kb.backup import backup

        return backup(self._files, self._writer, Path(target))

    def publish(self, **facts: Any) -> None:
        """Tell others who find the folder locked more, e.g. the ``url`` that serves it."""
        if self._files.lock is not None:
            self._files.lock.publish(**facts)

    def checkpoint(self) -> None:
        """Make the store durable by itself, so that opening need not replay the journal."""
        if self._files.checkpoints is not None:
            with self._writer.exclusive():
                self._files.checkpoints.make(self.seq)

    def close(self) -> None:
        """Finish the running write, make everything durable and let the folder go."""
        if not self.store.is_open:
            return
        self._writer.close()
        if self._writer.committer.interrupted:
            self._files.abandon()
        else:
            self._files.close(self.seq)

    def __enter__(self) -> KnowledgeBase:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if self.folder is not None and self.store.is_open:
            warnings.warn(f"unclosed {self!r}", ResourceWarning, stacklevel=2)

    def __repr__(self) -> str:
        where = self.folder or "in memory"
        return f"<KnowledgeBase {where} base {self.base}>"
