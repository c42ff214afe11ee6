"""Earlier states of a graph: a copy of the nearest kept state with the commits between replayed.

The copy consists of hard links, so it costs as much as the commits to replay, whatever the size of
the graph. States are kept by the :class:`rtask.kb.durability.ladder.Ladder` of its folder: the
first question about a stretch of the past pays for the way there, and those that follow do not.
"""

from __future__ import annotations

import datetime as dt
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode, Store

from rtask.errors import GoneError, UnsupportedError, UsageError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.disk_space import full_disk, means_full
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile, NoJournal, Record
from rtask.kb.durability.ladder import SPACING, Ladder, Rung
from rtask.kb.durability.private_copy import PastCopy
from rtask.kb.durability.recovery import replay_all, undo_all
from rtask.kb.feed.feed import Feed
from rtask.kb.store.embedded import EmbeddedStore, embedded_store
from rtask.kb.store.graphs import Graphs

__all__ = [
    "commit_at", "copy_as_of", "may_lack_some", "records_after", "replayed_for", "turn_back",
]  # fmt: skip

_LAST = sys.maxsize
"""Stands for the last commit: the copy of the current state may hold one more than is known."""
_FLUSHED_BYTES = 1 << 20
"""Undone text from which the copy is flushed: less is read anew from its log by each reader."""


def commit_at(files: Files, time: dt.datetime) -> int:
    """Return the number of the last commit whose clock showed no later time; 0 before the first.

    Where the clock was set back, later commits may show earlier times: the number decides, so the
    state includes all that were made before that commit.

    Raises
    ------
    GoneError
        The journal no longer reaches so far back.
    UnsupportedError
        The store keeps no journal.
    """
    first, latest = _journal(files).marks.at(time)
    if latest is None and first is not None and first.seq > 1:
        raise GoneError(
            f"the journal begins at commit {first.seq}, which is after {time.isoformat()}"
        )
    return 0 if latest is None else latest.seq


def copy_as_of(
    files: Files, graphs: Graphs, feed: Feed, last_seq: int, seq: int
) -> tuple[Files, Catalogue, Writer]:
    """Return the state of a graph after a commit, as a read-only copy.

    Parameters
    ----------
    files, graphs, feed
        Parts of the current graph.
    last_seq
        Number of the current graph's last commit.
    seq
        Number of the commit to return to.

    Raises
    ------
    UsageError
        There is no such commit.
    GoneError
        The journal no longer contains the commits since then.
    UnsupportedError
        The store keeps no journal, or a bulk load was made since then.
    StorageFullError
        The disk has no room for the copy.
    """
    journal = _journal(files)
    if seq < 0 or seq > last_seq:
        raise UsageError(f"there is no commit {seq}; the last one is {last_seq}")
    feed.require_retained(seq)
    assert files.folder is not None
    try:
        held = PastCopy(files.folder)
    except OSError as error:
        if means_full(error):
            raise full_disk(files.folder, "for a copy of an earlier state") from error
        raise UnsupportedError(
            f"an earlier state needs a folder that can be written: {files.folder}"
        ) from error
    try:
        store = _turned_back(files, graphs, journal, held.path, seq)
    except BaseException as error:
        held.release()
        if means_full(error):
            if files.ladder is not None:
                files.ladder.clear()  # what can be made again gives way to what cannot
            raise full_disk(files.folder, "for a copy of an earlier state") from error
        raise
    return _closed_for_writing(files, graphs, store, held, seq)


def _journal(files: Files) -> JournalFile:
    if isinstance(files.journal, JournalFile) and files.folder is not None:
        return files.journal
    raise UnsupportedError(
        "a store in memory keeps no journal, so earlier states are unavailable; use a folder"
    )


def _turned_back(
    files: Files, graphs: Graphs, journal: JournalFile, folder: Path, seq: int
) -> EmbeddedStore:
    return turn_back(files, graphs, journal, str(folder / "store"), seq)


def turn_back(
    files: Files, graphs: Graphs, journal: JournalFile, path: str, seq: int
) -> EmbeddedStore:
    """Make the store of an earlier state, from the nearest one that is kept or from the current.

    It is returned open: opening it again takes a fifth of the time of a question about the past.

    Raises
    ------
    UnsupportedError
        A bulk load was made since then.
    """
    ladder = files.ladder
    for state, distance in _sources(ladder, journal, seq):
        if ladder is None or state is None:
            break
        if ladder.copy(state, Path(path)):
            try:
                return _Replay(files, graphs, journal, path, state.seq, seq, distance).run()
            except UnsupportedError:  # a bulk load lies between; from the other side it does not
                shutil.rmtree(path, ignore_errors=True)
    # A commit stored while copying may or may not be in the copy. Undoing one that is not does no
    # harm.
    with files.store.complete():
        embedded_store(files.store, "an earlier state").raw.backup(path)
    distance = journal.marks.changed(seq, _LAST)
    return _Replay(files, graphs, journal, path, _LAST, seq, distance).run()


def replayed_for(files: Files, seq: int) -> int:
    """Return how many statements are replayed for an earlier state, from the nearest one kept."""
    journal = files.journal
    if not isinstance(journal, JournalFile):
        return 0
    return min(distance for _, distance in _sources(files.ladder, journal, seq))


