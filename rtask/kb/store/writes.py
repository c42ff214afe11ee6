"""Changes of one commit, and the SPARQL update that makes them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

from pyoxigraph import DefaultGraph, NamedNode, Quad

from rtask.kb.store.quads import InGraph, ground_text
from rtask.rdf.terms import GraphName, is_ground, written

__all__ = ["Functions", "Writes", "as_update"]

Functions = dict[NamedNode, Callable[..., Any]]
_PARTS = (("s", "subject"), ("p", "predicate"), ("o", "object"), ("g", "graph_name"))
_MANY = 200


@dataclass(frozen=True)
class Writes:
    """All changes that one commit makes to the store.

    Parameters
    ----------
    is_replacement
        Whether the store was emptied and filled again instead; copies of it are to be made again.
    has_union
        Whether what is added to the default graph belongs to the union of the named graphs, so
        that it may be there already.
    inferred
        All that one of the graphs goes on holding, where that is known without reading it.
    is_unseen
        Whether nobody can read what changes before all of it has, and what a process killed
        meanwhile leaves is completed from the journal. It may then be made in two steps: the store
        adds at half the cost what it does not also have to parse.
    """

    removed: Collection[Quad] = ()
    added: Collection[Quad] = ()
    created: Collection[GraphName] = ()
    dropped: Collection[GraphName] = ()
    is_replacement: bool = False
    has_union: bool = False
    inferred: InGraph | None = None
    is_unseen: bool = False

    def only_adds(self) -> bool:
        """Whether ``extend`` suffices, which also creates the graphs of its quads."""
        if self.removed or self.dropped:
            return False
        return not self.created or {*self.created} <= {quad.graph_name for quad in self.added}


def as_update(writes: Writes) -> tuple[list[str], Functions]:
    """Return the change as update operations, with the custom functions that they call.

    Statements with blank nodes are passed through custom functions that return the terms, because
    INSERT DATA would rename blank nodes and DELETE DATA cannot contain them.
    """
    operations: list[str] = []
    functions: Functions = {}
    for verb, quads in (("DELETE", writes.removed), ("INSERT", writes.added)):
        blocks, blank = _split(quads)
        if blocks:
            data = "\n".join(blocks)
            operations.append(f"{verb} DATA {{ {data} }}")
        # A function's answer cannot be the default graph, so it takes an update of its own.
        for in_default in (False, True):
            chosen = [q for q in blank if isinstance(q.graph_name, DefaultGraph) == in_default]
            if chosen:
                prefix = f"urn:rtask-apply:{verb}:{in_default}:"
                operations.append(_by_functions(verb, chosen, in_default, prefix, functions))
    operations += [f"CREATE SILENT GRAPH {graph}" for graph in writes.created]
    operations += [f"DROP SILENT GRAPH {graph}" for graph in writes.dropped]
    return operations, functions


def _split(quads: Collection[Quad]) -> tuple[list[str], list[Quad]]:
    """Return quads as the blocks of a DATA clause, and those with blank nodes apart."""
    if len(quads) < _MANY:
        return _blocks_of_few(quads)
    by_graph: dict[GraphName, list[Quad]] = {}
    for quad in quads:
        by_graph.setdefault(quad.graph_name, []).append(quad)
    blocks: list[str] = []
    blank: list[Quad] = []
    for graph, held in by_graph.items():
        # The store's own writer takes a tenth of the time of making each term's text.
        text, others = ground_text(held)
        blank += others
        if text:
            # No literal holds the end of a line, so only the names of the graph go.
            end = b"" if isinstance(graph, DefaultGraph) else f" {graph}".encode()
            blocks.append(_block(text.replace(end + b" .\n", b" .\n").decode(), graph))
    return blocks, blank


def _blocks_of_few(quads: Iterable[Quad]) -> tuple[list[str], list[Quad]]:
    by_graph: dict[GraphName, list[str]] = {}
    blank: list[Quad] = []
    for quad in quads:
        # In SPARQL text a blank node is a variable; only a custom function can name one.
        if is_ground(quad.subject) and is_ground(quad.object) and is_ground(quad.graph_name):
            text = f"{written(quad.subject)} {quad.predicate} {written(quad.object)}"
            by_graph.setdefault(quad.graph_name, []).append(text)
        else:
            blank.append(quad)
    blocks = [_block(" .\n".join(lines) + " .", graph) for graph, lines in by_graph.items()]
    return blocks, blank


def _block(text: str, graph: GraphName) -> str:
    return text if isinstance(graph, DefaultGraph) else f"GRAPH {graph} {{ {text} }}"


def _by_functions(
    verb: str, quads: list[Quad], in_default: bool, prefix: str, functions: Functions
) -> str:
    pattern = "?s ?p ?o" if in_default else "GRAPH ?g { ?s ?p ?o }"
    binds = []
    for name, attribute in _PARTS[: 3 if in_default else 4]:
        terms = [getattr(quad, attribute) for quad in quads]
        # Bound as a default, or every function would answer for the last part.
        functions[NamedNode(prefix + name)] = lambda i, terms=terms: terms[int(i.value)]
        binds.append(f"BIND(<{prefix}{name}>(?i) AS ?{name})")
    numbers = " ".join(map(str, range(len(quads))))
    return f"{verb} {{ {pattern} }} WHERE {{ VALUES ?i {{ {numbers} }} {' '.join(binds)} }}"
