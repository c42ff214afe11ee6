"""Snapshots that a writer publishes for other processes, one at each checkpoint.

A process that opens a folder for reading beside a writer begins with the newest of them, because
the files of a store that is being written must not be opened twice. A snapshot consists of hard
links, so it takes almost no space until the store rewrites its files. It is kept while somebody
holds it.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.graph_store import GraphStore

__all__ = ["LOCK", "HeldSnapshot", "Publisher", "hold_newest", "remove_unheld"]

_log = logging.getLogger(__name__)
_FOLDER = "published"
LOCK = "lock"


@dataclass
class HeldSnapshot:
    """A published snapshot that this process reads.

    Attributes
    ----------
    path
        Folder that holds the folder ``store``.
    seq
        Number of the last commit in it.
    """

    path: Path
    seq: int
    _handle: int

    def release(self) -> None:
        """Let the writer remove it."""
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1


class Publisher:
    """Publishes snapshots of one open folder; used by its writer.

    Parameters
    ----------
    folder
        Folder of the knowledge base.
    """

    def __init__(self, folder: Path, store: GraphStore) -> None:
        self._home = folder / _FOLDER
        self._store = store

    def publish(self, seq: int) -> None:
        """Publish the state of the store, which must be on disk, as that after a commit.

        Readers do without a new snapshot where none can be made, e.g. because the disk is full.
        """
        target = self._home / str(seq)
        draft = self._home / "draft"
        if not target.exists():
            try:
                self._home.mkdir(exist_ok=True)
                shutil.rmtree(draft, ignore_errors=True)
                draft.mkdir()
                (draft / LOCK).touch()
                embedded_store(self._store, "a snapshot").raw.backup(str(draft / "store"))
                draft.rename(target)
            except (OSError, RuntimeError) as error:
                _log.warning("no snapshot for other processes: %s", error)
                return
        self._remove(keep=seq)

    def clear(self) -> None:
        """Remove the snapshots, because the folder is being closed and can be read itself."""
        self._remove(keep=-1)
        shutil.rmtree(self._home / "draft", ignore_errors=True)
        with contextlib.suppress(OSError):
            self._home.rmdir()

    def _remove(self, keep: int) -> None:
        """Remove the snapshots that nobody holds, all but one."""
        for seq in _published(self._home):
            path = self._home / str(seq)
            if seq != keep:
                remove_unheld(path)


def remove_unheld(path: Path) -> None:
    """Remove a folder unless a process holds the lock in it."""
    with contextlib.suppress(OSError):
        handle = os.open(path / LOCK, os.O_RDWR | os.O_CLOEXEC)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(path)
        finally:
            os.close(handle)


def hold_newest(folder: Path) -> HeldSnapshot | None:
    """Hold the newest snapshot that the writer of a folder has published; ``None`` without any."""
    home = folder / _FOLDER
    for seq in reversed(_published(home)):
        path = home / str(seq)
        try:
            handle = os.open(path / LOCK, os.O_RDWR | os.O_CLOEXEC)
        except OSError:
            continue  # removed meanwhile, for a newer one
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            continue
        if (path / LOCK).exists():
            return HeldSnapshot(path, seq, handle)
        os.close(handle)
    return None


def _published(home: Path) -> list[int]:
    """Return the commit numbers of the published snapshots, ascending."""
    with contextlib.suppress(OSError):
        return sorted(int(path.name) for path in home.iterdir() if path.name.isdecimal())
    return []
