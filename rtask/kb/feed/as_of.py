"""Earlier states of a graph: a copy of the current state with later commits undone.

The copy consists of hard links, so it costs as much as the commits to undo, whatever the size of
the graph.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path

from pyoxigraph import NamedNode, Store

from rtask.errors import GoneError, UnsupportedError, UsageError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.disk_space import full_disk, means_full
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, NoJournal, Record
from rtask.kb.durability.private_copy import PastCopy
from rtask.kb.durability.recovery import undo_all
from rtask.kb.feed.feed import Feed
from rtask.kb.store.embedded import EmbeddedStore, embedded_store
from rtask.kb.store.graphs import Graphs

__all__ = ["commit_at", "copy_as_of", "may_lack_some", "records_after", "turn_back"]

_FLUSHED_BYTES = 1 << 20
"""Undone text from which the copy is flushed: less is read anew from its log by each reader."""


def commit_at(files: Files, time: dt.datetime) -> int:
    """Return the number of the last commit whose clock showed no later time; 0 before the first.

    Where the clock was set back, later commits may show earlier times: the number decides, so the
    state includes all that were made before that commit.

    Raises
    ------
    GoneError
        The journal no longer reaches so far back.
    UnsupportedError
        The store keeps no journal.
    """
    first, latest = _journal(files).marks.at(time)
    if latest is None and first is not None and first.seq > 1:
        raise GoneError(
            f"the journal begins at commit {first.seq}, which is after {time.isoformat()}"
        )
    return 0 if latest is None else latest.seq


def copy_as_of(
    files: Files, graphs: Graphs, feed: Feed, last_seq: int, seq: int
) -> tuple[Files, Catalogue, Writer]:
    """Return the state of a graph after a commit, as a read-only copy.

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
    StorageFullError
        The disk has no room for the copy.
    """
    journal = _journal(files)
    if seq < 0 or seq > last_seq:
        raise UsageError(f"there is no commit {seq}; the last one is {last_seq}")
    feed.require_retained(seq)
    assert files.folder is not None
    try:
        held = PastCopy(files.folder)
    except OSError as error:
        if means_full(error):
            raise full_disk(files.folder, "for a copy of an earlier state") from error
        raise UnsupportedError(
            f"an earlier state needs a folder that can be written: {files.folder}"
        ) from error
    try:
        store = _turned_back(files, graphs, journal, held.path, seq)
    except BaseException as error:
        held.release()
        if means_full(error):
            raise full_disk(files.folder, "for a copy of an earlier state") from error
        raise
    return _closed_for_writing(files, graphs, store, held, seq)


def _journal(files: Files) -> JournalFile:
    if isinstance(files.journal, JournalFile) and files.folder is not None:
        return files.journal
    raise UnsupportedError(
        "a store in memory keeps no journal, so earlier states are unavailable; use a folder"
    )


def _turned_back(
    files: Files, graphs: Graphs, journal: JournalFile, folder: Path, seq: int
) -> EmbeddedStore:
    path = str(folder / "store")
    turn_back(files, graphs, journal, path, seq)
    return EmbeddedStore(Store.read_only(path), path)


def turn_back(files: Files, graphs: Graphs, journal: JournalFile, path: str, seq: int) -> None:
    """Copy the store of a graph, and undo in the copy the commits after one.

    Raises
    ------
    UnsupportedError
        A bulk load was made since then.
    """
    # A commit stored while copying may or may not be in the copy. Undoing one that is not does no
    # harm.
    with files.store.complete():
        embedded_store(files.store, "an earlier state").raw.backup(path)
    store = EmbeddedStore(Store(path), path)
    try:
        store.is_view = files.settings.is_view
        records = records_after(journal, seq)
        undo_all(store, reversed(records), files.settings.is_merged)
        # Counting graphs takes longer than undoing a few commits, so only where it can differ.
        if not files.settings.plain and any(map(may_lack_some, records)):
            _require_whole(store, graphs, Catalogue(store, graphs), seq)
        if sum(len(record.body) for record in records) > _FLUSHED_BYTES:
            store.flush()
    finally:
        store.close()


def records_after(journal: JournalFile, seq: int) -> list[Record]:
    """Return the records after a commit, oldest first, without reading those before."""
    mark = next(journal.marks.after(seq), None)
    return [] if mark is None else list(journal.records_from(mark.segment, mark.start))


def may_lack_some(record: Record) -> bool:
    """Whether a record may hold less than its commit changed: bulk loads, and lost records."""
    return bool(record.header.get("partial")) or record.header.get("kind") != "delta"


def _require_whole(store: EmbeddedStore, graphs: Graphs, catalogue: Catalogue, seq: int) -> None:
    """Compare graph sizes with the catalogue of that commit, since the journal omits bulk loads."""
    for graph in store.named_graphs():
        if graph in (graphs.meta, graphs.provenance) or not isinstance(graph, NamedNode):
            continue
        if store.count(graph) != catalogue.triple_count(graph):
            raise UnsupportedError(
                f"{graph} was loaded in bulk after commit {seq}, which the journal does not hold; "
                "restore a backup",
                graph=graph.value,
            )


def _closed_for_writing(
    files: Files, graphs: Graphs, store: EmbeddedStore, held: PastCopy, seq: int
) -> tuple[Files, Catalogue, Writer]:
    copy = Files(files.settings, store, files.blobs, NoJournal(), last_seq=seq, held=held)
    copy.store.is_view = files.settings.is_view
    catalogue = Catalogue(copy.store, graphs)
    plain = files.settings.plain
    committer = Committer(
        copy.store, graphs, plain, copy.blobs, catalogue, None, copy.journal, last_seq=seq
    )
    writer = Writer(committer)
    writer.close()
    return copy, catalogue, writer
