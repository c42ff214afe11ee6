"""Apply one commit to the store atomically.

The store offers no transaction object, but ``extend`` and a whole ``update`` request are atomic:
readers, and a process that is killed, see all of it or nothing. A large change is applied in two
steps at a third of the cost: additions through the store's bulk loader, then removals. The journal
holds the whole change durably beforehand, so the next opening completes it after a kill or a power
cut. Reader processes receive it as one change; only code in this process can see the state between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pyoxigraph import DefaultGraph, NamedNode, Quad

from rtask.kb.store.graph_store import GraphStore
from rtask.rdf.terms import GraphName, is_ground, written

__all__ = ["LARGE", "Writes", "apply", "as_update"]

LARGE = 10_000
"""A change with more additions than this is journalled durably, then stored in two steps."""

Functions = dict[NamedNode, Callable[..., Any]]
_PARTS = (("s", "subject"), ("p", "predicate"), ("o", "object"), ("g", "graph_name"))


@dataclass(frozen=True)
class Writes:
    """All changes that one commit makes to the store.

    Parameters
    ----------
    is_replacement
        Whether the store was emptied and filled again instead; copies of it are to be made anew.
    """

    removed: Sequence[Quad] = ()
    added: Sequence[Quad] = ()
    created: Sequence[GraphName] = ()
    dropped: Sequence[GraphName] = ()
    is_replacement: bool = False
    graphs_of_added: frozenset[GraphName] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "graphs_of_added", frozenset(q.graph_name for q in self.added))

    def only_adds(self) -> bool:
        """Whether ``extend`` suffices, which also creates the graphs of its quads."""
        return (
            not self.removed
            and not self.dropped
            and all(graph in self.graphs_of_added for graph in self.created)
        )


def apply(store: GraphStore, writes: Writes) -> None:
    """Change the store in one atomic step."""
    if len(writes.added) > LARGE:
        _apply_large(store, writes)
    elif writes.only_adds():
        store.extend(writes.added)
    else:
        operations, functions = as_update(writes)
        if operations:
            store.update(" ;\n".join(operations), custom_functions=functions)
    for follower in store.followers:
        follower(writes)


def _apply_large(store: GraphStore, writes: Writes) -> None:
    """Add first; undo the additions if removing fails."""
    operations, functions = as_update(
        Writes(writes.removed, created=writes.created, dropped=writes.dropped)
    )
    try:
        store.bulk_extend(writes.added)
        if operations:
            store.update(" ;\n".join(operations), custom_functions=functions)
    except BaseException:
        for quad in writes.added:
            store.raw.remove(quad)
        raise


def as_update(writes: Writes) -> tuple[list[str], Functions]:
    """Return the change as update operations, with the custom functions that they call.

    Statements with blank nodes are passed through custom functions that return the terms, because
    INSERT DATA would rename blank nodes and DELETE DATA cannot contain them.
    """
    operations: list[str] = []
    functions: Functions = {}
    for verb, quads in (("DELETE", writes.removed), ("INSERT", writes.added)):
        ground, blank = _split(quads)
        if ground:
            operations.append(f"{verb} DATA {{ {_data(ground)} }}")
        for in_default in (False, True):
            chosen = [q for q in blank if isinstance(q.graph_name, DefaultGraph) == in_default]
            if chosen:
                prefix = f"urn:rtask-apply:{verb}:{in_default}:"
                operations.append(_by_functions(verb, chosen, in_default, prefix, functions))
    operations += [f"CREATE SILENT GRAPH {graph}" for graph in writes.created]
    operations += [f"DROP SILENT GRAPH {graph}" for graph in writes.dropped]
    return operations, functions


def _split(quads: Iterable[Quad]) -> tuple[list[Quad], list[Quad]]:
    ground: list[Quad] = []
    blank: list[Quad] = []
    for quad in quads:
        named = is_ground(quad.subject) and is_ground(quad.object) and is_ground(quad.graph_name)
        (ground if named else blank).append(quad)
    return ground, blank


def _data(quads: Iterable[Quad]) -> str:
    by_graph: dict[GraphName, list[str]] = {}
    for quad in quads:
        text = f"{written(quad.subject)} {quad.predicate} {written(quad.object)}"
        by_graph.setdefault(quad.graph_name, []).append(text)
    blocks = []
    for graph, lines in by_graph.items():
        body = " .\n".join(lines)
        named = not isinstance(graph, DefaultGraph)
        blocks.append(f"GRAPH {graph} {{ {body} }}" if named else f"{body} .")
    return "\n".join(blocks)


def _by_functions(
    verb: str, quads: list[Quad], in_default: bool, prefix: str, functions: Functions
) -> str:
    pattern = "?s ?p ?o" if in_default else "GRAPH ?g { ?s ?p ?o }"
    binds = []
    for name, attribute in _PARTS[: 3 if in_default else 4]:
        terms = [getattr(quad, attribute) for quad in quads]
        functions[NamedNode(prefix + name)] = lambda i, terms=terms: terms[int(i.value)]
        binds.append(f"BIND(<{prefix}{name}>(?i) AS ?{name})")
    numbers = " ".join(map(str, range(len(quads))))
    return f"{verb} {{ {pattern} }} WHERE {{ VALUES ?i {{ {numbers} }} {' '.join(binds)} }}"
