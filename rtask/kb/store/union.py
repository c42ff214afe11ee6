"""The union of all named graphs, kept exactly in the store's default graph.

The default graph has one copy of each distinct triple, so COUNT does not count a triple once for
each graph that holds it. A triple is removed together with its last occurrence in a named graph.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Sequence

from pyoxigraph import Quad

from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Holders, Overlay
from rtask.kb.store.quads import InGraph, parts_of
from rtask.rdf.terms import DEFAULT, GraphName, TripleKey, triple_key

__all__ = [
    "Copies",
    "input_change",
    "is_empty",
    "remaining",
    "union_change",
]

_LARGE = 20_000
_MAX_HELD_RATIO = 4
"""So many quads that stay are read at once in less time than so many that go are looked up."""


def union_change(
    store: GraphStore,
    removed: Iterable[Quad],
    added: Iterable[Quad],
    fresh: Collection[GraphName] = (),
    besides: Sequence[Container[TripleKey]] = (),
    holders: Holders | None = None,
) -> Overlay:
    """Return the change of the default graph when these quads of named graphs change.

    Parameters
    ----------
    removed, added
        Exact change: all of ``removed`` are in the store and none of ``added`` are.
    fresh
        Graphs whose added statements are rarely in another graph, so that checking costs more
        than adding a duplicate.
    besides
        Triples that the union gains besides; they are not part of the result.
    holders
        What has been looked up of the change already.
    """
    change = Overlay(store)
    is_joined = _Cached(Graphs.is_joined)
    new = {triple_key(quad): quad for quad in added if is_joined[quad.graph_name]}
    gone = {quad: None for quad in removed if is_joined[quad.graph_name]}
    # A store elsewhere is asked once about all of these, not once about each.
    store.prefetch(
        [q.subject for q in gone] + [q.subject for q in new.values() if q.graph_name not in fresh]
    )
    looked_up = []
    for key, quad in new.items():
        in_union = Quad(*key, DEFAULT)
        # Of a new graph nothing can be stored, so the union is asked about the others alone.
        if quad.graph_name in fresh:
            change.added[in_union] = None
        else:
            looked_up.append(in_union)
    change.added.update(dict.fromkeys(store.lacking(looked_up)))
    for key in _lost(store, gone, is_joined, holders or Holders(store), (new, *besides)):
        change.removed[Quad(*key, DEFAULT)] = None
    return change


def is_empty(store: GraphStore) -> bool:
    """Whether the union holds nothing, as in a new knowledge base."""
    # A count would read everything.
    return next(iter(store.quads_for_pattern(None, None, None, DEFAULT)), None) is None


class Copies(Collection[Quad]):
    """The quads of joined graphs among some, as the union has them; a triple may come twice.

    Parameters
    ----------
    quads
        Each pass over the copies is a pass over these.
    """

    def __init__(self, quads: Collection[Quad]) -> None:
        self._quads = quads

    def __len__(self) -> int:
        return len(self._quads)

    def __iter__(self) -> Iterator[Quad]:
        is_joined = _Cached(Graphs.is_joined)
        return (Quad(*triple_key(q), DEFAULT) for q in self._quads if is_joined[q.graph_name])

    def __contains__(self, quad: object) -> bool:
        return any(quad == copy for copy in self)


def input_change(
    overlay: Overlay, is_input: Callable[[GraphName], bool]
) -> tuple[list[TripleKey], list[TripleKey]]:
    """Return the triples that the union of the asserted graphs gains and loses.

    A triple asserted in two graphs is lost only when it is removed from both. What is gained may
    contain triples that another graph asserts already; the reasoner knows them.
    """
    inputs = _Cached(is_input)
    new = {triple_key(quad): None for quad in overlay.added if inputs[quad.graph_name]}
    gone = {quad: None for quad in overlay.removed if inputs[quad.graph_name]}
    return list(new), _lost(overlay.store, gone, inputs, overlay.holders, (new,))


def _lost(
    store: GraphStore,
    gone: dict[Quad, None],
    counts: _Cached,
    holders: Holders,
    staying: Sequence[Container[TripleKey]],
) -> list[TripleKey]:
    """Return the triples that no graph that counts holds any longer when these quads are gone.

    Parameters
    ----------
    staying
        Triples that are not lost in any case.
    """
    losers: dict[TripleKey, list[GraphName]] = {}
    # One change may take a triple from several graphs.
    for quad in gone:
        key = triple_key(quad)
        if not any(key in more for more in staying):
            losers.setdefault(key, []).append(quad.graph_name)
    if len(gone) >= _LARGE:
        graphs = [graph for graph in store.named_graphs() if counts[graph]]
        if _hold_at_most(store, graphs, _MAX_HELD_RATIO * len(gone)):
            held = {triple_key(quad) for quad in remaining(store, gone, graphs)}
            return [key for key in losers if key not in held]
    # For a single triple the look-up below costs as much as this one.
    if len(losers) > 1:
        holders.find(losers)
    lost = []
    for key, losing in losers.items():
        for graph in holders.of(key):
            if graph not in losing and counts[graph]:
                # Still asserted elsewhere.
                break
        else:
            lost.append(key)
    return lost


def _hold_at_most(store: GraphStore, graphs: Iterable[GraphName], limit: int) -> bool:
    """Whether some graphs together hold no more than so many quads."""
    held = 0
    for graph in graphs:
        # To count on beyond the limit would take longer the more is stored of other things.
        held += store.count(graph)
        if held > limit:
            return False
    return True


def remaining(
    store: GraphStore,
    gone: Collection[Quad],
    graphs: Iterable[GraphName],
    inferred: InGraph | None = None,
) -> Iterator[Quad]:
    """Yield the quads of some graphs that are not among those that go.

    Graphs that lose everything are not read, nor is the one whose quads that stay are known.
    """
    losses = _graph_counts(gone)
    for graph in graphs:
        if inferred is not None and graph == inferred.graph:
            yield from inferred
            continue
        lost = losses[graph]
        if lost and lost == store.count(graph):
            continue
        quads = store.quads_for_pattern(None, None, None, graph)
        # Nothing of this graph goes, so nothing has to be compared.
        if not lost:
            yield from quads
            continue
        going = [
            set(part) if isinstance(part, InGraph) else part
            for part in parts_of(gone)
            if not isinstance(part, InGraph) or part.graph == graph
        ]
        for quad in quads:
            if not any(quad in part for part in going):
                yield quad


def _graph_counts(quads: Collection[Quad]) -> Counter[GraphName]:
    """Return how many quads each graph has."""
    counts: Counter[GraphName] = Counter()
    for part in parts_of(quads):
        if isinstance(part, InGraph):
            counts[part.graph] += len(part)
        else:
            counts.update(quad.graph_name for quad in part)
    return counts


class _Cached(dict[GraphName, bool]):
    """Answers of a test about graphs, of which few occur in many statements."""

    def __init__(self, test: Callable[[GraphName], bool]) -> None:
        super().__init__()
        self._test = test

    def __missing__(self, graph: GraphName) -> bool:
        result = self[graph] = self._test(graph)
        return result
