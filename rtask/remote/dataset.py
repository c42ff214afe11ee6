"""The graphs that a query on a SPARQL server reads.

A server may hold more graphs than those of one knowledge base: the one with its head and records,
parts of large commits on their way, and what belongs to others. Queries must not see them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence

from pyoxigraph import NamedNode

from rtask.remote.dialect import Dialect
from rtask.sparql.lexer import find_block_end, names_dataset, tokenise
from rtask.sparql.tokens import Token

__all__ = ["among", "directed"]

_GRAPH_WORD = re.compile(r"\bGRAPH\b", re.IGNORECASE)


def directed(
    dialect: Dialect,
    text: str,
    default: Sequence[NamedNode] | None,
    named: Sequence[NamedNode] | None,
    graphs: Callable[[], Collection[NamedNode]],
) -> tuple[str, list[tuple[str, str]]]:
    """Return a query and the protocol's parameters that make it read the right graphs.

    Parameters
    ----------
    default, named
        The dataset that the caller asked for; both ``None`` for the whole knowledge base.
    graphs
        Returns the named graphs of the knowledge base, over which ``GRAPH ?g`` ranges.
    """
    if default is not None or named is not None:
        fields = [("default-graph-uri", graph.value) for graph in default or ()]
        return text, [*fields, *(("named-graph-uri", graph.value) for graph in named or ())]
    if names_dataset(text):
        return text, []
    uses_graphs = _GRAPH_WORD.search(text) is not None
    if dialect.union is None:
        # The protocol cannot name the server's own default graph, so the text has to say it.
        return among(text, graphs()) if uses_graphs else text, []
    fields = [("default-graph-uri", dialect.union.value)]
    if uses_graphs:
        fields += [("named-graph-uri", graph.value) for graph in graphs()]
    return text, fields


def among(text: str, graphs: Collection[NamedNode]) -> str:
    """Return a query whose ``GRAPH ?g`` ranges over some graphs only.

    >>> among("SELECT ?g { GRAPH ?g { ?s ?p 1 } }", [NamedNode("urn:a"), NamedNode("urn:b")])
    'SELECT ?g { { VALUES ?g { <urn:a> <urn:b> } GRAPH ?g { ?s ?p 1 } } }'
    """
    tokens = tokenise(text)
    names = " ".join(map(str, graphs))
    inserted: dict[int, str] = {}
    index = 0
    while index < len(tokens):
        token = tokens[index]
        if token.is_word("SERVICE"):  # another server's graphs
            index = find_block_end(tokens, _opening(tokens, index))
            continue
        if token.is_word("GRAPH") and tokens[index + 1].text[:1] in ("?", "$"):
            end = tokens[find_block_end(tokens, index + 2) - 1].end
            opened = f"{{ VALUES {tokens[index + 1].text} {{ {names} }} "
            inserted[token.start] = inserted.get(token.start, "") + opened
            inserted[end] = " }"
        index += 1
    pieces, at = [], 0
    for place in sorted(inserted):
        pieces += [text[at:place], inserted[place]]
        at = place
    return "".join([*pieces, text[at:]])


def _opening(tokens: list[Token], start: int) -> int:
    return next(i for i in range(start, len(tokens)) if tokens[i].is_mark("{"))
