"""Large removals: write what stays to a file, empty the store, and load the file.

Removing statements one by one costs several times as much as loading those that stay. The file is
complete and on disk before the store is emptied, and opening the folder after a kill or a power cut
loads it again.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Collection, Iterable
from itertools import chain, islice
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode, Quad, RdfFormat, parse, serialize

from rtask.errors import StoreError
from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.quads import InGraph, parts_of
from rtask.kb.store.union import remaining
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DEFAULT, GraphName

__all__ = [
    "ReplacementError",
    "complete_replacement",
    "is_large_removal",
    "replace_contents",
]

_FILE = "staying.nq"
MIN_REPLACED = 50_000
_BLOCK = 100_000
_MAX_STAYING_RATIO = 2
"""Loading a statement takes about half the time of removing one."""


class ReplacementError(StoreError):
    """The store was emptied and could not be filled again; the next opening does it."""


def is_large_removal(store: GraphStore, change: Writes) -> bool:
    """Whether loading what stays is quicker than removing what goes."""
    removed = len(change.removed)
    if store.gate is None or store.is_view or removed < MIN_REPLACED:
        return False
    named = sum(map(store.count, store.named_graphs()))
    return named - removed <= _MAX_STAYING_RATIO * removed


def replace_contents(store: GraphStore, change: Writes) -> None:
    """Load again what the named graphs hold after a change, and the union of them.

    The journal must hold the change durably. Reads in this process wait meanwhile; those that have
    begun go on with what they began with.

    Raises
    ------
    ReplacementError
        The change will be completed when the folder is opened again.
    """
    graphs = [*(g for g in store.named_graphs() if g not in change.dropped), *change.created]
    staying = remaining(store, change.removed, store.named_graphs(), change.inferred)
    gate, folder = store.gate, store.folder
    assert gate is not None
    if folder is None:
        text = io.BytesIO()
        serialize(staying, output=text, format=RdfFormat.N_QUADS)
        with gate.excluding():
            _load(store, parse(text.getvalue(), format=RdfFormat.N_QUADS), change.added, graphs)
    else:
        temporary = folder / f"{_FILE}.tmp"
        with temporary.open("wb") as out:
            # Empty graphs have no statements; a comment names them for an opening after a crash.
            out.write(b"#" + json.dumps([str(getattr(g, "value", "")) for g in graphs]).encode())
            out.write(b"\n")
            serialize(staying, output=out, format=RdfFormat.N_QUADS)
            out.flush()
            os.fsync(out.fileno())
        with gate.excluding():
            temporary.rename(folder / _FILE)
            try:
                _sync_folder(folder)
                _load_file(store, folder, change.added)
            except Exception as error:  # whatever it is, the store is no longer what it was
                raise ReplacementError(
                    f"a large removal could not be completed: {error}; open the knowledge base "
                    "again"
                ) from error
    store.tell(Writes(is_replacement=True))


def complete_replacement(store: GraphStore, folder: Path) -> bool:
    """Complete a replacement that a crash interrupted; return whether there was one.

    What its commit added, the journal brings.
    """
    (folder / f"{_FILE}.tmp").unlink(missing_ok=True)
    if not (folder / _FILE).exists():
        return False
    _load_file(store, folder)
    return True


def _load_file(store: GraphStore, folder: Path, added: Collection[Quad] = ()) -> None:
    path = folder / _FILE
    with path.open("rb") as file:
        graphs = [NamedNode(name) for name in json.loads(file.readline()[1:]) if name]
    _load(store, parse(path=path, format=RdfFormat.N_QUADS), added, graphs)
    embedded_store(store, "replacing everything").raw.flush()
    path.unlink()


def _load(
    store: GraphStore,
    staying: Iterable[Quad],
    added: Collection[Quad],
    graphs: Iterable[GraphName],
) -> None:
    raw = embedded_store(store, "replacing everything").raw
    raw.clear()
    few: list[Collection[Quad]] = []
    for part in parts_of(added):
        if not isinstance(part, InGraph):
            few.append(part)
            continue
        if Graphs.is_joined(part.graph):
            store.bulk_extend(InGraph(part.triples, DEFAULT))
        store.bulk_extend(part)
    rest = chain(staying, *few)
    while block := list(islice(rest, _BLOCK)):
        joined = (quad for quad in block if Graphs.is_joined(quad.graph_name))
        store.bulk_extend([Quad(quad.subject, quad.predicate, quad.object) for quad in joined])
        store.bulk_extend(block)
    store.changed()
    for graph in graphs:
        if isinstance(graph, NamedNode | BlankNode):
            raw.add_graph(graph)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
