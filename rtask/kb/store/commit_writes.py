"""What a commit writes: the author's change, what follows from it, notes, and the union of all."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from pyoxigraph import Quad

from rtask.kb.store.embedded import LARGE
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Holders, Overlay
from rtask.kb.store.quads import Derived, InGraph, QuadChain, parts_of, quads_written
from rtask.kb.store.union import Copies, is_empty, union_change
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DEFAULT, GraphName

__all__ = ["MAX_LATE", "MAX_NOTED_LATE", "all_writes", "with_union"]

MAX_LATE = 1_000
"""Before changes with more statements the notes that wait are stored, so that what is looked up of
them stays true."""
MAX_NOTED_LATE = 12_000
"""Changes with more statements, those derived included, store their notes at once.

Without its notes a change that only adds needs no text of all its statements, which the store would
parse.
"""


def all_writes(change: Overlay, derived: Derived, notes: Overlay) -> Writes:
    """Return all that a commit changes in named graphs."""
    return Writes(
        QuadChain(change.removed, derived.removed, notes.removed),
        QuadChain(*_written_if_large(change.added), *_written_if_large(derived.added), notes.added),
        list(change.created),
        list(change.dropped),
        inferred=derived.inferred,
    )


def _written_if_large(quads: Collection[Quad]) -> list[InGraph] | list[Collection[Quad]]:
    return quads_written(quads) if len(quads) > LARGE else [quads]


def with_union(
    store: GraphStore, writes: Writes, fresh: Collection[GraphName], holders: Holders
) -> Writes:
    """Return the writes of named graphs together with those of their union.

    Parameters
    ----------
    fresh
        Graphs whose statements are hardly ever in another one.
    holders
        What has been looked up of the change already.
    """
    # What is derived or large is copied as it is: the store ignores what it holds, and
    # looking up every statement of a file costs more.
    parts = parts_of(writes.added)
    whole = [part for part in parts if isinstance(part, InGraph)]
    looked_up = QuadChain(*(part for part in parts if not isinstance(part, InGraph)))
    copied = [part.triples for part in whole if Graphs.is_joined(part.graph)]
    copies: list[Collection[Quad]] = [InGraph(triples, DEFAULT) for triples in copied]
    # A new knowledge base, into which the ontology goes, has nothing to look up.
    if not writes.removed and len(looked_up) > MAX_LATE and is_empty(store):
        copies.append(Copies(looked_up))
        looked_up = QuadChain()
    union = union_change(store, writes.removed, looked_up, fresh, copied, holders)
    return replace(
        writes,
        removed=QuadChain(writes.removed, union.removed),
        added=QuadChain(union.added, *copies, writes.added),
        has_union=True,
    )
