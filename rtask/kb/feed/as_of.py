"""The knowledge base as it was: the graph of now, with the commits since then undone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Quad, Store

from rtask.errors import UnsupportedError, UsageError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.commit import Committer
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, NoJournal, Record
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import DEFAULT

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["as_of"]


def as_of(kb: KnowledgeBase, files: Files, seq: int) -> KnowledgeBase:
    """Return a copy in memory, for reading only, of what a knowledge base held after a commit.

    Raises
    ------
    UsageError
        There is no such commit.
    GoneError
        The journal no longer reaches back so far.
    UnsupportedError
        The store keeps no journal, or a load beyond the size of a commit lies between.
    """
    journal = files.journal
    if not isinstance(journal, JournalFile):
        raise UnsupportedError("this store keeps no journal; open a folder to look back")
    if seq < 0 or seq > kb.seq:
        raise UsageError(f"there is no commit {seq}; the last one is {kb.seq}")
    kb.feed.require_kept(seq)
    store = Store()
    # What is committed while this copies may be in the copy or not: undoing does no harm to a
    # statement that has not come yet.
    quads = kb.store.quads_for_pattern(None, None, None, None)
    store.bulk_extend(q for q in quads if kb.plain or isinstance(q.graph_name, NamedNode))
    for graph in kb.store.named_graphs():
        store.add_graph(graph)
    for record in reversed(list(journal.records(seq))):
        _undo(store, record)
    catalogue = Catalogue(GraphStore(store), kb.graphs)
    if not kb.plain:
        _require_whole(store, kb.graphs, catalogue, seq)
        if not files.settings.is_view:
            union = [q for q in store if not Graphs.is_quarantine(q.graph_name)]
            store.bulk_extend(Quad(q.subject, q.predicate, q.object, DEFAULT) for q in union)
    return _opened(kb, files, store, seq)


def _undo(store: Store, record: Record) -> None:
    for quad in record.added():
        store.remove(quad)
    for graph in record.graphs("created"):
        store.remove_graph(graph)
    store.extend(record.removed())
    for graph in record.graphs("dropped"):
        store.add_graph(graph)


def _require_whole(store: Store, graphs: Graphs, catalogue: Catalogue, seq: int) -> None:
    """Compare the sizes with the catalogue of that time; loads in bulk are not in the journal."""
    for graph in store.named_graphs():
        if graph in (graphs.meta, graphs.provenance) or not isinstance(graph, NamedNode):
            continue
        size = sum(1 for _ in store.quads_for_pattern(None, None, None, graph))
        if size != catalogue.triple_count(graph):
            raise UnsupportedError(
                f"{graph} was loaded in bulk after commit {seq}, which the journal does not hold; "
                "restore a backup",
                graph=graph.value,
            )


def _opened(kb: KnowledgeBase, files: Files, store: Store, seq: int) -> KnowledgeBase:
    from rtask.knowledge_base import KnowledgeBase

    copy = Files(files.settings, GraphStore(store), files.blobs, NoJournal(), last_seq=seq)
    copy.store.is_view = files.settings.is_view
    catalogue = Catalogue(copy.store, kb.graphs)
    committer = Committer(
        copy.store, kb.graphs, kb.plain, copy.blobs, catalogue, None, copy.journal, last_seq=seq
    )
    writer = Writer(committer)
    writer.close()
    return KnowledgeBase(copy, catalogue, None, writer)
