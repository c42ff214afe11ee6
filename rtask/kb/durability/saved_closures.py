"""Saved closures: ``closure-<seq>/`` folders from which the reasoner goes on after a restart.

A saved closure belongs to one commit. Opening takes the newest one that fits the journal and the
catalogue, and derives what the commits since then changed, in one step. One that does not fit is
left alone: the closure is then built from the asserted statements, and the log says why.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from rtask.errors import StoreError
from rtask.kb.durability.journal import Record
from rtask.rdf.terms import GraphName, TripleKey, triple_key

if TYPE_CHECKING:
    from reasoner import Closure, Config, LabelledRule

__all__ = ["Held", "SavedClosures", "TracedJournal", "discard_saved", "saved_folders"]

_log = logging.getLogger(__name__)
_PREFIX = "closure-"
_MAX_SAVED = 2
_MIN_ASSERTED = 1_000
"""Below this many asserted triples, building the closure takes less time than saving it."""
_DUE_CHANGES = 5_000
_DUE_S = 600.0


class _MisfitError(Exception):
    """A saved closure does not belong to this state of the knowledge base."""


@dataclass(frozen=True)
class Held:
    """The present content of a knowledge base, as far as a saved closure has to agree with it.

    Parameters
    ----------
    seq
        Number of the last commit.
    sizes
        Number of triples of each graph that the reasoner reads, by IRI; empty graphs left out.
    is_input
        Whether the reasoner reads a graph.
    present
        Returns those of some triples that a graph holds that the reasoner reads.
    """

    seq: int
    sizes: Mapping[str, int]
    is_input: Callable[[GraphName], bool]
    present: Callable[[Collection[TripleKey]], list[TripleKey]]


@runtime_checkable
class TracedJournal(Protocol):
    """A journal whose records can be followed from a place that was noted."""

    def records(self, since: int = 0) -> Iterator[Record]:
        """Yield the records of commits after ``since``, oldest first."""

    def records_from(self, segment: str, start: int) -> Iterator[Record]:
        """Yield the record at a place, and those after it."""

    def place_of(self, seq: int) -> tuple[str, int, list[Any]] | None:
        """Return segment, start and identity of a commit's record; ``None`` if it is not kept."""


def saved_folders(folder: Path) -> list[Path]:
    """Return the folders of saved closures in the folder of a knowledge base, newest first."""
    folders = [path for path in folder.glob(f"{_PREFIX}*") if path.name[len(_PREFIX) :].isdigit()]
    return sorted(folders, key=lambda path: int(path.name[len(_PREFIX) :]), reverse=True)


def discard_saved(folder: Path) -> None:
    """Delete all saved closures, e.g. because statements change that no journal record holds."""
    for path in folder.glob(f"{_PREFIX}*"):
        _delete(path)


def _delete(path: Path) -> None:
    """Delete a folder, which has its name no longer once anything of it is gone."""
    if path.suffix != ".tmp":
        with contextlib.suppress(OSError):
            path = path.rename(path.with_suffix(".tmp"))
    shutil.rmtree(path, ignore_errors=True)


