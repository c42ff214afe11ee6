"""Evaluate queries in the calling thread, and prepare them for readers."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pyoxigraph import (
    NamedNode,
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
)

from rtask.errors import DataError, QuerySyntaxError, UsageError
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import GraphName, iri
from rtask.rdf.xml_text import serialize as write_answer
from rtask.sparql.lexer import body_start, guard, names_dataset, query_form, tokenise
from rtask.sparql.results import Solutions, Triples
from rtask.sparql.service import without_services
from rtask.sparql.syntax import syntax_error
from rtask.sparql.templates import resolve

__all__ = ["QueryDataset", "default_media_type", "prepare", "run", "serialize"]


@dataclass(frozen=True)
class QueryDataset:
    """The graphs that a query reads.

    Parameters
    ----------
    default_graphs, named_graphs
        Graphs given by the protocol, which override ``FROM`` in the text (SPARQL 1.1 Protocol,
        2.1.4). ``None`` leaves the choice to the text or the knowledge base.
    inferred
        Whether derived statements are visible.
    base
        IRI against which relative IRIs are resolved.
    """

    default_graphs: tuple[NamedNode, ...] | None = None
    named_graphs: tuple[NamedNode, ...] | None = None
    inferred: bool = True
    base: str | None = None

    @classmethod
    def of(
        cls,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        inferred: bool = True,
        base: str | None = None,
    ) -> QueryDataset:
        """Make a dataset from names; naming one kind of graph leaves the other kind empty."""
        if default_graphs is None and named_graphs is None:
            return cls(inferred=inferred, base=base)
        default = tuple(map(iri, default_graphs or ()))
        named = tuple(map(iri, named_graphs or ()))
        return cls(default, named, inferred, base)


def _arguments(
    store: GraphStore, graphs: Graphs, plain: bool, text: str, dataset: QueryDataset
) -> dict[str, Any]:
    if dataset.default_graphs is not None:
        return {
            "default_graph": list(dataset.default_graphs),
            "named_graphs": list(dataset.named_graphs or ()),
        }
    if names_dataset(text):
        return _several_from(text, dataset.base)
    if dataset.inferred or plain:
        return {"use_default_graph_as_union": True} if store.is_view else {}
    apart = (graphs.inferred, graphs.quarantine)
    asserted: list[GraphName] = [g for g in store.named_graphs() if g not in apart]
    return {"default_graph": asserted, "named_graphs": asserted}


def _several_from(text: str, base: str | None) -> dict[str, Any]:
    """Return the graphs of ``FROM`` where a query names several, so that they can be merged."""
    tokens = tokenise(text)
    prologue = text[: tokens[body_start(tokens)].start]
    graphs: dict[str, list[NamedNode]] = {"default_graph": [], "named_graphs": []}
    try:
        for token, after, last in zip(tokens, tokens[1:], tokens[2:], strict=False):
            if token.is_word("FROM"):
                kind = "named_graphs" if after.is_word("NAMED") else "default_graph"
                name = last if after.is_word("NAMED") else after
                graphs[kind].append(resolve(name.text, prologue, base))
    except QuerySyntaxError:
        return {}  # the store says better what is wrong
    return graphs if len(graphs["default_graph"]) > 1 else {}


def prepare(
    store: GraphStore, graphs: Graphs, plain: bool, text: str, dataset: QueryDataset
) -> tuple[str, dict[str, Any]]:
    """Check a query; return its text for the store, and the dataset as the store's arguments.

    Raises
    ------
    TooLargeError
        The query is nested more deeply than the store's parser can handle.
    ForbiddenError
        The query uses SERVICE.
    """
    guard(text)
    return without_services(text), _arguments(store, graphs, plain, text, dataset)


def _evaluate(
    store: GraphStore,
    graphs: Graphs,
    plain: bool,
    text: str,
    dataset: QueryDataset,
    timeout_s: float | None,
) -> Any:
    text, arguments = prepare(store, graphs, plain, text, dataset)
    try:
        return store.query(text, timeout_s=timeout_s, base_iri=dataset.base, **arguments)
    except SyntaxError as error:
        raise syntax_error(error, "query", text) from error
    except (RuntimeError, ValueError) as error:
        raise DataError(f"the query cannot be evaluated: {error}") from error


def run(
    store: GraphStore,
    graphs: Graphs,
    plain: bool,
    text: str,
    dataset: QueryDataset,
    timeout_s: float | None = None,
) -> Solutions | bool | Triples:
    """Evaluate a query and read its answer to the end.

    Parameters
    ----------
    timeout_s
        Time limit where the statements are on another server; there is none in this process.
    """
    answer = _evaluate(store, graphs, plain, text, dataset, timeout_s)
    try:
        if isinstance(answer, QuerySolutions):
            names = [variable.value for variable in answer.variables]
            return Solutions(names, [tuple(row) for row in answer])
        if isinstance(answer, QueryBoolean):
            return bool(answer)
        return Triples(tuple(answer))
    except RuntimeError as error:
        raise DataError(f"the query cannot be evaluated: {error}") from error


def serialize(
    store: GraphStore,
    graphs: Graphs,
    plain: bool,
    text: str,
    media_type: str,
    dataset: QueryDataset,
    timeout_s: float | None = None,
) -> bytes:
    """Evaluate a query and return its answer in a media type.

    Raises
    ------
    UsageError
        If the media type does not fit the kind of query.
    """
    answer = _evaluate(store, graphs, plain, text, dataset, timeout_s)
    if isinstance(answer, QuerySolutions | QueryBoolean):
        from_media_type: Any = QueryResultsFormat.from_media_type(media_type)
        kind = "rows or a truth value"
    else:
        from_media_type, kind = RdfFormat.from_media_type(media_type), "triples"
    if from_media_type is None:
        raise UsageError(f"{media_type!r} cannot represent {kind}", media_type=media_type)
    try:
        sink = io.BytesIO()
        write_answer(answer, sink, from_media_type)
    except (RuntimeError, ValueError) as error:
        raise DataError(f"the answer cannot be written as {media_type}: {error}") from error
    return sink.getvalue()


def default_media_type(text: str) -> str:
    """Return the media type of an answer when none was requested."""
    rows = query_form(text) in ("select", "ask")
    return "application/sparql-results+json" if rows else "application/n-triples"
