"""Files of a knowledge base: find, create, open and close them.

::

    DIR/kb.json           settings
        lock              which process has it open
        store/            the quads
        journal/          every commit as text
        checkpoint.json   last commit that the store holds durably without the journal
        closure-<seq>/    what the reasoner had derived at a commit, to go on from
        blobs/            byte strings by digest
        published/        snapshots for processes that read beside the writer
        followers/        their copies, which they keep current
        past/             copies of earlier states, see :mod:`rtask.kb.durability.ladder`
        branches/         copies that are written beside it, see :mod:`rtask.kb.branches`
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Store

from rtask.errors import NoStoreError, StoreError, StoreFormatError, StoreLockedError
from rtask.kb.durability.blobs import BlobStore
from rtask.kb.durability.disk_space import Reserve, full_disk, means_full
from rtask.kb.durability.journal import JournalFile, JournalWithHistory, NoJournal
from rtask.kb.durability.ladder import Ladder
from rtask.kb.durability.lock import FolderLock
from rtask.kb.durability.private_copy import PastCopy, PrivateCopy
from rtask.kb.durability.published import HeldSnapshot, hold_newest
from rtask.kb.durability.recovery import Checkpoints, recover, require_clean
from rtask.kb.durability.saved_closures import SavedClosures, TracedJournal
from rtask.kb.durability.settings import Settings
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.replacement import complete_replacement

__all__ = ["Files", "find", "make", "open_for_reading", "open_for_writing", "open_in_memory"]

_log = logging.getLogger(__name__)

_TO_WRITE = "to open it for writing; make room, or open it with mode='r' to read"


@dataclass
class Files:
    """Open files of a knowledge base.

    Parameters
    ----------
    last_seq
        Number of the last commit in the journal.
    may_be_ahead
        Whether the store may hold statements of commits that the journal lost.
    held
        The snapshot that is read in the place of the folder's own store, beside a writer, or the
        copy of one: kept current, or turned back to an earlier commit.
    is_branch
        Whether these are the files of a branch, which is written without checkpoints.
    ladder
        Kept copies of earlier states; ``None`` where this process does not write the folder.
    """

    settings: Settings
    store: GraphStore
    blobs: BlobStore
    journal: JournalWithHistory | NoJournal
    folder: Path | None = None
    lock: FolderLock | None = None
    checkpoints: Checkpoints | None = None
    last_seq: int = 0
    may_be_ahead: bool = False
    held: HeldSnapshot | PrivateCopy | PastCopy | None = None
    is_branch: bool = False
    ladder: Ladder | None = None

    @property
    def is_frozen(self) -> bool:
        """Whether the store is never written while it is open."""
        # A branch takes writes of its own, and a copy follows those of the original.
        if self.is_branch or isinstance(self.held, PrivateCopy):
            return False
        return self.checkpoints is None

    @property
    def read_from(self) -> Path | None:
        """Folder with the folder ``store`` that is open."""
        return self.held.path if self.held is not None else self.folder

    def saved_closures(self) -> SavedClosures | None:
        """Return the closures saved in the folder; ``None`` for a store in memory."""
        if self.folder is None or not isinstance(self.journal, TracedJournal) or self.held:
            return None
        return SavedClosures(self.folder, self.journal, self.settings.epoch)

    def close(self, seq: int) -> None:
        """Force everything to disk and release the files."""
        try:
            checkpoints = self.checkpoints
            # A store that takes no writes is left to the journal, which the next opening replays.
            if checkpoints is not None and self.store.is_open and not self.store.is_stuck:
                checkpoints.reserve.spend_on(lambda: checkpoints.make(seq, clean=True))
                checkpoints.reserve.give_back()
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Release the files without a checkpoint."""
        if not isinstance(self.journal, NoJournal):
            self.journal.close()
        self.store.close()
        if self.lock is not None:
            self.lock.release()
        if self.held is not None:
            self.held.release()


def find(folder: Path, mode: str) -> Settings | None:
    """Return the settings of a knowledge base, or ``None`` where one may be created.

    Raises
    ------
    StoreFormatError
        The path is something else; the error says what.
    """
    if folder.exists() and not folder.is_dir():
        raise NoStoreError(f"{folder} is a file; a knowledge base is a folder")
    if (folder / "kb.json").exists():
        if mode == "new":
            raise StoreFormatError(f"{folder} is already a knowledge base; open it with mode='rw'")
        return Settings.load(folder)
    if mode == "r" or (folder.is_dir() and any(map(_is_stored_file, folder.iterdir()))):
        return Settings.load(folder)
    return None


def _is_stored_file(path: Path) -> bool:
    """Whether a file shows that its folder is in use, unlike what a crash while creating leaves."""
    return path.name != "kb.tmp"


