"""No two files of the packages import each other, by however long a way round.

Every import statement counts: those at the top of a file, those inside functions, those below
``if TYPE_CHECKING`` and ``from package import submodule``. A file that can be understood only
together with the file that imports it is one file in two parts.
"""

from __future__ import annotations

import ast

import pytest

from tests.architecture.imports import (
    Graph,
    import_graph,
    import_statements,
    imported_modules,
)


def find_rings(graph: Graph) -> list[frozenset[str]]:
    """Return the strongly connected components of more than one module (Tarjan 1972)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    rings = []
    for start in graph:
        if start in order:
            continue
        order[start] = low[start] = len(order)
        stack.append(start)
        walk = [(start, iter(sorted(graph[start])))]
        while walk:
            node, rest = walk[-1]
            for target in rest:
                if target not in order:
                    order[target] = low[target] = len(order)
                    stack.append(target)
                    walk.append((target, iter(sorted(graph[target]))))
                    break
                if target in stack:
                    low[node] = min(low[node], order[target])
            else:
                walk.pop()
                if walk:
                    low[walk[-1][0]] = min(low[walk[-1][0]], low[node])
                if low[node] == order[node]:
                    cut = stack.index(node)
                    if len(stack) - cut > 1:
                        rings.append(frozenset(stack[cut:]))
                    del stack[cut:]
    return rings


def shortest_way_round(graph: Graph, ring: frozenset[str]) -> list[str]:
    """Return one shortest cycle inside a ring, to be read as a -> b -> a."""
    best: list[str] = []
    for start in sorted(ring):
        came_from: dict[str, str] = {}
        frontier = [start]
        while frontier and start not in came_from:
            following = []
            for node in frontier:
                for target in sorted(graph[node] & ring):
                    if target not in came_from:
                        came_from[target] = node
                        following.append(target)
            frontier = following
        way = [start]
        while came_from[way[-1]] != start:
            way.append(came_from[way[-1]])
        if not best or len(way) < len(best):
            best = way
    return [best[0], *reversed(best)]


@pytest.mark.slow
def test_no_ring_of_files() -> None:
    graph = import_graph()
    rings = [
        f"{len(ring)} files: " + " -> ".join(shortest_way_round(graph, ring))
        for ring in find_rings(graph)
    ]
    assert not rings


def test_every_way_to_import_counts() -> None:
    known = ["a", "a.b", "a.c", "a.d", "a.e", "a.f", "a.f.g"]
    statements = import_statements(
        ast.parse("""
from __future__ import annotations
import json
from typing import TYPE_CHECKING
import a.b
from a import c
if TYPE_CHECKING:
    from a.d import Thing
def later():
    from .e import thing
    from . import f
""")
    )
    found = set(imported_modules(statements, "a", True, known))
    assert found == {"a.b", "a.c", "a.d", "a.e", "a.f"}
    for text, module in (("from ..b import x", "a.b"), ("from . import x", "a.f")):
        statements = import_statements(ast.parse(text))
        assert list(imported_modules(statements, "a.f.g", False, known)) == [module]


def test_a_ring_is_found_and_shown() -> None:
    graph = {
        "a": frozenset({"b"}),
        "b": frozenset({"c", "d"}),
        "c": frozenset({"a"}),
        "d": frozenset({"c", "e"}),
        "e": frozenset[str](),
    }
    (ring,) = find_rings(graph)
    assert ring == {"a", "b", "c", "d"}
    assert shortest_way_round(graph, ring) == ["a", "b", "c", "a"]
