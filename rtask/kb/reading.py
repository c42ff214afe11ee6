"""Methods that read: queries, streams and patterns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from pyoxigraph import Quad

from rtask.errors import UnsupportedError
from rtask.kb.readers import evaluation
from rtask.kb.readers.evaluation import QueryDataset
from rtask.kb.readers.request import Question
from rtask.kb.readers.streams import Stream, WholeStream
from rtask.kb.searching import Searching
from rtask.rdf.terms import GraphName, NamedNode, Subject, Value, iri, object_term, subject_term
from rtask.sparql.bindings import Bindings, bind
from rtask.sparql.results import Solutions, Triples, read_answer

__all__ = ["Reading"]


class Reading(Searching):
    """Evaluation of queries and patterns, from any thread."""

    def query(
        self,
        text: str,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
        timeout_s: float | None = None,
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
        timeout_s
            Ends the query then. It is evaluated in another process, since nothing else can be
            stopped; without it, in this thread.

        Raises
        ------
        QuerySyntaxError
            With line and column.
        QueryTimeout
            The time is over.
        QueryTooExpensive
            It needs more memory than it may have.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = self._looked_up(bind(text, bindings or {}))
        if timeout_s is not None and self.readers.possible:
            with self._ask(text, dataset, Question(""), timeout_s) as answer:
                return read_answer(answer.kind, answer.read())
        return evaluation.run(self.store, self.graphs, self.plain, text, dataset)

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
        text = self._looked_up(bind(text, bindings or {}))
        return evaluation.serialize(self.store, self.graphs, self.plain, text, media_type, dataset)

    def stream(
        self,
        text: str,
        media_type: str | None = None,
        *,
        timeout_s: float | None = None,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        base_iri: str | None = None,
        gzip: bool = False,
        max_rows: int | None = None,
        max_bytes: int | None = None,
        on_start: Callable[[Stream], None] | None = None,
        quick: bool | None = None,
    ) -> Stream:
        """Evaluate a query in a reader and return its answer in pieces, as they come.

        Safe from any thread; closing the stream ends the query at once. The first piece is there
        when this returns, so most errors are raised here.

        Parameters
        ----------
        media_type
            Of the answer; ``None`` for SPARQL results in JSON, or N-Triples.
        timeout_s
            From now until the end of the answer; a query that takes longer is ended. More can be
            given later by :meth:`Stream.extend <rtask.kb.readers.streams.Stream.extend>`.
        gzip
            Pack the answer unless it is small; :attr:`Stream.gzip` says what was done.
        max_rows, max_bytes
            An answer that has more is broken off.
        on_start
            Gets the stream when a reader begins with the query; closing it ends the query even
            before there is a first piece.
        quick
            Whether it takes one of the readers kept for quick queries; judged by its text
            (:func:`rtask.sparql.query_cost.is_quick`) if not given.

        Raises
        ------
        QuerySyntaxError, QueryTimeout, QueryTooExpensive, TooLargeError, BusyError
            Here, or while reading.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base_iri)
        text = self._looked_up(text)
        if not self.readers.possible:
            form = media_type or evaluation.default_media_type(text)
            data = evaluation.serialize(self.store, self.graphs, self.plain, text, form, dataset)
            return WholeStream(data, form)
        question = Question(
            "", media_type=media_type, gzip=gzip, max_rows=max_rows, max_bytes=max_bytes
        )
        return self._ask(text, dataset, question, timeout_s, on_start, quick)

    def _ask(
        self,
        text: str,
        dataset: QueryDataset,
        question: Question,
        timeout_s: float | None,
        on_start: Callable[[Stream], None] | None = None,
        quick: bool | None = None,
    ) -> Stream:
        text, graphs = evaluation.prepare(self.store, self.graphs, self.plain, text, dataset)
        names = [
            None if graphs.get(key) is None else tuple(graph.value for graph in graphs[key])
            for key in ("default_graph", "named_graphs")
        ]
        question = replace(
            question,
            text=text,
            base=dataset.base,
            default_graphs=names[0],
            named_graphs=names[1],
            union="use_default_graph_as_union" in graphs,
        )
        return self.readers.ask(question, timeout_s, on_start, quick)

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: GraphName | str | None = None,
    ) -> list[Quad]:
        """Return the statements that match a pattern; ``None`` matches everything.

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
