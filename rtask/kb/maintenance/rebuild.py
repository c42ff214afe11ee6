"""Rebuild the store from the journal, or continue without a lost journal.

Both work on a folder that is not open. Replaced files are moved aside, never deleted.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pyoxigraph import Literal, NamedNode, Store

import ontology
from rtask.errors import StoreError, StoreFormatError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.durability.journal import JournalFile, Record, encode
from rtask.kb.durability.lock import FolderLock
from rtask.kb.durability.recovery import Checkpoint, boot_id, replay_all
from rtask.kb.durability.saved_closures import discard_saved
from rtask.kb.durability.seal import seal
from rtask.kb.durability.settings import Settings
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graphs import Graphs

__all__ = ["rebuild_journal", "rebuild_store"]

_COUNT = NamedNode(f"{ontology.NS}tripleCount")


def rebuild_store(folder: Path) -> int:
    """Replay the whole journal into a new store; return the number of the last commit.

    Raises
    ------
    StoreFormatError
        The journal does not begin with the first commit, has a gap, is damaged, or lacks
        statements that the catalogue counts; the folder is left unchanged.
    StoreLockedError
        The folder is open.
    """
    settings = Settings.load(folder)
    lock = FolderLock(folder, shared=False)
    try:
        fresh = folder / "store.rebuilt"
        if fresh.exists():
            _set_aside(fresh)
        store = EmbeddedStore(Store(str(fresh)), str(fresh))
        store.is_view = settings.is_view
        try:
            journal = JournalFile(folder / "journal")
            journal.cut_torn_end()
            last = _replay_all(folder, store, journal, settings)
            _require_complete(folder, store, settings)
            store.flush()
        finally:
            store.close()
        # Copies of the damaged store may be damaged as well.
        shutil.rmtree(folder / "past", ignore_errors=True)
        if (folder / "store").exists():
            _set_aside(folder / "store")
        discard_saved(folder)
        fresh.rename(folder / "store")
        Checkpoint(last, True, boot_id(), journal=seal(journal)).save(folder)
    finally:
        lock.release()
    return last


def _replay_all(
    folder: Path, store: EmbeddedStore, journal: JournalFile, settings: Settings
) -> int:
    def gapless() -> Iterator[Record]:
        last = 0
        for record in journal.records():
            if record.seq != last + 1:
                raise StoreFormatError(
                    f"the journal in {folder} goes from commit {last} to {record.seq}; those "
                    "between are missing or were deleted because of their age; restore a backup"
                )
            _require_recorded(folder, record)
            last = record.seq
            yield record

    return replay_all(store, gapless(), settings.is_merged)


def _require_recorded(folder: Path, record: Record) -> None:
    if record.header.get("kind") == "recovered":
        raise StoreFormatError(
            f"the journal in {folder} does not hold commit {record.seq}, which only the store "
            "kept; restore a backup"
        )


def _require_complete(folder: Path, store: EmbeddedStore, settings: Settings) -> None:
    """Compare the sizes of graphs with those recorded in the catalogue."""
    if settings.plain:
        return
    meta = Graphs(settings.base).meta
    counted = {
        quad.subject: int(quad.object.value)
        for quad in store.quads_for_pattern(None, _COUNT, None, meta)
        if isinstance(quad.object, Literal)
    }
    counts: Counter[object] = Counter({graph: store.count(graph) for graph in store.named_graphs()})
    short = sorted(
        f"{graph} ({counts[graph]} of {count})"
        for graph, count in counted.items()
        if counts[graph] < count and graph != meta
    )
    if short:
        raise StoreFormatError(
            f"the journal in {folder} does not hold everything: {', '.join(short[:5])}; large "
            "files are loaded past it, restore a backup",
            graphs=short,
        )


def rebuild_journal(folder: Path) -> int:
    """Move a lost or damaged journal aside and start another; return the last commit's number.

    No statement is lost; history, earlier states and the positions of subscribers before this point
    are, so the folder gets a new epoch.

    Raises
    ------
    StoreError
        The store may lag behind the journal because the folder was not closed properly.
    StoreLockedError
        The folder is open.
    """
    settings = Settings.load(folder)
    lock = FolderLock(folder, shared=False)
    try:
        checkpoint = Checkpoint.load(folder)
        if checkpoint is not None and not checkpoint.clean:
            raise StoreError(
                f"{folder} was not closed properly; open it once for writing to recover it"
            )
        seq = checkpoint.seq if checkpoint is not None else _stored_seq(folder, settings)
        journal = folder / "journal"
        if journal.exists():
            _set_aside(journal)
        fresh = JournalFile(journal)
        if seq:
            header = {"seq": seq, "time": "", "agent": None, "note": None, "kind": "recovered"}
            fresh.append_record(encode({**header, "removed": 0, "added": 0}, b""), seq)
            fresh.sync(seq)
        fresh.close()
        replace(settings, epoch=Settings.new().epoch).save(folder)
        Checkpoint(seq, True, boot_id(), journal=seal(fresh)).save(folder)
    finally:
        lock.release()
    return seq


def _stored_seq(folder: Path, settings: Settings) -> int:
    """Return the number of the last commit that is recorded in the store itself."""
    if settings.plain:
        raise StoreFormatError(
            f"{folder} has neither checkpoint nor journal, and a plain store does not number its "
            "commits; export it with pyoxigraph and load it into a new one"
        )
    store = EmbeddedStore(Store.read_only(str(folder / "store")))
    try:
        return Catalogue(store, Graphs(settings.base)).seq
    finally:
        store.close()


def _set_aside(path: Path) -> None:
    moment = time.strftime("%Y%m%dT%H%M%S")
    path.rename(path.with_name(f"{path.name}.{moment}.{time.time_ns() % 1_000_000:06d}"))
