"""Folders with the files of versions, for services to read; those out of use are removed."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rtask.scratch import ScratchFolder

__all__ = ["Views"]

MAX_VIEWS = 64
IDLE_S = 3600.0
_MAKING = "making-"


class Views:
    """Folders by the digest of what they hold.

    A view is linked to the blobs, so it takes no room but keeps removed files from being freed.
    When there are more than ``most``, those go that nobody uses and nobody asked for in ``idle_s``.
    Several processes may share them: a user holds a lock that ends with its process.

    Parameters
    ----------
    folder
        Where they are; made when the first one is.
    most, idle_s
        See above.
    """

    def __init__(self, folder: Path, most: int = MAX_VIEWS, idle_s: float = IDLE_S) -> None:
        self._folder = folder
        self._most, self._idle_s = most, idle_s

    def get(self, digest: str, fill: Callable[[Path], None]) -> Path:
        """Return the folder of a digest, filled by ``fill`` if it is not there."""
        self._folder.mkdir(exist_ok=True)
        place = self._folder / digest
        with suppress(FileNotFoundError):
            os.utime(place)
            return place
        made = Path(tempfile.mkdtemp(prefix=_MAKING, dir=self._folder))
        try:
            fill(made)
            made.rename(place)
        except BaseException as error:
            shutil.rmtree(made)
            if not (isinstance(error, OSError) and place.exists()):  # somebody else was faster
                raise
        self.prune()
        return place

    def keep(self, place: Path, user: object) -> None:
        """Keep a view as long as an object lives."""
        lock = os.open(self._lock_of(place), os.O_RDWR | os.O_CREAT, 0o644)
        fcntl.flock(lock, fcntl.LOCK_SH)
        weakref.finalize(user, os.close, lock)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Yield an empty folder that is thrown away."""
        self._folder.mkdir(exist_ok=True)
        with ScratchFolder("view", self._folder) as made:
            yield made

    def prune(self) -> None:
        """Remove the views out of use, the longest unused first, until there are few."""
        limit = time.time() - self._idle_s
        aged = []
        for view in self._folder.iterdir():
            with suppress(FileNotFoundError):  # another process prunes as well
                used = view.stat().st_mtime
                if view.is_dir() and "-" not in view.name:
                    aged.append((used, view))
                elif view.name.startswith(_MAKING) and used < limit:  # its maker was killed
                    shutil.rmtree(view)
        for used, place in sorted(aged)[: max(len(aged) - self._most, 0)]:
            if used < limit:
                self._remove(place, limit)

    def _remove(self, place: Path, limit: float) -> None:
        """Remove a view unless somebody uses it or asked for it since ``limit``, s."""
        lock = os.open(self._lock_of(place), os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if place.stat().st_mtime >= limit:  # somebody has just asked for it
                return
            # Renamed first, so that no half of it can be taken for the whole.
            gone = place.with_name(f"{_MAKING}{place.name}-{os.getpid()}")
            place.rename(gone)
            shutil.rmtree(gone)
            self._lock_of(place).unlink(missing_ok=True)
        except (BlockingIOError, FileNotFoundError):
            return
        finally:
            os.close(lock)

    def _lock_of(self, place: Path) -> Path:
        return place.with_name(f"{place.name}.lock")
