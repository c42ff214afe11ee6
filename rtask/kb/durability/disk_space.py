"""Room on disk: errors that mean there is none, and a reserve for the last writes to a folder.

A folder that is open for writing holds a reserve. When the disk is full, it is given back, so that
the knowledge base can be closed properly and its journal copied.
"""

from __future__ import annotations

import errno
import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from rtask.errors import StorageFullError

__all__ = ["Reserve", "full_disk", "means_full"]

_log = logging.getLogger(__name__)
RESERVE_BYTES = 8 << 20
_FILE = "reserve"
_FULL = frozenset((errno.ENOSPC, errno.EDQUOT))
Result = TypeVar("Result")


def means_full(error: BaseException) -> bool:
    """Whether an error, or what caused it, says that the disk or the quota is used up.

    The store's errors have a text only.
    """
    at: BaseException | None = error
    while at is not None:
        if isinstance(at, StorageFullError) or getattr(at, "errno", None) in _FULL:
            return True
        # RocksDB reports it in words alone.
        if "No space left" in str(at) or "Disk quota exceeded" in str(at):
            return True
        at = at.__cause__
    return False


def full_disk(folder: Path, purpose: str) -> StorageFullError:
    """Return the error for a full disk, with the place and the room that is left there."""
    # The folder itself may be what could not be made.
    there = next((p for p in (folder, *folder.absolute().parents) if p.exists()), Path("/"))
    free = shutil.disk_usage(there).free
    return StorageFullError(
        f"the disk is full: {free / 1e6:.1f} MB are free at {there}, too few {purpose}",
        path=str(there),
        free=free,
    )


class Reserve:
    """A file that occupies room until it is needed.

    Parameters
    ----------
    folder
        A folder that is open for writing.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / _FILE

    def take(self) -> None:
        """Occupy the room if the disk has it to spare."""
        try:
            if self._path.exists() and self._path.stat().st_size == RESERVE_BYTES:
                return
            # A reserve that fills the disk would cause what it is for.
            if shutil.disk_usage(self._path.parent).free < 2 * RESERVE_BYTES:
                return
            with self._path.open("wb") as file:
                # A file of holes occupies nothing.
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
                else:
                    file.write(bytes(RESERVE_BYTES))
        except OSError as error:
            _log.debug("no reserve in %s: %s", self._path.parent, error)
            self.give_back()

    def give_back(self) -> bool:
        """Free the room; return whether there was any."""
        try:
            self._path.unlink()
        except OSError:
            return False
        return True

    def spend_on(self, work: Callable[[], Result]) -> Result:
        """Do some work; if the disk is full, once more with the room of the reserve."""
        try:
            return work()
        except (OSError, RuntimeError, StorageFullError) as error:
            if not means_full(error) or not self.give_back():
                raise
            _log.warning("the disk is full at %s: the reserve is used", self._path.parent)
            return work()