def make(folder: Path, settings: Settings) -> None:
    """Create a folder that contains only its settings."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        settings.save(folder)
    except OSError as error:
        raise StoreError(f"cannot create a knowledge base in {folder}: {error.strerror}") from error


def open_in_memory(settings: Settings) -> Files:
    """Open a knowledge base in memory."""
    return Files(settings, EmbeddedStore(Store()), BlobStore(None), NoJournal())


def open_for_writing(folder: Path, settings: Settings, durable: bool) -> Files:
    """Open a folder for writing; replay the journal if it was not closed properly."""
    try:
        return _open_for_writing(folder, settings, durable)
    except BaseException as error:
        # Room is made with what can be opened: nobody could delete anything from a store that is
        # shut for want of room.
        if not means_full(error) or not Reserve(folder).give_back():
            raise
    _log.warning("the disk is full at %s: the reserve is used to open it", folder)
    return _open_for_writing(folder, settings, durable)


def _open_for_writing(folder: Path, settings: Settings, durable: bool) -> Files:
    lock = _lock(folder, shared=False)
    journal = JournalFile(folder / "journal", durable)
    try:
        return _open_locked(folder, settings, lock, journal, durable)
    except BaseException as error:
        journal.close()
        lock.release()
        if means_full(error):
            raise full_disk(folder, _TO_WRITE) from error
        raise


def _open_locked(
    folder: Path, settings: Settings, lock: FolderLock, journal: JournalFile, durable: bool
) -> Files:
    store = _open_store(folder, reading=False)
    try:
        complete_replacement(store, folder)
        recovered = recover(folder, store, journal, settings)
        checkpoints = Checkpoints(folder, store, journal, durable)
        blobs = BlobStore(folder / "blobs")
    except BaseException:
        store.close()
        raise
    # Last of all, so that opening itself has the room.
    checkpoints.reserve.take()
    return Files(
        recovered.settings,
        store,
        blobs,
        journal,
        folder,
        lock,
        checkpoints,
        recovered.last_seq,
        recovered.may_be_ahead,
        ladder=Ladder(folder, recovered.settings.epoch, journal),
    )


def open_for_reading(folder: Path, settings: Settings) -> Files:
    """Open a folder for reading, together with other readers.

    Beside a writer, a copy of the newest snapshot that it has published is opened, to be kept
    current; the snapshot itself if the folder cannot be written.
    """
    try:
        lock = _lock(folder, shared=True)
    except StoreLockedError as error:
        # Somebody writes: the state at some commit is read instead, without waiting for the end.
        held = hold_newest(folder)
        if held is None:
            raise
        try:
            copy = PrivateCopy(folder)
        except OSError as reason:
            _log.warning(
                "%s, or read its state after commit %d, as here: following it needs a folder that "
                "can be written (%s)",
                error,
                held.seq,
                reason.strerror,
            )
            return _open_snapshot(folder, settings, held)
        # The copy is made of it; from here on it lives by itself.
        held.release()
        return _open_copy(folder, settings, copy)
    try:
        require_clean(folder)
        store = _open_store(folder, reading=True)
    except BaseException:
        lock.release()
        raise
    blobs = BlobStore(folder / "blobs", writable=False)
    journal = JournalFile(folder / "journal")
    return Files(settings, store, blobs, journal, folder, lock)


def _open_copy(folder: Path, settings: Settings, copy: PrivateCopy) -> Files:
    try:
        taken = copy.take()
        if taken is None:
            raise StoreError(f"{folder} was closed while it was opened for reading; open it again")
        path, seq = taken
        store = EmbeddedStore(Store(str(path)), str(path))
    except (OSError, RuntimeError) as error:
        copy.release()
        raise StoreError(f"the snapshot in {folder} cannot be read: {error}") from error
    except BaseException:
        copy.release()
        raise
    blobs = BlobStore(folder / "blobs", writable=False)
    journal = JournalFile(folder / "journal")
    return Files(settings, store, blobs, journal, folder, last_seq=seq, held=copy)


def _open_snapshot(folder: Path, settings: Settings, held: HeldSnapshot) -> Files:
    try:
        store = _open_store(held.path, reading=True)
    except BaseException:
        held.release()
        raise
    blobs = BlobStore(folder / "blobs", writable=False)
    return Files(settings, store, blobs, NoJournal(), folder, last_seq=held.seq, held=held)


def _lock(folder: Path, shared: bool) -> FolderLock:
    try:
        return FolderLock(folder, shared)
    except PermissionError as error:
        raise StoreError(f"{folder} cannot be opened: {error.strerror}") from error
    except OSError as error:
        if means_full(error):
            raise full_disk(folder, _TO_WRITE) from error
        raise


def _open_store(folder: Path, reading: bool) -> EmbeddedStore:
    path = str(folder / "store")
    try:
        return EmbeddedStore(Store.read_only(path)) if reading else EmbeddedStore(Store(path), path)
    except OSError as error:
        if means_full(error):
            raise
        if "lock" in str(error).lower():
            raise StoreError(f"the store in {folder} cannot be opened: {error}") from error
        raise _damaged(folder, error) from error
    except RuntimeError as error:
        raise _damaged(folder, error) from error


def _damaged(folder: Path, error: Exception) -> StoreFormatError:
    return StoreFormatError(
        f"the store in {folder} cannot be opened: {error}; restore a backup, or rebuild the store "
        f"from the journal: rtask rebuild store -d {folder}",
        damaged="store",
    )
