"""Snapshots of a store on disk, for readers that do not follow commits.

A copy is made of hard links, so it costs next to nothing until the store rewrites its files. It
is removed with its last reader; what a crash left is removed at the next start.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rtask.errors import StoreError
from rtask.kb.store.graph_store import GraphStore

__all__ = ["Snapshot", "Snapshots"]


@dataclass
class Snapshot:
    """Folder with a copy of the store that has at least the commits up to ``seq``."""

    path: Path
    seq: int
    users: int = 0


class Snapshots:
    """Snapshots of one open folder.

    Parameters
    ----------
    folder
        Of the knowledge base.
    frozen
        Nobody writes the store while it is open here; it serves as its own snapshot.
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
        self._kept: list[Snapshot] = []
        if not frozen:
            shutil.rmtree(self._home, ignore_errors=True)

    def take(self, at_least: int) -> Snapshot:
        """Return a snapshot that has these commits, for one more reader; queries share it.

        Raises
        ------
        StoreError
            It cannot be made, e.g. the disk is full.
        """
        with self._lock:
            newest = self._kept[-1] if self._kept else None
            if newest is None or newest.seq < at_least:
                newest = self._make()
            newest.users += 1
            return newest

    def _make(self) -> Snapshot:
        if self.frozen:
            snapshot = Snapshot(self._folder / "store", self._last_seq())
        else:
            # read before the copy is made: whatever is stored meanwhile may be in it, too
            seq = self._last_seq()
            self._number += 1
            path = self._home / str(self._number)
            try:
                self._home.mkdir(exist_ok=True)
                self._store.raw.backup(str(path))
            except (OSError, RuntimeError) as error:
                shutil.rmtree(path, ignore_errors=True)
                raise StoreError(f"no snapshot of {self._folder} can be made: {error}") from error
            snapshot = Snapshot(path, seq)
        self._kept.append(snapshot)
        return snapshot

    def release(self, snapshot: Snapshot) -> None:
        """Release a reader's snapshot; the folder is deleted with the last one."""
        with self._lock:
            snapshot.users -= 1
            if snapshot.users > 0:
                return
            self._kept.remove(snapshot)
            if not self.frozen:
                shutil.rmtree(snapshot.path, ignore_errors=True)

    def close(self) -> None:
        """Delete all snapshots; no reader may be left."""
        with self._lock:
            self._kept.clear()
            if not self.frozen:
                shutil.rmtree(self._home, ignore_errors=True)
