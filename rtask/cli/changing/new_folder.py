"""A folder that is as before after a command that failed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["NewFolder", "open_or_make"]


class NewFolder:
    """Removes a folder, with the parents made for it, unless it was there before or is kept.

    The knowledge base in it is opened within this context, and so closed before the removal.

    Parameters
    ----------
    folder
        One that a knowledge base is opened in.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.absolute()
        self._stays = _is_used(self._folder)
        parents = (self._folder, *self._folder.parents)
        self._made = [path for path in parents if not path.exists()]

    def keep(self) -> None:
        """Keep the folder, whatever happens next."""
        self._stays = True

    def __enter__(self) -> NewFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self._stays:
            self._remove()

    def _remove(self) -> None:
        from rtask.errors import StoreLockedError
        from rtask.kb.durability.lock import FolderLock

        if not self._folder.is_dir():
            return
        # Without the lock, another process that opens the folder now would lose what it writes.
        try:
            lock = FolderLock(self._folder)
        except (StoreLockedError, OSError):  # another process has begun to use it
            return
        try:
            for path in self._folder.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        finally:
            lock.release()
        for path in self._made:
            try:
                path.rmdir()
            except OSError:  # others have put something there
                return


def _is_used(folder: Path) -> bool:
    try:
        return any(folder.iterdir())
    except FileNotFoundError:
        return False
    except OSError:  # a file, or a folder of somebody else
        return True


@contextmanager
def open_or_make(data: Path, *, stores: bool = True, **options: Any) -> Iterator[KnowledgeBase]:
    """Yield a folder open for writing, which is made if it does not exist.

    A command that fails before it has stored anything leaves no new folder behind.

    Parameters
    ----------
    stores
        Whether the command stores anything; else a new folder goes in any case.
    **options
        Of `rtask.open`.
    """
    import rtask

    with NewFolder(data) as new, rtask.open(data, **options) as kb:
        before = kb.seq
        try:
            yield kb
            if stores:
                new.keep()
        finally:
            if kb.seq != before:
                new.keep()
