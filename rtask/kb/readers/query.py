"""Queries: evaluated, read to the end and dropped in the calling thread."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from pyoxigraph import (
    NamedNode,
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
)

from rtask.errors import DataError, UsageError
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import Graph, Value, iri, is_ground, object_term, written
from rtask.sparql.lexer import (
    body_start,
    find_block_end,
    guard,
    names_dataset,
    query_form,
    tokenise,
)
from rtask.sparql.results import Solutions, Triples
from rtask.sparql.service import without_services
from rtask.sparql.syntax import syntax_error

__all__ = ["QueryDataset", "bind", "prepare", "run", "serialize"]

Bindings: TypeAlias = Mapping[str, "Value | Sequence[Value]"]


@dataclass(frozen=True)
class QueryDataset:
    """What a query reads.

    Parameters
    ----------
    default_graphs, named_graphs
        Graphs given by the protocol; they win over ``FROM`` in the text (SPARQL 1.1 Protocol,
        2.1.4). ``None`` = what the text or the knowledge base says.
    inferred
        Whether derived statements are seen.
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
    if dataset.inferred or plain or names_dataset(text):
        joined = store.is_view and not names_dataset(text)
        return {"use_default_graph_as_union": True} if joined else {}
    apart = (graphs.inferred, graphs.quarantine)
    asserted: list[Graph] = [g for g in store.named_graphs() if g not in apart]
    return {"default_graph": asserted, "named_graphs": asserted}


def prepare(
    store: GraphStore, graphs: Graphs, plain: bool, text: str, dataset: QueryDataset
) -> tuple[str, dict[str, Any]]:
    """Return a query that the store may see, and the dataset as the store's arguments.

    Raises
    ------
    TooLargeError
        Nested deeper than the store's parser survives.
    ForbiddenError
        It calls out.
    """
    guard(text)
    return without_services(text), _arguments(store, graphs, plain, text, dataset)


def _evaluate(
    store: GraphStore, graphs: Graphs, plain: bool, text: str, dataset: QueryDataset
) -> Any:
    text, arguments = prepare(store, graphs, plain, text, dataset)
    try:
        return store.query(text, base_iri=dataset.base, **arguments)
    except SyntaxError as error:
        raise syntax_error(error, "query", text) from error
    except (RuntimeError, ValueError) as error:
        raise DataError(f"the query cannot be evaluated: {error}") from error


def run(
    store: GraphStore, graphs: Graphs, plain: bool, text: str, dataset: QueryDataset
) -> Solutions | bool | Triples:
    """Evaluate a query and read its answer to the end."""
    answer = _evaluate(store, graphs, plain, text, dataset)
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
) -> bytes:
    """Evaluate a query and return its answer in a media type.

    Raises
    ------
    UsageError
        If the media type does not fit the kind of query.
    """
    answer = _evaluate(store, graphs, plain, text, dataset)
    if isinstance(answer, QuerySolutions | QueryBoolean):
        known: Any = QueryResultsFormat.from_media_type(media_type)
        kind = "rows or a truth value"
    else:
        known, kind = RdfFormat.from_media_type(media_type), "triples"
    if known is None:
        raise UsageError(f"{media_type!r} cannot carry {kind}", media_type=media_type)
    try:
        written: bytes = answer.serialize(format=known)
    except (RuntimeError, ValueError) as error:
        raise DataError(f"the answer cannot be written as {media_type}: {error}") from error
    return written


def default_media_type(text: str) -> str:
    """Return the media type of an answer for which nobody asked for another."""
    rows = query_form(text) in ("select", "ask")
    return "application/sparql-results+json" if rows else "application/n-triples"


def bind(text: str, bindings: Bindings) -> str:
    """Fix variables of a query: one ``VALUES`` for each at the start of its WHERE.

    Parameters
    ----------
    bindings
        Variable name to a term or value, or to a list of them.

    Examples
    --------
    >>> bind("SELECT * { ?s ?p ?o }", {"s": iri("urn:mug")})
    'SELECT * { VALUES ?s { <urn:mug> } ?s ?p ?o }'
    """
    if not bindings:
        return text
    tokens = tokenise(text)
    start = body_start(tokens)
    at = next((i for i in range(start, len(tokens)) if tokens[i].is_mark("{")), None)
    if at is None:
        raise UsageError("bindings need a query with a WHERE block")
    if tokens[start].is_word("CONSTRUCT") and at == start + 1:
        end = find_block_end(tokens, at)
        at = next((i for i in range(end, len(tokens)) if tokens[i].is_mark("{")), None)
        if at is None:
            raise UsageError("bindings need a query with a WHERE block")
    clauses = "".join(
        f" VALUES ?{name.lstrip('?$')} {{ {_values(value)} }}" for name, value in bindings.items()
    )
    cut = tokens[at].end
    return text[:cut] + clauses + text[cut:]


def _values(value: Value | Sequence[Value]) -> str:
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    return " ".join(_value(v) for v in (value if listed else [value]))  # type: ignore[union-attr,arg-type]


def _value(value: Value) -> str:
    term = object_term(value)
    if not is_ground(term):
        raise UsageError("a blank node cannot be bound in a query; give its IRI")
    return written(term)
