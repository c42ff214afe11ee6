"""Updates evaluated inside a reader process, on its own copy of the store.

An update that runs out of time or memory ends together with its reader, so the serving process
never evaluates a WHERE clause from an untrusted caller. The answer is the exact change, which the
writer commits if nothing else was committed meanwhile (:mod:`rtask.kb.readers.updating`).
"""

from __future__ import annotations

import json
from typing import Any

import pyoxigraph as ox
from pyoxigraph import NamedNode, Quad, RdfFormat

from rtask.kb.commit.access import Access
from rtask.kb.commit.delta import UpdateDataset, evaluate_update
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import NetChange, apply_change

__all__ = ["evaluate"]

# Beyond this many statements a new reader costs less than undoing the change in this one.
MAX_UNDONE = 2_000


def evaluate(raw: ox.Store, order: dict[str, Any]) -> tuple[bytes, bool]:
    """Return the encoded change of an update, and whether the store was restored afterwards.

    Parameters
    ----------
    raw
        The reader's copy.
    order
        As encoded by :meth:`rtask.kb.readers.updating.UpdateOrder.encode`.

    Raises
    ------
    RtaskError
        With the attribute ``undone``: whether the store was restored.
    """
    store = GraphStore(raw)
    store.is_view = order["view"]
    ontologies = frozenset(order["ontologies"])
    access = Access(order["agent"], order["role"]).bind(
        Graphs(order["graphs"]),
        lambda graph: isinstance(graph, NamedNode) and graph.value in ontologies,
        order["plain"],
    )
    dataset = UpdateDataset(
        tuple(map(NamedNode, order["using"])),
        tuple(map(NamedNode, order["using_named"])),
        order["base"],
    )
    limits = UpdateLimits(**order["limits"])
    total, whole = NetChange(), NetChange()
    try:
        evaluate_update(store, order["text"], access, dataset, limits, total, whole)
        payload = _encode(total)
    except Exception as error:
        error.undone = _undo(store, whole)  # type: ignore[attr-defined]
        raise
    return payload, _undo(store, whole)


def _undo(store: GraphStore, whole: NetChange) -> bool:
    if len(whole.added) + len(whole.removed) > MAX_UNDONE:
        return False
    apply_change(store, NetChange(whole.added, whole.removed, whole.dropped, whole.created))
    return True


def _encode(change: NetChange) -> bytes:
    removed, added = _n_quads(change.removed), _n_quads(change.added)
    head = {
        "removed": len(removed),
        "created": [graph.value for graph in change.created if isinstance(graph, NamedNode)],
        "dropped": [graph.value for graph in change.dropped if isinstance(graph, NamedNode)],
    }
    return json.dumps(head).encode() + b"\n" + removed + added


def _n_quads(quads: dict[Quad, None]) -> bytes:
    return ox.serialize(list(quads), format=RdfFormat.N_QUADS) or b""
