"""The branches of one graph: their records, how many there may be, and when they go."""

from __future__ import annotations

import datetime as dt
import logging
import secrets
import threading
from collections.abc import Callable

from rtask.errors import ConflictError, QueueFullError, StoreFormatError, UnknownTermError
from rtask.kb.branches.files import home_of, make_branch, open_branch, remove_branch
from rtask.kb.branches.record import (
    LIFETIME,
    MAX_OPEN,
    MAX_OPEN_EACH,
    BranchRecord,
    require_name,
)
from rtask.kb.durability.folder import Files
from rtask.kb.store.graphs import Graphs

__all__ = ["BranchRegister"]

_log = logging.getLogger(__name__)


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)


class BranchRegister:
    """Makes, lists and removes the branches of a graph that is open for writing.

    Parameters
    ----------
    files, graphs
        The trunk.

    Attributes
    ----------
    close
        Closes a branch, by name, if it is open.
    clock
        Returns the time, UTC.
    lock
        Held while branches are made, opened and removed.
    """

    def __init__(self, files: Files, graphs: Graphs, close: Callable[[str], None]) -> None:
        self._files = files
        self._graphs = graphs
        self.close = close
        self.clock: Callable[[], dt.datetime] = _now
        self.lock = threading.RLock()

    def records(self, is_whole: bool = False) -> list[BranchRecord]:
        """Return the branches, the oldest first, and remove those that have expired.

        Parameters
        ----------
        is_whole
            Whether every branch counts; otherwise one with a damaged record is left out, with a
            warning.

        Raises
        ------
        StoreFormatError
            A record is damaged, and every branch counts.
        """
        home = home_of(self._files)
        records = []
        with self.lock:
            for folder in home.iterdir() if home.is_dir() else ():
                if folder.suffix == ".draft":
                    continue
                try:
                    records.append(BranchRecord.load(folder))
                except StoreFormatError as error:
                    if is_whole:
                        raise
                    _log.warning("a branch is left out: %s", error)
            now, trunk = self.clock(), self._files.settings.epoch
            for record in records:
                if record.expires <= now or record.trunk != trunk:
                    _log.info("branch %s has expired", record.name)
                    self.remove(record.name)
            valid = [r for r in records if r.expires > now and r.trunk == trunk]
        return sorted(valid, key=lambda record: (record.made, record.name))

    def get(self, name: str) -> BranchRecord:
        """Return the record of a branch.

        Raises
        ------
        UnknownTermError
            There is none of this name, or it has expired.
        """
        for record in self.records():
            if record.name == name:
                return record
        raise UnknownTermError(f"there is no branch {name!r}; `rtask branch list` lists them")

    def make(
        self,
        name: str | None,
        author: str,
        base: int,
        note: str,
        lifetime: dt.timedelta | None,
        is_head: bool,
        max_own: int = MAX_OPEN_EACH,
    ) -> BranchRecord:
        """Make a branch that begins after a commit; ``max_own`` is for the author's branches.

        Raises
        ------
        ConflictError
            There is a branch of this name.
        QueueFullError
            As many branches are open as may be, of all or of this author.
        RtaskError
            As :func:`rtask.kb.branches.files.make_branch`.
        """
        with self.lock:
            there = self.records()
            chosen = secrets.token_hex(4) if name is None else require_name(name)
            if any(record.name == chosen for record in there):
                raise ConflictError(f"there is a branch {chosen!r} already; drop it, or merge it")
            if len(there) >= MAX_OPEN:
                raise QueueFullError(
                    f"{len(there)} branches are open, as many as may be; merge or drop one, e.g. "
                    f"{there[0].name!r} of {there[0].made:%Y-%m-%d %H:%M}"
                )
            own = [record for record in there if record.author == author]
            if len(own) >= max_own:
                raise QueueFullError(
                    f"{author} has {len(own)} branches open, as many as one may have; merge or "
                    f"drop one, e.g. {own[0].name!r} of {own[0].made:%Y-%m-%d %H:%M}"
                )
            made = self.clock()
            record = BranchRecord(
                chosen,
                author,
                base,
                self._files.settings.epoch,
                secrets.token_hex(4),
                made,
                made + min(lifetime or LIFETIME, LIFETIME),
                note[:500],
            )
            make_branch(self._files, self._graphs, record, is_head)
            return record

    def open(self, record: BranchRecord) -> Files:
        """Open the files of a branch."""
        return open_branch(self._files, record)

    def remove(self, name: str) -> None:
        """Close a branch and delete its folder."""
        with self.lock:
            self.close(name)
            remove_branch(self._files, name)
