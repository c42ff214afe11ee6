"""Checkpoints, and recovery after an unclean shutdown.

The store does not need the journal from before a checkpoint. Replaying is idempotent: the last
record that touches a statement decides.
"""

from __future__ import annotations

import json
import logging
import time
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pyoxigraph import Quad

from rtask.errors import StoreError, StoreFormatError
from rtask.kb.durability.blobs import sync_folder
from rtask.kb.durability.disk_space import Reserve
from rtask.kb.durability.journal import JournalFile, Record, encode
from rtask.kb.durability.published import Publisher
from rtask.kb.durability.seal import Seal, require_sealed, seal
from rtask.kb.durability.settings import Settings, write_durably
from rtask.kb.store.apply import apply
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.replacement import is_large_removal, replace_contents
from rtask.kb.store.union import union_change
from rtask.kb.store.writes import Writes

__all__ = ["Checkpoint", "Checkpoints", "recover", "replay", "replay_all", "undo_all"]

_log = logging.getLogger(__name__)
_FILE = "checkpoint.json"
_EVERY_S = 60.0
_EVERY_BYTES = 64 << 20
_MAX_TOUCHED = 50_000
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True)
class Checkpoint:
    """The commit up to which the store is durable without the journal.

    Parameters
    ----------
    seq
        Number of the last commit that the store is sure to hold.
    clean
        Whether the knowledge base was closed properly.
    boot
        Identifier of the boot of the machine during which this was written.
    durable
        Whether commits were acknowledged only once they would survive a power cut.
    journal
        Seal of the journal of a folder that was closed properly; ``None`` if an earlier version
        closed it.
    """

    seq: int = 0
    clean: bool = True
    boot: str = ""
    durable: bool = True
    journal: Seal | None = None

    @classmethod
    def load(cls, folder: Path) -> Checkpoint | None:
        """Read the checkpoint of a folder; ``None`` if there is none.

        Raises
        ------
        StoreFormatError
            The file is not as it was written.
        """
        path = folder / _FILE
        try:
            record = json.loads(path.read_text("utf-8"))
            checksum = record.pop("crc32", None)
            if checksum is not None and checksum != _checksum(record):
                raise ValueError("its checksum does not match")
            return cls(**record)
        except FileNotFoundError:
            return None
        except (ValueError, TypeError, AttributeError) as error:
            raise StoreFormatError(
                f"{path} is damaged: {error}; opening the folder for writing replays the journal",
                damaged="checkpoint",
            ) from error

    def save(self, folder: Path) -> None:
        """Write the checkpoint durably."""
        record = asdict(self)
        whole = {**record, "crc32": _checksum(record)}
        write_durably(folder / _FILE, json.dumps(whole) + "\n")


def _checksum(record: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(record, sort_keys=True).encode())


class Checkpoints:
    """Writes checkpoints of one open knowledge base when they are due."""

    def __init__(
        self, folder: Path, store: GraphStore, journal: JournalFile, durable: bool
    ) -> None:
        self._folder = folder
        self._store = store
        self._journal = journal
        self._durable = durable
        self._publisher = Publisher(folder, store)
        self.reserve = Reserve(folder)
        self._seal: Seal = {}
        self._time = time.monotonic()

    @property
    def journal(self) -> JournalFile:
        """The journal whose commits the checkpoints cover."""
        return self._journal

    def postpone(self) -> None:
        """Restart the clock that counts to the next checkpoint."""
        self._time = time.monotonic()

    def write_ahead(self) -> None:
        """Force to disk what the store holds now, so that the checkpoint has little left to do.

        Commits may go on meanwhile.
        """
        self._store.flush()

    def make(self, seq: int, clean: bool = False) -> None:
        """Make the store durable and record it."""
        # The record last: recovery does not replay what a checkpoint says is stored.
        self._journal.sync(seq)
        self._store.flush()
        if clean:
            self._seal = seal(self._journal, self._seal)
        sealed = self._seal if clean else None
        Checkpoint(seq, clean, boot_id(), self._durable, sealed).save(self._folder)
        if clean:
            self._publisher.clear()
        else:
            self._publisher.publish(seq)
        self._journal.prune(seq)
        self._journal.written_bytes = 0
        self._time = time.monotonic()

    def is_due(self) -> bool:
        """Whether a minute or 64 MiB of journal have passed."""
        if self._journal.written_bytes == 0:
            return False
        waited = time.monotonic() - self._time
        return waited > _EVERY_S or self._journal.written_bytes > _EVERY_BYTES


def boot_id() -> str:
    """Return the identifier of this boot of the machine; empty where the system has none."""
    try:
        return _BOOT_ID.read_text("ascii").strip()
    except OSError:
        return ""


def require_clean(folder: Path) -> None:
    """Raise unless the folder was closed properly and can be read without recovery."""
    checkpoint = Checkpoint.load(folder)
    if checkpoint is not None and checkpoint.clean:
        if checkpoint.journal is not None:
            require_sealed(folder, JournalFile(folder / "journal"), checkpoint.journal)
    else:
        raise StoreError(
            f"{folder} was not closed properly; open it once for writing to recover it",
            recover=True,
        )


@dataclass(frozen=True)
class Recovered:
    """Result of :func:`recover`.

    Parameters
    ----------
    settings
        With a new epoch if acknowledged commits may be lost.
    last_seq
        Number of the last commit in the journal.
    may_be_ahead
        Whether the store may hold parts of commits that the journal lost, because the machine
        stopped; they were never acknowledged.
    """

    settings: Settings
    last_seq: int
    may_be_ahead: bool = False


