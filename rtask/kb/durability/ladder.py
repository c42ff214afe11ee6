"""Kept copies of earlier states of a store, from the nearest of which any other is reached.

The first question about an earlier state leaves copies on its way, one after so many statements,
and later questions replay the journal from the nearest, forwards or backwards::

    past/<seq>/rung.json      which commit, of which epoch, made during which boot
               store/         the quads, by hard links

A copy is never opened in place but linked anew, and no copy is held open, so that they take disk
alone, and no memory. Where they would take more of it than they may, those go first whose absence
makes the least difference for their age: the distances grow with the age.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import shutil
import threading
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Store

from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import boot_id

__all__ = ["MAX_BYTES", "MAX_RUNGS", "SPACING", "Ladder", "Rung"]

_log = logging.getLogger(__name__)
_FOLDER = "past"
SPACING = 600
"""Statements that changed between one copy and the next: half of them are replayed within 15 ms."""
MAX_RUNGS = 256
MAX_BYTES = 1 << 30
"""Disk that the copies may take beside the files that they share with the store."""


@dataclass(frozen=True)
class Rung:
    """A kept copy of the state after a commit.

    Parameters
    ----------
    seq
        Number of the commit.
    path
        Folder of the store.
    """

    seq: int
    path: Path


class Ladder:
    """Kept copies of one open folder; used by the process that writes it.

    Parameters
    ----------
    folder
        Folder of the knowledge base.
    epoch
        Of the numbering of its commits; copies of another one are deleted.
    journal
        Its journal, which tells how far two states are apart.
    """

    def __init__(
        self,
        folder: Path,
        epoch: str,
        journal: JournalFile,
        max_bytes: int = MAX_BYTES,
        max_rungs: int = MAX_RUNGS,
    ) -> None:
        self._home = folder / _FOLDER
        self._store = folder / "store"
        self._mark = {"epoch": epoch, "boot": boot_id()}
        self._journal = journal
        self._max_bytes = max_bytes
        self._max_rungs = max_rungs
        self._lock = threading.Lock()
        self._rungs: dict[int, dict[int, int]] | None = None

    def seqs(self) -> list[int]:
        """Return the numbers of the commits of which there are copies, ascending."""
        with self._lock:
            return sorted(self._stored())

    def beside(self, seq: int) -> list[Rung]:
        """Return the last copy from before or at a commit, and the first from after it."""
        seqs = self.seqs()
        before = [each for each in seqs if each <= seq][-1:]
        after = [each for each in seqs if each > seq][:1]
        return [Rung(each, self._path(each)) for each in (*before, *after)]

    def distance(self, first: int, last: int) -> int:
        """Return how many statements the commits between two states, in any order, changed."""
        return self._journal.marks.changed(min(first, last), max(first, last))

    def copy(self, rung: Rung, target: Path) -> bool:
        """Link a copy anew, to be changed; return whether it is still there."""
        with self._lock:
            if rung.seq not in self._stored():
                return False
            try:
                _link(rung.path, target)
            except OSError as error:
                _log.warning("the copy of commit %d is deleted: %s", rung.seq, error)
                shutil.rmtree(target, ignore_errors=True)
                self._remove(rung.seq)
                return False
            return True

    def keep(self, store: Store, seq: int) -> None:
        """Keep what a store holds as the state after a commit.

        Nothing is kept where there is no room, or such a copy is there.
        """
        home = self._home / str(seq)
        draft = self._home / f"{seq}.draft"
        with self._lock:
            if seq in self._stored():
                return
            try:
                draft.mkdir(parents=True)
                store.backup(str(draft / "store"))
                (draft / "rung.json").write_text(json.dumps({"seq": seq, **self._mark}), "utf-8")
                draft.rename(home)
            except (OSError, RuntimeError) as error:
                _log.warning("no copy of commit %d is kept: %s", seq, error)
                shutil.rmtree(draft, ignore_errors=True)
                return
            self._stored()[seq] = _files(home / "store")
            self._thin()

    def clear(self) -> None:
        """Delete all copies, e.g. because the disk is full."""
        with self._lock:
            self._rungs = {}
            shutil.rmtree(self._home, ignore_errors=True)

    def own_bytes(self) -> int:
        """Return what the copies take on the disk beside what they share with the store."""
        with self._lock:
            return self._own_bytes()

    def _path(self, seq: int) -> Path:
        return self._home / str(seq) / "store"

    def _stored(self) -> dict[int, dict[int, int]]:
        """Return the files of each copy, by inode with their sizes; read once from the disk."""
        if self._rungs is None:
            self._rungs = {}
            for home in sorted(self._home.iterdir()) if self._home.is_dir() else ():
                if self._is_valid(home):
                    self._rungs[int(home.name)] = _files(home / "store")
                else:
                    shutil.rmtree(home, ignore_errors=True)
        return self._rungs

    def _is_valid(self, home: Path) -> bool:
        """Whether a folder holds a copy that the commits of the journal go together with.

        After the machine has stopped, nobody knows what of a copy had reached the disk.
        """
        with contextlib.suppress(OSError, ValueError):
            mark = json.loads((home / "rung.json").read_text("utf-8"))
            return bool(mark == {"seq": int(home.name), **self._mark})
        return False

    def _own_bytes(self) -> int:
        files: dict[int, int] = {}
        for each in self._stored().values():
            files.update(each)
        for inode in _files(self._store):
            files.pop(inode, None)
        return sum(files.values())

    def _thin(self) -> None:
        """Delete the copies that are missed least until the rest take no more than they may."""
        oldest = self._journal.oldest() or 0
        for seq in [seq for seq in self._stored() if seq + 1 < oldest]:
            self._remove(seq)
        while len(self._stored()) > 1 and (
            len(self._stored()) > self._max_rungs or self._own_bytes() > self._max_bytes
        ):
            self._remove(self._least_missed())

    def _least_missed(self) -> int:
        """Return the copy without which the gap would be smallest for its age."""
        seqs = sorted(self._stored())
        newest = max(self._journal.written, seqs[-1])
        following = [*seqs[1:], newest]
        preceding = [seqs[0], *seqs[:-1]]

        def gap(k: int) -> float:
            age = 1 + self.distance(seqs[k], newest)
            return self.distance(preceding[k], following[k]) / age

        return seqs[min(range(len(seqs)), key=gap)]

    def _remove(self, seq: int) -> None:
        self._stored().pop(seq, None)
        gone = self._home / f"{seq}.gone"
        with contextlib.suppress(OSError):
            (self._home / str(seq)).rename(gone)  # at once, so that no half of it is left
        shutil.rmtree(gone, ignore_errors=True)


def _link(source: Path, target: Path) -> None:
    """Link the files of a store that is not open, and copy those that an engine writes on.

    That takes a tenth of the time that the engine needs to open the store and copy it.
    """
    if not (source / "CURRENT").exists():
        raise FileNotFoundError(f"{source} holds no store")
    target.mkdir(parents=True)
    for file in source.iterdir():
        if file.suffix in (".sst", ".blob"):  # never written again once they are complete
            os.link(file, target / file.name)
        else:
            shutil.copyfile(file, target / file.name)


def _files(folder: Path) -> dict[int, int]:
    """Return the sizes of the files in a folder, by inode."""
    sizes: dict[int, int] = {}
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            status = entry.stat()
            sizes[status.st_ino] = status.st_size
    return sizes
