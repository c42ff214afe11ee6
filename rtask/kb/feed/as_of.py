"""Earlier states of a graph: a copy of the current state with later commits undone."""

from __future__ import annotations

from pyoxigraph import NamedNode, Quad, Store

from rtask.errors import UnsupportedError, UsageError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.commit import Committer
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, NoJournal, Record
from rtask.kb.feed.feed import Feed
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import DEFAULT

__all__ = ["copy_as_of"]


def copy_as_of(
    files: Files, graphs: Graphs, feed: Feed, last_seq: int, seq: int
) -> tuple[Files, Catalogue, Writer]:
    """Return the state of a graph after a commit, as a read-only copy in memory.

    Parameters
    ----------
    files, graphs, feed
        Parts of the current graph.
    last_seq
        Number of the current graph's last commit.
    seq
        Number of the commit to return to.

    Raises
    ------
    UsageError
        There is no such commit.
    GoneError
        The journal no longer contains the commits since then.
    UnsupportedError
        The store keeps no journal, or a bulk load was made since then.
    """
    journal = files.journal
    if not isinstance(journal, JournalFile):
        raise UnsupportedError(
            "a store in memory keeps no journal, so earlier states are unavailable; use a folder"
        )
    if seq < 0 or seq > last_seq:
        raise UsageError(f"there is no commit {seq}; the last one is {last_seq}")
    feed.require_retained(seq)
    plain = files.settings.plain
    store = Store()
    # A commit stored while copying may or may not be in the copy. Undoing one that is not does no
    # harm.
    quads = files.store.quads_for_pattern(None, None, None, None)
    store.bulk_extend(q for q in quads if plain or isinstance(q.graph_name, NamedNode))
    for graph in files.store.named_graphs():
        store.add_graph(graph)
    for record in reversed(list(journal.records(seq))):
        _undo(store, record)
    catalogue = Catalogue(EmbeddedStore(store), graphs)
    if not plain:
        _require_whole(store, graphs, catalogue, seq)
        if not files.settings.is_view:
            union = [q for q in store if not Graphs.is_quarantine(q.graph_name)]
            store.bulk_extend(Quad(q.subject, q.predicate, q.object, DEFAULT) for q in union)
    return _closed_for_writing(files, graphs, store, seq)


def _undo(store: Store, record: Record) -> None:
    for quad in record.added():
        store.remove(quad)
    for graph in record.graphs("created"):
        store.remove_graph(graph)
    store.extend(record.removed())
    for graph in record.graphs("dropped"):
        store.add_graph(graph)


def _require_whole(store: Store, graphs: Graphs, catalogue: Catalogue, seq: int) -> None:
    """Compare graph sizes with the catalogue of that commit, since the journal omits bulk loads."""
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


def _closed_for_writing(
    files: Files, graphs: Graphs, store: Store, seq: int
) -> tuple[Files, Catalogue, Writer]:
    copy = Files(files.settings, EmbeddedStore(store), files.blobs, NoJournal(), last_seq=seq)
    copy.store.is_view = files.settings.is_view
    catalogue = Catalogue(copy.store, graphs)
    plain = files.settings.plain
    committer = Committer(
        copy.store, graphs, plain, copy.blobs, catalogue, None, copy.journal, last_seq=seq
    )
    writer = Writer(committer)
    writer.close()
    return copy, catalogue, writer
