"""Folders for temporary files that do not outlive a killed process for long.

``tempfile.TemporaryDirectory`` is removed by the process that made it, so one that is killed leaves
it behind for good. Here its maker holds a lock on the folder, which the system releases however the
process ends; the next process that needs a folder removes those whose lock it gets.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import weakref
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import TracebackType

__all__ = ["ScratchFolder"]

_PREFIX = "rtask-scratch-"


class ScratchFolder:
    """A folder of this process, which is removed with all that is in it.

    Parameters
    ----------
    purpose
        Part of its name, for people who look at what fills a disk.
    beside
        The folder in which it is made; None = the system's for temporary files. Files that are to
        be moved in one step need the file system of the place where they go.

    Attributes
    ----------
    path : Path
        The folder.

    Examples
    --------
    >>> with ScratchFolder("example") as folder:
    ...     _ = (folder / "note.txt").write_text("gone after the block")
    >>> folder.exists()
    False
    """

    def __init__(self, purpose: str, beside: Path | None = None) -> None:
        home = Path(tempfile.gettempdir()) if beside is None else beside
        _remove_abandoned(home)
        self.path, lock = _new_folder(purpose, home)
        # Without the process id, a forked child that ends would take its parent's folder away.
        self._finalizer = weakref.finalize(self, _remove, self.path, lock, os.getpid())

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Remove it; does nothing the second time."""
        self._finalizer()


def _new_folder(purpose: str, home: Path) -> tuple[Path, int]:
    """Return a folder and the descriptor that holds its lock."""
    while True:
        path = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{purpose}-", dir=home))
        # Between these two lines another process may take the folder for an abandoned one.
        with suppress(FileNotFoundError):
            lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            fcntl.flock(lock, fcntl.LOCK_EX)
            if path.exists():
                return path, lock
            os.close(lock)


def _remove(path: Path, lock: int, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(path, ignore_errors=True)
        os.close(lock)


@cache
def _remove_abandoned(home: Path) -> None:
    """Remove this user's folders whose process has ended; looked at once for each process."""
    for path in home.glob(f"{_PREFIX}*"):
        try:
            folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError:  # another user's, a link, or gone by now
            continue
        try:
            # /tmp belongs to everybody: root could open and remove what is not its own.
            if os.fstat(folder).st_uid == os.getuid():
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(path, ignore_errors=True)
        except BlockingIOError:  # its process lives
            continue
        finally:
            os.close(folder)
