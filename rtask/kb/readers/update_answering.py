"""Updates evaluated inside a reader process, on its own copy of the store.

An update that runs out of time or memory ends together with its reader, so the serving process
never evaluates a WHERE clause from an untrusted caller. The answer is the exact change, which the
writer commits if nothing else was committed meanwhile (:mod:`rtask.kb.readers.updating`).
"""

from __future__ import annotations

import json
from typing import Any

import pyoxigraph as ox
from pyoxigraph import NamedNode

from rtask.kb.commit.access import Access
from rtask.kb.commit.delta import UpdateDataset, evaluate_update
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.answering import refuse, send_all
from rtask.kb.readers.memory import memory_limit, resident_bytes
from rtask.kb.readers.messages import encode_change, message
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import NetChange, apply_change

__all__ = ["MAX_UNDONE", "answer_update", "evaluate"]

# Beyond this many statements a new reader costs less than undoing the change in this one.
MAX_UNDONE = 2_000


def answer_update(store: ox.Store, order: dict[str, Any], pipe: int) -> bool:
    """Evaluate an update on the copy, send its exact change or an error, and undo it.

    Parameters
    ----------
    store
        The reader's copy.
    order
        As encoded by :meth:`rtask.kb.readers.updating.UpdateOrder.encode`.
    pipe
        Descriptor of the reader's pipe.

    Returns
    -------
    Whether the copy is as before, so that the reader can be used again.
    """
    undone = False
    try:
        with memory_limit(order["memory"]):
            outcome, undone = evaluate(store, order)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side must know
        outcome = error
    if isinstance(outcome, MemoryError):
        refuse(pipe, "memory", "")
        return False
    if isinstance(outcome, Exception):
        facts = {"error": type(outcome).__name__, "details": getattr(outcome, "details", {})}
        refuse(pipe, "update", str(outcome), reusable=undone, **facts)
        return undone
    kind = {"kind": "update", "type": "application/n-quads", "gzip": False}
    end = {"bytes": len(outcome), "rss": resident_bytes(), "reusable": undone}
    parts = [message(b"M", json.dumps(kind).encode()), message(b"C", outcome)]
    send_all(pipe, b"".join([*parts, message(b"E", json.dumps(end).encode())]))
    return undone


def evaluate(raw: ox.Store, order: dict[str, Any]) -> tuple[bytes | Exception, bool]:
    """Return the encoded change of an update or its error, and whether the store was restored.

    Parameters
    ----------
    raw, order
        As in :func:`answer_update`.
    """
    store = EmbeddedStore(raw)
    store.is_view = order["view"]
    ontologies = frozenset(order["ontologies"])
    access = Access(order["agent"], order["role"], frozenset(order["rights"])).bind(
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
    outcome: bytes | Exception
    try:
        evaluate_update(store, order["text"], access, dataset, limits, total, whole)
        outcome = encode_change(total.removed, total.added, total.created, total.dropped)
    except Exception as error:  # noqa: BLE001 - the caller sends it on
        outcome = error
    return outcome, _undo(store, whole)


def _undo(store: EmbeddedStore, whole: NetChange) -> bool:
    if len(whole.added) + len(whole.removed) > MAX_UNDONE:
        return False
    apply_change(store, NetChange(whole.added, whole.removed, whole.dropped, whole.created))
    return True
