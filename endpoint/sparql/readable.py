"""Limits queries and the graph store to the graphs that a caller may read.

A caller with rights ``read:<IRI>`` sees a dataset of these graphs alone. Statements derived by the
reasoner are not among them, for they may follow from any graph. The dataset is given to the store
as that of the SPARQL 1.1 Protocol (2.1.4), so the store evaluates patterns, paths, counts and
DESCRIBE on nothing else. A caller that names none reads all its graphs, merged into one default
graph and each by ``GRAPH``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from endpoint.served import ServedGraph, embedded
from endpoint.sparql.federation import mentions
from endpoint.sparql.request import QueryRequest
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import GraphName, NamedNode
from rtask.sparql.lexer import names_dataset
from rtask.sparql.service import TEXT_SERVICE

__all__ = ["limit_query", "require_read"]


def limit_query(query: QueryRequest, access: Access, kb: ServedGraph) -> QueryRequest:
    """Return a query that reads only what its caller may read.

    Parameters
    ----------
    query
        The query as sent; the graphs that its protocol fields name are kept as they are.
    access
        Rights of the caller; those of one that may read all graphs leave the query as it is.
    kb
        The graph that is asked.

    Raises
    ------
    ForbiddenError
        The query names a graph that its caller may not read, chooses graphs by ``FROM``, which the
        fields of the protocol would override, or uses SERVICE, which searches all graphs.
    UnsupportedError
        The graph is stored at another server.
    """
    if access.reads is None:
        return query
    embedded(kb, "a token that is limited to some graphs")
    if mentions(query.text, "SERVICE") or TEXT_SERVICE in query.text:
        raise ForbiddenError("SERVICE reads all graphs, and this token is limited to some")
    if names_dataset(query.text):
        raise ForbiddenError(
            "this token is limited to some graphs; choose among them by the fields "
            "`default-graph-uri` and `named-graph-uri` instead of FROM"
        )
    default, named = query.default_graphs, tuple(dict.fromkeys(query.named_graphs))
    if not default and not named:
        default = named = tuple(sorted(access.reads))
    _require_all(access, kb, (*default, *named))
    return replace(query, default_graphs=default, named_graphs=named, inferred=False)


def require_read(access: Access, graph: GraphName | None, kb: ServedGraph) -> None:
    """Refuse a caller that may not read a graph, whether the graph exists or not.

    Parameters
    ----------
    graph
        Its name; none for the whole dataset.

    Raises
    ------
    ForbiddenError
        Naming the graph.
    """
    if access.reads is None:
        return
    if not isinstance(graph, NamedNode):
        raise ForbiddenError("this token is limited to some graphs; name one: `graph=<iri>`")
    _require_all(access, kb, (graph.value,))


def _require_all(access: Access, kb: ServedGraph, graphs: Iterable[str]) -> None:
    own = embedded(kb, "a token that is limited to some graphs").graphs
    for graph in graphs:
        if access.reads is not None and graph not in access.reads:
            raise ForbiddenError(f"this token may not read <{graph}>", graph=graph)
        if own.is_system(NamedNode(graph)):
            raise ForbiddenError(
                f"<{graph}> holds statements about other graphs, so a token that is limited to "
                "some graphs cannot read it; make a token without it",
                graph=graph,
            )
