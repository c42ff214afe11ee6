"""A reader's own copy of a snapshot, which it keeps current beside the writer.

The copy consists of hard links, so it takes almost no space until store or copy rewrite their
files. What processes left that did not end properly is removed by the next one.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import uuid
from pathlib import Path

from pyoxigraph import Store

from rtask.kb.durability.published import LOCK, hold_newest, remove_unheld

__all__ = ["PastCopy", "PrivateCopy"]

_FOLDER = "followers"


class _OwnFolder:
    """A folder of this process in a knowledge base, for copies of its store.

    Attributes
    ----------
    path
        Folder of this process.

    Raises
    ------
    OSError
        The folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        home = folder / _FOLDER
        home.mkdir(exist_ok=True)
        for left in home.iterdir():  # by processes that have ended
            remove_unheld(left)
        self.path = home / f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        draft = self.path.with_suffix(".draft")
        draft.mkdir()
        self._handle = os.open(draft / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
        fcntl.flock(self._handle, fcntl.LOCK_EX)
        draft.rename(self.path)

    def release(self) -> None:
        """Delete all copies."""
        if self._handle < 0:
            return
        shutil.rmtree(self.path, ignore_errors=True)
        os.close(self._handle)
        self._handle = -1
        with contextlib.suppress(OSError):
            self.path.parent.rmdir()


class PastCopy(_OwnFolder):
    """A copy of a store that is turned back to an earlier commit."""


class PrivateCopy(_OwnFolder):
    """Copies of the newest snapshot, each to be kept current.

    Parameters
    ----------
    folder
        The knowledge base, which another process has open for writing.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._folder = folder
        self._number = 0

    def take(self, at_least: int = 0) -> tuple[Path, int] | None:
        """Copy the newest snapshot; return the copy and the number of its last commit.

        Returns ``None`` if the writer has published none with so high a number.
        """
        held = hold_newest(self._folder)
        if held is None:
            return None
        try:
            if held.seq < at_least:
                return None
            self._number += 1
            target = self.path / f"store{self._number}"
            Store.read_only(str(held.path / "store")).backup(str(target))
            return target, held.seq
        finally:
            held.release()

    def discard(self, target: Path) -> None:
        """Delete a copy."""
        shutil.rmtree(target, ignore_errors=True)