def _sources(
    ladder: Ladder | None, journal: JournalFile, seq: int
) -> list[tuple[Rung | None, int]]:
    """Return the kept states beside a commit, and None for the current one, the nearest first."""
    sources: list[tuple[Rung | None, int]] = [(None, journal.marks.changed(seq, _LAST))]
    if ladder is not None and sources[0][1]:
        sources += [(rung, ladder.distance(rung.seq, seq)) for rung in ladder.beside(seq)]
    return sorted(sources, key=lambda source: source[1])


@dataclass(frozen=True)
class _Replay:
    """Way from one state of a store to another, backwards or forwards through the journal.

    Parameters
    ----------
    path
        Folder of the store, which holds the state after ``source``.
    source, seq
        Numbers of the commits.
    distance
        Statements that the commits between changed.
    """

    files: Files
    graphs: Graphs
    journal: JournalFile
    path: str
    source: int
    seq: int
    distance: int

    def run(self) -> EmbeddedStore:
        """Replay, and keep copies on the way if it is long; return the store.

        Raises
        ------
        UnsupportedError
            The journal does not hold all that changed on the way.
        """
        if not self.distance:
            # A state that is kept: opening it for writing takes a third of the time of a question.
            return EmbeddedStore(Store.read_only(self.path), self.path)
        store = EmbeddedStore(Store(self.path), self.path)
        settings = self.files.settings
        try:
            store.is_view = settings.is_view
            size, is_whole = 0, True
            for after, upto in self._stretches():
                records = list(_records_between(self.journal, after, upto))
                is_whole = is_whole and not any(map(may_lack_some, records))
                if self.source > self.seq:
                    undo_all(store, reversed(records), settings.is_merged)
                    reached = after
                else:
                    if not records or records[0].seq != after + 1:
                        raise UnsupportedError(f"the journal has no record of commit {after + 1}")
                    replay_all(store, records, settings.is_merged)
                    reached = upto
                size += sum(len(record.body) for record in records)
                self._keep(store, reached, is_whole)
            # Counting graphs takes longer than undoing a few commits, so only where it can differ.
            if not settings.plain and not is_whole:
                _require_whole(store, self.graphs, Catalogue(store, self.graphs), self.seq)
            if size > _FLUSHED_BYTES:
                store.flush()
        except BaseException:
            store.close()
            raise
        store.is_past = True
        return store

    def _stretches(self) -> Iterator[tuple[int, int]]:
        """Yield the commits on the way, as (after, up to); a copy is kept after each piece."""
        low, high = sorted((self.seq, self.source))
        is_back = self.source > self.seq
        if self.distance <= SPACING:
            yield low, high
            return
        marks = list(self.journal.marks.between(low, high))
        changed, start = 0, high if is_back else low
        for mark in reversed(marks) if is_back else marks:
            changed += mark.changed
            if changed >= SPACING:
                end = mark.seq - 1 if is_back else mark.seq
                yield (end, start) if is_back else (start, end)
                changed, start = 0, end
        if start != self.seq:
            yield (low, start) if is_back else (start, high)

    def _keep(self, store: EmbeddedStore, reached: int, is_whole: bool) -> None:
        """Keep a copy of a state on a long way, unless it may lack what was loaded in bulk."""
        ladder = self.files.ladder
        if ladder is not None and self.distance > SPACING and is_whole:
            store.flush()
            ladder.keep(store.raw, reached)


def records_after(journal: JournalFile, seq: int) -> list[Record]:
    """Return the records after a commit, oldest first, without reading those before."""
    mark = next(journal.marks.after(seq), None)
    return [] if mark is None else list(journal.records_from(mark.segment, mark.start))


def _records_between(journal: JournalFile, after: int, upto: int) -> Iterator[Record]:
    """Yield the records after a commit and up to another, oldest first."""
    mark = next(journal.marks.after(after), None)
    if mark is not None:
        for record in journal.records_from(mark.segment, mark.start):
            if record.seq > upto:
                return
            yield record


def may_lack_some(record: Record) -> bool:
    """Whether a record may hold less than its commit changed: bulk loads, and lost records."""
    return bool(record.header.get("partial")) or record.header.get("kind") != "delta"


def _require_whole(store: EmbeddedStore, graphs: Graphs, catalogue: Catalogue, seq: int) -> None:
    """Compare graph sizes with the catalogue of that commit, since the journal omits bulk loads."""
    for graph in store.named_graphs():
        if graph in (graphs.meta, graphs.provenance) or not isinstance(graph, NamedNode):
            continue
        if store.count(graph) != catalogue.triple_count(graph):
            raise UnsupportedError(
                f"{graph} was loaded in bulk after commit {seq}, which the journal does not hold; "
                "restore a backup",
                graph=graph.value,
            )


def _closed_for_writing(
    files: Files, graphs: Graphs, store: EmbeddedStore, held: PastCopy, seq: int
) -> tuple[Files, Catalogue, Writer]:
    copy = Files(files.settings, store, files.blobs, NoJournal(), last_seq=seq, held=held)
    copy.store.is_view = files.settings.is_view
    catalogue = Catalogue(copy.store, graphs)
    plain = files.settings.plain
    committer = Committer(
        copy.store, graphs, plain, copy.blobs, catalogue, None, copy.journal, last_seq=seq
    )
    writer = Writer(committer)
    writer.close()
    return copy, catalogue, writer