class SavedClosures:
    """Reads and writes the saved closures of one open knowledge base.

    Parameters
    ----------
    epoch
        Identifier of the commit numbering.
    """

    def __init__(self, folder: Path, journal: TracedJournal, epoch: str) -> None:
        self._folder = folder
        self._journal = journal
        self._epoch = epoch
        self._saved_seq = -1
        self._saved_changes = 0
        self._time = time.monotonic()
        self._writing = threading.Lock()

    # Reading

    def restore(
        self, held: Held, rules: Iterable[str | LabelledRule], config: Config
    ) -> Closure | None:
        """Return the closure of the present statements, ``None`` if no saved one fits."""
        from reasoner.saved.container import DamagedFolderError

        for path in saved_folders(self._folder):
            try:
                closure = self._read(path, held, tuple(rules), config)
            except (_MisfitError, DamagedFolderError, StoreError, OSError) as error:
                _log.warning("%s is not used, the closure is rebuilt: %s", path, error)
                continue
            self._saved_changes = 0
            self._saved_seq = int(path.name.removeprefix(_PREFIX))
            return closure
        return None

    def made_otherwise(self, rules: Iterable[str | LabelledRule]) -> bool:
        """Whether other rules or another version of the reasoner made the newest saved closure.

        Then they also made what is stored as derived, so that it has to be derived again.
        """
        from reasoner import Closure
        from reasoner.saved.container import DamagedFolderError, read_head

        for path in saved_folders(self._folder):
            try:
                head = read_head(path)
            except (DamagedFolderError, OSError):
                continue
            return bool(head["made_by"] != Closure(rules).fingerprint())
        return False

    def _read(
        self, path: Path, held: Held, rules: tuple[str | LabelledRule, ...], config: Config
    ) -> Closure:
        from reasoner import Closure
        from reasoner.saved.container import read_head
        from reasoner.saved.image import Image

        head = read_head(path)
        origin: dict[str, Any] = head["origin"]
        if origin["epoch"] != self._epoch:
            raise _MisfitError("commits were renumbered since it was saved")
        if head["made_by"] != Closure(rules).fingerprint():
            raise _MisfitError("it was made by other rules or another version of the reasoner")
        if origin["seq"] > held.seq:
            raise _MisfitError(f"it belongs to commit {origin['seq']}, the last one is {held.seq}")
        touched = self._touched(origin, held)
        closure = Closure.from_image(Image.read(path, head), rules, config)
        if touched:
            gained = dict.fromkeys(held.present(touched.keys()))
            lost = [key for key in touched if key not in gained]
            closure.stage(add=list(gained), remove=lost, accepted=True).apply()
        _log.debug("read %s and followed %d triples", path, len(touched))
        return closure

    def _touched(self, origin: Mapping[str, Any], held: Held) -> dict[TripleKey, None]:
        """Return the triples that commits changed since a closure was saved.

        Raises
        ------
        _MisfitError
            The journal does not lead from there to the present statements.
        """
        sizes: dict[str, int] = dict(origin["sizes"])
        touched: dict[TripleKey, None] = {}
        last = origin["seq"]
        for record in self._since(origin):
            if record.seq != last + 1:
                raise _MisfitError(f"commit {record.seq} follows {last} in the journal")
            if record.header.get("kind") != "delta":
                raise _MisfitError(f"the journal does not hold what commit {record.seq} changed")
            last = record.seq
            for quads, step in ((record.removed(), -1), (record.added(), 1)):
                for quad in quads:
                    if held.is_input(quad.graph_name):
                        touched[triple_key(quad)] = None
                        name = str(getattr(quad.graph_name, "value", ""))
                        sizes[name] = sizes.get(name, 0) + step
        if last != held.seq:
            raise _MisfitError(f"the journal ends at commit {last} instead of {held.seq}")
        if {name: size for name, size in sizes.items() if size} != dict(held.sizes):
            raise _MisfitError("statements came or went that the journal does not hold")
        return touched

    def _since(self, origin: Mapping[str, Any]) -> Iterator[Record]:
        """Yield the records after a saved closure's commit, whose own must be as it was."""
        if not origin["seq"]:
            yield from self._journal.records()
            return
        records = self._journal.records_from(origin["segment"], origin["start"])
        first = next(records, None)
        if first is None or _identity(first.header) != origin["record"]:
            raise _MisfitError(f"the journal's record of commit {origin['seq']} is another one")
        yield from records

    # Writing

    def is_due(self, closure: Closure) -> bool:
        """Whether enough has changed, or enough time has passed since a change."""
        changed = closure.changes - self._saved_changes
        waited = time.monotonic() - self._time
        return changed > _DUE_CHANGES or (changed > 0 and waited > _DUE_S)

    def prepare(
        self, closure: Closure, seq: int, sizes: Mapping[str, int], always: bool = False
    ) -> Callable[[], None] | None:
        """Copy a closure, while nobody writes; return a function that saves the copy.

        Parameters
        ----------
        seq
            The last commit, which must be durable in the journal.
        always
            Save even what was saved before.

        Returns
        -------
        ``None`` if nothing has changed or the closure is too small to be worth it.
        """
        if (seq == self._saved_seq and not always) or closure.size < _MIN_ASSERTED:
            return None
        place = self._journal.place_of(seq) if seq else ("", 0, [])
        if place is None:
            return None
        segment, start, record = place
        image = closure.image()
        head = {
            "made_by": closure.fingerprint(),
            "origin": {
                "seq": seq,
                "epoch": self._epoch,
                "segment": segment,
                "start": start,
                "record": record,
                "sizes": dict(sizes),
            },
        }
        self._saved_seq, self._saved_changes = seq, closure.changes
        self._time = time.monotonic()

        def write() -> None:
            with self._writing:
                path = self._folder / f"{_PREFIX}{seq}"
                try:
                    _delete(path)
                    image.write(path, head)
                    self._prune()
                except OSError as error:
                    # The closure can always be rebuilt; a full disk must not stop a commit.
                    _log.warning("the closure was not saved in %s: %s", path, error)

        return write

    def _prune(self) -> None:
        """Delete all but the newest, and what a kill left half-written."""
        half_written = self._folder.glob(f"{_PREFIX}*.tmp")
        for path in (*half_written, *saved_folders(self._folder)[_MAX_SAVED:]):
            _delete(path)

    def discard(self) -> None:
        """Delete all saved closures."""
        with self._writing:
            self._saved_seq = -1
            discard_saved(self._folder)

    def damaged(self) -> Iterator[str]:
        """Yield what is wrong with each saved closure that is damaged."""
        from reasoner.saved.container import DamagedFolderError, read_head, require_whole

        for path in saved_folders(self._folder):
            try:
                require_whole(path, read_head(path))
            except (DamagedFolderError, StoreError) as error:
                yield f"{path.name} is damaged and will not be used: {error}"


def _identity(header: Mapping[str, Any]) -> list[Any]:
    return [header.get("seq"), header.get("time"), header.get("crc32")]
