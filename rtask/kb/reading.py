"""Methods that read: queries, streams and patterns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from pyoxigraph import Quad

from rtask.errors import TooLargeError, UnsupportedError
from rtask.kb.readers import evaluation
from rtask.kb.readers.evaluation import QueryDataset
from rtask.kb.readers.request import Question
from rtask.kb.readers.streams import Stream, WholeStream
from rtask.kb.searching import Searching
from rtask.rdf.terms import GraphName, NamedNode, Subject, Value, iri, object_term, subject_term
from rtask.sparql.bindings import Bindings, bind
from rtask.sparql.place_service import PLACE_SERVICE
from rtask.sparql.results import Solutions, Triples, read_answer
from rtask.sparql.service import TEXT_SERVICE

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
            Whether derived statements are visible.
        default_graphs, named_graphs
            The dataset; if either is given, they replace ``FROM`` in the text. Without either,
            triple patterns match the union of all graphs.
        bindings
            Values of variables: a term or Python value for each, or a list of them.
        base
            IRI against which relative IRIs are resolved.
        timeout_s
            Time limit. A query with a limit is evaluated in another process, which can be
            stopped; without a limit, in this thread.

        Raises
        ------
        QuerySyntaxError
            With line and column.
        QueryTimeout
            The time is up.
        QueryTooExpensive
            The query exceeds its memory limit.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base)
        text = self._expand_services(bind(text, bindings or {}))
        if timeout_s is not None and self.readers.possible:
            with self._ask(text, dataset, Question(""), timeout_s) as answer:
                return read_answer(answer.kind, answer.read())
        return evaluation.run(self.store, self.graphs, self.plain, text, dataset, timeout_s)

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
        text = self._expand_services(bind(text, bindings or {}))
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
        """Evaluate a query in a reader and return its answer in pieces, as they are produced.

        Safe to call from any thread; closing the stream stops the query at once. The first piece
        has arrived when this returns, so most errors are raised here.

        Parameters
        ----------
        media_type
            Media type of the answer; ``None`` for SPARQL results in JSON, or N-Triples.
        timeout_s
            Time limit from now until the end of the answer. It can be extended later with
            :meth:`Stream.extend <rtask.kb.readers.streams.Stream.extend>`.
        gzip
            Compress the answer unless it is small; :attr:`Stream.gzip` tells whether it was.
        max_rows, max_bytes
            Limits on the answer; a larger one raises :class:`TooLargeError`.
        on_start
            Called with the stream when a reader starts on the query; closing the stream stops the
            query even before its first piece.
        quick
            Whether it may use a reader reserved for quick queries; estimated from its text
            (:func:`rtask.sparql.query_cost.is_quick`) if not given.

        Raises
        ------
        QuerySyntaxError, QueryTimeout, QueryTooExpensive, TooLargeError, BusyError
            Raised here or while reading.
        """
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base_iri)
        text = self._expand_services(text)
        if not self.readers.possible:
            form = media_type or evaluation.default_media_type(text)
            data = evaluation.serialize(
                self.store, self.graphs, self.plain, text, form, dataset, timeout_s
            )
            if max_bytes is not None and len(data) > max_bytes:
                raise TooLargeError(
                    f"the answer has {len(data)} bytes, at most {max_bytes} are allowed",
                    limit="bytes",
                    value=len(data),
                    allowed=max_bytes,
                )
            return WholeStream(data, form)
        question = Question(
            "", media_type=media_type, gzip=gzip, max_rows=max_rows, max_bytes=max_bytes
        )
        return self._ask(text, dataset, question, timeout_s, on_start, quick)

    def encode_query(
        self,
        text: str,
        media_type: str | None = None,
        *,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        base_iri: str | None = None,
        gzip: bool = False,
        max_rows: int | None = None,
        max_bytes: int | None = None,
    ) -> bytes | None:
        """Return a query as it is sent to a reader, for event loops.

        Returns
        -------
        The payload for :meth:`rtask.kb.readers.pool.Readers.send`, which ends with the text of the
        query, in UTF-8. ``None`` if the text searches for words or places: use :meth:`stream` in a
        thread.

        Raises
        ------
        ForbiddenError, TooLargeError
            As :meth:`stream`; the parameters are the same.
        """
        if TEXT_SERVICE in text or PLACE_SERVICE in text:
            return None
        dataset = QueryDataset.of(default_graphs, named_graphs, inferred, base_iri)
        question = Question(
            "", media_type=media_type, gzip=gzip, max_rows=max_rows, max_bytes=max_bytes
        )
        return self._question(text, dataset, question).encode()

    def _ask(
        self,
        text: str,
        dataset: QueryDataset,
        question: Question,
        timeout_s: float | None,
        on_start: Callable[[Stream], None] | None = None,
        quick: bool | None = None,
    ) -> Stream:
        question = self._question(text, dataset, question)
        return self.readers.ask(question, timeout_s, on_start, quick)

    def _question(self, text: str, dataset: QueryDataset, question: Question) -> Question:
        """Check a query; return it as it is sent to a reader."""
        text, graphs = evaluation.prepare(self.store, self.graphs, self.plain, text, dataset)
        names = [
            None if graphs.get(key) is None else tuple(graph.value for graph in graphs[key])
            for key in ("default_graph", "named_graphs")
        ]
        return replace(
            question,
            text=text,
            base=dataset.base,
            default_graphs=names[0],
            named_graphs=names[1],
            union="use_default_graph_as_union" in graphs,
        )

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: GraphName | str | None = None,
    ) -> list[Quad]:
        """Return the statements that match a pattern; ``None`` matches everything.

        Without a graph every named graph is searched, so a triple held by two graphs is returned
        twice.
        """
        where = iri(graph) if isinstance(graph, str) else graph
        pattern = (
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else object_term(value),
        )
        quads = list(self.store.quads_for_pattern(*pattern, where))
        if where is not None or self.plain:
            return quads
        return [quad for quad in quads if isinstance(quad.graph_name, NamedNode)]
