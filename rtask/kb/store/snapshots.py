"""Snapshots of an on-disk store, for readers that do not follow commits.

A snapshot consists of hard links, so it takes almost no space until the store rewrites its files.
It is removed with its last reader; those left by a crash are removed at the next start.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rtask.errors import StoreError
from rtask.kb.store.embedded import embedded_store
from rtask.kb.store.graph_store import GraphStore

__all__ = ["Snapshot", "Snapshots"]


@dataclass
class Snapshot:
    """Folder with a copy of the store that contains at least the commits up to ``seq``."""

    path: Path
    seq: int
    users: int = 0


class Snapshots:
    """Snapshots of one open folder.

    Parameters
    ----------
    folder
        Folder of the knowledge base.
    frozen
        Whether the store is never written while open, so that it serves as its own snapshot.
    last_seq
        Number of the last commit that has been stored.
    """

    def __init__(
        self, store: GraphStore, folder: Path, frozen: bool, last_seq: Callable[[], int]
    ) -> None:
        self._store = store
        self._folder = folder
        self._home = folder / "snapshots"
        self.frozen = frozen
        self._last_seq = last_seq
        self._lock = threading.Lock()
        self._number = 0
        self._snapshots: list[Snapshot] = []
        if not frozen:
            # No reader survived the process that made these.
            shutil.rmtree(self._home, ignore_errors=True)

    def take(self, at_least: int) -> Snapshot:
        """Return a snapshot with the commits up to ``at_least``, shared by several readers.

        Raises
        ------
        StoreError
            The snapshot cannot be made, e.g. because the disk is full.
        """
        with self._lock:
            newest = self._snapshots[-1] if self._snapshots else None
            if newest is None or newest.seq < at_least:
                newest = self._make()
            newest.users += 1
            return newest

    def _make(self) -> Snapshot:
        if self.frozen:
            embedded_store(self._store, "a snapshot").reopen_to_read()
            snapshot = Snapshot(self._folder / "store", self._last_seq())
        else:
            # read before copying: commits stored meanwhile may be in the copy, too
            seq = self._last_seq()
            self._number += 1
            path = self._home / str(self._number)
            try:
                self._home.mkdir(exist_ok=True)
                with self._store.complete():
                    embedded_store(self._store, "a snapshot").raw.backup(str(path))
            except (OSError, RuntimeError) as error:
                shutil.rmtree(path, ignore_errors=True)
                raise StoreError(f"cannot make a snapshot of {self._folder}: {error}") from error
            snapshot = Snapshot(path, seq)
        self._snapshots.append(snapshot)
        return snapshot

    def release(self, snapshot: Snapshot) -> None:
        """Release a reader's snapshot; the folder is deleted with the last one."""
        with self._lock:
            snapshot.users -= 1
            if snapshot.users > 0:
                return
            self._snapshots.remove(snapshot)
            if not self.frozen:
                shutil.rmtree(snapshot.path, ignore_errors=True)

    def close(self) -> None:
        """Delete all snapshots; all readers must have ended."""
        with self._lock:
            self._snapshots.clear()
            if not self.frozen:
                shutil.rmtree(self._home, ignore_errors=True)