def recover(folder: Path, store: GraphStore, journal: JournalFile, settings: Settings) -> Recovered:
    """Replay the journal into the store after an unclean shutdown.

    Raises
    ------
    StoreFormatError
        The journal was changed, truncated or deleted after the folder was closed.
    """
    try:
        checkpoint = Checkpoint.load(folder)
    except StoreFormatError as error:
        _log.warning("%s", error)
        checkpoint = None
    checkpoint = checkpoint or _checkpoint_lost(folder, store, journal)
    if checkpoint.clean:
        if checkpoint.journal is not None:
            require_sealed(folder, journal, checkpoint.journal)
        return Recovered(settings, checkpoint.seq)
    journal.cut_torn_end()
    last = replay_all(store, journal.records(checkpoint.seq), settings.is_merged) or checkpoint.seq
    _log.info("recovered after an unclean shutdown: replayed up to commit %d", last)
    was_restarted = checkpoint.boot != boot_id()
    # Commits that only the system's cache held are gone, and others will get their numbers: whoever
    # has seen the old ones, a follower or a cache, must be able to tell.
    if not checkpoint.durable and was_restarted:
        settings = replace(settings, epoch=Settings.new().epoch)
        settings.save(folder)
        _log.warning("the machine was restarted: the newest commits may be lost; new epoch")
    sync_folder(folder)
    return Recovered(settings, last, was_restarted)


def _checkpoint_lost(folder: Path, store: GraphStore, journal: JournalFile) -> Checkpoint:
    """Return a substitute for a missing checkpoint, based on the journal if there is one."""
    segments = journal.segments()
    if segments:
        _log.warning("without a usable %s the whole journal is replayed", folder / _FILE)
        return Checkpoint(int(segments[0].stem) - 1, clean=False, boot=boot_id())
    if len(store):
        raise StoreFormatError(
            f"{folder} has lost both {_FILE} and its journal; restore a backup, or continue "
            f"without its history: rtask rebuild journal -d {folder}",
            damaged="journal",
        )
    return Checkpoint()


def replay_all(store: GraphStore, records: Iterable[Record], merged: bool) -> int:
    """Apply records, oldest first, many in one step; return the number of the last one, or 0.

    Of several records that touch a statement the last one decides, so only what it says is looked
    up and stored.
    """
    last = 0
    touched: dict[Quad, bool] = {}
    for record in records:
        last = record.seq
        if record.graphs("created") or record.graphs("dropped"):
            # A graph that goes takes its statements along, so what came before is stored before.
            _store_touched(store, touched, merged)
            replay(store, record, merged)
            continue
        touched.update(dict.fromkeys(record.removed(), False))
        touched.update(dict.fromkeys(record.added(), True))
        if len(touched) > _MAX_TOUCHED:
            _store_touched(store, touched, merged)
    _store_touched(store, touched, merged)
    return last


def undo_all(store: GraphStore, records: Iterable[Record], merged: bool) -> None:
    """Take back records, newest first, many in one step; the store may lack some of the newest."""
    touched: dict[Quad, bool] = {}
    for record in records:
        touched.update(dict.fromkeys(record.added(), False))
        touched.update(dict.fromkeys(record.removed(), True))
        created, dropped = record.graphs("created"), record.graphs("dropped")
        if created or dropped or len(touched) > _MAX_TOUCHED:
            _store_touched(store, touched, merged)
        if created or dropped:
            missing = [graph for graph in dropped if not store.contains_named_graph(graph)]
            surplus = [graph for graph in created if store.contains_named_graph(graph)]
            _apply(store, Writes(created=missing, dropped=surplus), merged)
    _store_touched(store, touched, merged)


def _store_touched(store: GraphStore, touched: dict[Quad, bool], merged: bool) -> None:
    removed = [quad for quad, is_there in touched.items() if not is_there and quad in store]
    added = [quad for quad, is_there in touched.items() if is_there and quad not in store]
    touched.clear()
    if removed or added:
        _apply(store, Writes(removed, added), merged)


def replay(store: GraphStore, record: Record, merged: bool) -> None:
    """Apply a record to a store that may contain it already."""
    removed = [quad for quad in record.removed() if quad in store]
    added = [quad for quad in record.added() if quad not in store]
    created, dropped = record.graphs("created"), record.graphs("dropped")
    if removed or added or created or dropped:
        _apply(store, Writes(removed, added, created, dropped), merged)


def _apply(store: GraphStore, change: Writes, merged: bool) -> None:
    """Make a change of named graphs, which a journal holds, and that of their union."""
    if merged and is_large_removal(store, change):
        replace_contents(store, change)
        return
    union = union_change(store, change.removed, change.added) if merged else Overlay(store)
    removed, added = [*change.removed, *union.removed], [*union.added, *change.added]
    apply(store, Writes(removed, added, change.created, change.dropped))


def fill_gap(journal: JournalFile, journalled: int, stored: int) -> None:
    """Record commits that reached the store but not the journal before a power cut.

    They were never acknowledged, but recording them keeps the numbers without a gap.
    """
    for seq in range(journalled + 1, stored + 1):
        header = {"seq": seq, "time": "", "agent": None, "note": None, "kind": "recovered"}
        journal.append_record(encode({**header, "removed": 0, "added": 0}, b""), seq)
