"""The growing index of stored views: a log of immutable segments plus a small delta.

A change is written to a journal before it is acknowledged, and searched from the next query on.
When the delta is large enough it is sealed into a segment with hash tables; neighbouring segments
of like size are merged, so that a query meets few of them. The graph is the truth: the index can
be made again from (view, object, class, bytes of the features).
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

import numpy as np

from features.recognition.index.delta import Delta
from features.recognition.index.folder import IndexFolder, Manifest
from features.recognition.index.hashing import Hasher
from features.recognition.index.journal import Change, Journal, read_changes
from features.recognition.index.merge import MAX_DEAD, Piece, sealed_pieces
from features.recognition.index.segments import (
    Block,
    IndexCorruptError,
    ViewName,
    block_of_view,
    load_block,
    save_block,
)
from features.recognition.index.snapshot import Part, Snapshot
from features.recognition.views.view import EXTRACTOR, ViewFeatures

__all__ = ["RecognitionIndex"]

log = logging.getLogger(__name__)

SEAL_ROWS = 20_000


class RecognitionIndex:
    """Stored views of objects, found by their descriptors; grows and shrinks at any time.

    Any number of threads may query while one changes it. On disk there is one writer and any
    number of readers; killed at any point, the folder opens again with every acknowledged view.

    Parameters
    ----------
    path
        Folder, made when missing; None = in memory.
    mode
        ``"r"`` opens an existing folder without the writer's lock; see :meth:`refresh`.
    seal_rows
        Descriptors in the delta that make it a segment.

    Raises
    ------
    IndexLockedError
        When another process writes to the folder.
    IndexCorruptError
        When a file is damaged; :meth:`rebuild` makes the index again.

    Examples
    --------
    >>> from features.recognition.views.view import describe_view
    >>> chess = ((np.indices((80, 80)) // 10).sum(axis=0) % 2 * 255).astype(np.uint8)
    >>> with RecognitionIndex() as index:
    ...     index.add("view:1", "object:1", "class:Box", describe_view(chess, chess >= 0))
    ...     len(index), "view:1" in index
    (1, True)
    """

    def __init__(
        self,
        path: Path | str | None = None,
        mode: Literal["rw", "r"] = "rw",
        seal_rows: int = SEAL_ROWS,
    ) -> None:
        self._writing = threading.RLock()
        self._seal_rows = seal_rows
        self._writable = mode == "rw"
        self._journal: Journal | None = None
        self._manifest: Manifest | None = None
        self._seen: tuple[Any, ...] = ()
        self._hasher = Hasher.seeded()
        self._serial: dict[str, int] = {}
        self._last_serial = 0
        self._closing: list[Callable[[], None]] = []
        self._folder = None if path is None else IndexFolder(Path(path), self._writable)
        try:
            self._start([])
            if self._folder is not None:
                self._open(self._folder)
        except BaseException:
            self.close()
            raise

    def __len__(self) -> int:
        """Return the number of stored views."""
        return len(self._number)

    def __contains__(self, view_iri: object) -> bool:
        """Return whether a view is stored."""
        return view_iri in self._number

    def views(self) -> Iterator[ViewName]:
        """Return view, object and class of every stored view, in the order of adding."""
        snapshot = self._snapshot
        for view in np.flatnonzero(snapshot.alive):
            yield _name_of(snapshot, int(view))

    def snapshot(self) -> Snapshot:
        """Return what a query searches: it stays as it is while the index changes."""
        return self._snapshot

    def refresh(self) -> bool:
        """Look whether the writer changed the folder, and load it again if so (mode ``"r"``)."""
        if self._folder is None or self._writable:
            return False
        with self._writing:
            if self._seen == _state_of(self._folder):
                return False
            self._open(self._folder)
            return True

    def add(self, view_iri: str, object_iri: str, class_iri: str, features: ViewFeatures) -> None:
        """Store a view; one of the same IRI is replaced. Found by the next query.

        Raises
        ------
        ValueError
            When the features come from another version of the extractor.
        """
        if features.extractor != EXTRACTOR:
            raise ValueError(
                f"features of {view_iri} were made by {features.extractor!r}, this index holds "
                f"{EXTRACTOR!r}; describe the view again"
            )
        name = ViewName(view_iri, object_iri, class_iri)
        block = block_of_view(name, features, self._hasher)
        with self._writing:
            # In the journal first: killed between the two, the next opening makes the change again.
            self._record(Change("add", *name, features=features.to_bytes()))
            self._apply_add(name, block)
            if self._delta_rows() >= self._seal_rows:
                try:
                    self.save()
                except OSError as error:  # the view itself is safe in the journal
                    log.warning("cannot seal the index, trying again later: %s", error)

    def remove(self, view_iri: str) -> bool:
        """Forget a view; return whether there was one."""
        with self._writing:
            if view_iri not in self._number:
                return False
            self._record(Change("remove", view_iri))
            part = self._apply_remove(view_iri)
            sealed = part.block.tables is not None
            if sealed and not self._snapshot.alive[part.views()].mean() >= 1 - MAX_DEAD:
                self.save()
            return True

    def relabel(self, view_iri: str, object_iri: str, class_iri: str | None = None) -> None:
        """Say that a view shows another object; the class stays unless one is given.

        Raises
        ------
        KeyError
            When no such view is stored.
        """
        with self._writing:
            number = self._number[view_iri]
            kind = _name_of(self._snapshot, number).class_iri if class_iri is None else class_iri
            self._record(Change("relabel", view_iri, object_iri, kind))
            self._apply_relabel(ViewName(view_iri, object_iri, kind))

    def save(self) -> None:
        """Seal the delta into a segment, merge and compact; nothing is lost without it."""
        with self._writing:
            if not self._writable:
                raise ValueError("this index is closed, or open for reading only")
            pieces = sealed_pieces(self._pieces())
            if self._folder is not None:
                pieces = self._commit(self._folder, pieces)
            self._start(pieces)

    def file_beside(self, name: str, close: Callable[[], None]) -> Path | None:
        """Return where a file may lie that ``close`` closes before the index is; None = nowhere."""
        if self._folder is None or not self._writable:
            return None
        self._closing.append(close)
        return self._folder.path / name

    def close(self) -> None:
        """Release files and lock. What was added is stored already."""
        while self._closing:
            self._closing.pop()()
        with self._writing:
            if self._journal is not None:
                self._journal.close()
                self._journal = None
            self._writable = False
            if self._folder is not None:
                self._folder.release()

    def __enter__(self) -> RecognitionIndex:
        """Return the index itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close on leaving the block."""
        self.close()

    @classmethod
    def rebuild(
        cls, path: Path | str, views: Iterable[tuple[str, str, str, bytes]]
    ) -> RecognitionIndex:
        """Make the index of a folder again, whatever is in it, and return it open for writing.

        The old index stays until the new one is complete: killed before, nothing has changed.

        Parameters
        ----------
        views
            (view IRI, object IRI, class IRI, bytes of the features), as the graph has them.
        """
        memory = cls()
        for view_iri, object_iri, class_iri, data in views:
            memory.add(view_iri, object_iri, class_iri, ViewFeatures.from_bytes(data))
        memory.save()
        folder = IndexFolder(Path(path), writable=True)
        try:
            folder.write_header(memory._hasher)
            memory._commit(folder, memory._pieces())
        finally:
            memory.close()
            folder.release()
        return cls(path)

    def _open(self, folder: IndexFolder) -> None:
        """Load what the manifest names and make the journal's changes again."""
        self._seen = _state_of(folder)
        self._manifest = folder.read_manifest()
        if self._manifest is None:
            if not self._writable:
                raise FileNotFoundError(f"{folder.path} holds no index")
            folder.write_header(self._hasher)
            self._commit(folder, [])
            return
        self._hasher = folder.read_header()
        self._serial.clear()  # another process may have replaced a view under its IRI
        try:
            entries = self._manifest.segments
            self._start([Piece.of_entry(e, load_block(folder.path / e.name)) for e in entries])
            changes, length = read_changes(folder.path / self._manifest.journal)
        except FileNotFoundError as error:
            raise IndexCorruptError(Path(error.filename), "missing") from error
        for change in changes:
            self._apply(change)
        if self._writable:
            folder.sweep(self._manifest)
            self._journal = Journal(folder.path / self._manifest.journal, length)

    def _commit(self, folder: IndexFolder, pieces: list[Piece]) -> list[Piece]:
        """Write the pieces that have no folder yet and make them the index."""
        number, stored = folder.next_free_number(), []
        for piece in pieces:
            if piece.folder is None:
                fresh = f"seg-{number:06d}"
                save_block(folder.path / fresh, piece.block)
                piece = Piece(load_block(folder.path / fresh), piece.names, piece.alive, fresh)
                number += 1
            stored.append(piece)
        journal = Journal(folder.path / f"delta-{number:06d}.log")
        entries = tuple(piece.entry(str(piece.folder)) for piece in stored)
        manifest = Manifest(self._hasher.digest(), entries, journal.path.name)
        # Up to here the old index is whole, from here on the new one: this replaces one file.
        folder.commit(manifest)
        if self._journal is not None:
            self._journal.close()
        self._journal, self._manifest = journal, manifest
        folder.sweep(manifest)
        return stored

    def _record(self, change: Change) -> None:
        if not self._writable:
            raise ValueError("this index is closed, or open for reading only")
        if self._journal is not None:
            self._journal.append(change)

    def _apply(self, change: Change) -> None:
        name = ViewName(change.view_iri, change.object_iri, change.class_iri)
        if change.kind == "add":
            features = ViewFeatures.from_bytes(change.features)
            self._apply_add(name, block_of_view(name, features, self._hasher))
        elif change.view_iri in self._number and change.kind == "remove":
            self._apply_remove(change.view_iri)
        elif change.view_iri in self._number:
            self._apply_relabel(name)

    def _start(self, pieces: list[Piece]) -> None:
        """Take over sealed pieces and begin an empty delta."""
        self._delta = Delta()
        self._objects: dict[str, int] = {}
        self._classes: dict[str, int] = {}
        parts: list[Part] = []
        names: list[ViewName] = []
        for piece in pieces:
            rows_alive = piece.alive[piece.block.view_of_row].astype(np.uint8)
            parts.append(Part(piece.block, len(names), rows_alive))
            names.extend(piece.names)
        alive = np.concatenate([np.empty(0, bool), *(piece.alive for piece in pieces)])
        self._folders = tuple(piece.folder for piece in pieces)
        self._number = {names[v].view_iri: v for v in np.flatnonzero(alive).tolist()}
        serials = [
            self._serial_of(name.view_iri) if is_alive else 0
            for name, is_alive in zip(names, alive, strict=True)
        ]
        self._snapshot = Snapshot(
            parts=tuple(parts),
            object_of_view=np.array([self._object(n.object_iri) for n in names], np.int32),
            class_of_view=np.array([self._class(n.class_iri) for n in names], np.int32),
            alive=alive,
            view_iris=[n.view_iri for n in names],
            object_iris=list(self._objects),
            class_iris=list(self._classes),
            hasher=self._hasher,
            serials=np.array(serials, np.int64),
        )

    def _pieces(self) -> list[Piece]:
        """Return every part with today's names; the delta comes last, without a folder."""
        snapshot = self._snapshot
        folders = (*self._folders, None)
        pieces = []
        for part, folder in zip(snapshot.parts, folders, strict=False):
            views = part.views()
            names = tuple(_name_of(snapshot, v) for v in range(views.start, views.stop))
            pieces.append(Piece(part.block, names, snapshot.alive[views], folder))
        return pieces

    def _apply_add(self, name: ViewName, block: Block) -> None:
        if name.view_iri in self._number:
            self._apply_remove(name.view_iri)
        old = self._snapshot
        self._delta.append(block)
        alive = np.ones(len(block), np.uint8)
        sealed, growing = old.parts[: len(self._folders)], old.parts[len(self._folders) :]
        first = growing[0].first_view if growing else len(old.alive)
        if growing:
            alive = np.concatenate([growing[0].alive, alive])
        self._number[name.view_iri] = len(old.alive)
        self._serial.pop(name.view_iri, None)
        self._publish(
            parts=(*sealed, Part(self._delta.block(), first, alive)),
            object_of_view=np.append(old.object_of_view, self._object(name.object_iri)),
            class_of_view=np.append(old.class_of_view, self._class(name.class_iri)),
            alive=np.append(old.alive, True),
            view_iris=[*old.view_iris, name.view_iri],
            serials=np.append(old.serials, self._serial_of(name.view_iri)),
        )

    def _apply_remove(self, view_iri: str) -> Part:
        old = self._snapshot
        number = self._number.pop(view_iri)
        # Queries that are running keep their snapshot, so arrays are replaced and never changed.
        views = old.alive.copy()
        views[number] = False
        parts = list(old.parts)
        position = next(p for p, part in enumerate(parts) if number < part.views().stop)
        part = parts[position]
        alive = part.alive.copy()
        alive[part.block.rows_of(number - part.first_view)] = 0
        parts[position] = Part(part.block, part.first_view, alive)
        self._publish(parts=tuple(parts), alive=views)
        return parts[position]

    def _apply_relabel(self, name: ViewName) -> None:
        number = self._number[name.view_iri]
        objects = self._snapshot.object_of_view.copy()
        classes = self._snapshot.class_of_view.copy()
        objects[number] = self._object(name.object_iri)
        classes[number] = self._class(name.class_iri)
        self._publish(object_of_view=objects, class_of_view=classes)

    def _publish(self, **changed: Any) -> None:
        fields = {**self._snapshot.__dict__, **changed}
        fields["object_iris"], fields["class_iris"] = list(self._objects), list(self._classes)
        self._snapshot = Snapshot(**fields)

    def _object(self, iri: str) -> np.int32:
        return np.int32(self._objects.setdefault(iri, len(self._objects)))

    def _class(self, iri: str) -> np.int32:
        return np.int32(self._classes.setdefault(iri, len(self._classes)))

    def _serial_of(self, view_iri: str) -> int:
        """Return the serial number of a view, the next one for a view that has none."""
        if view_iri not in self._serial:
            self._last_serial += 1
            self._serial[view_iri] = self._last_serial
        return self._serial[view_iri]

    def _delta_rows(self) -> int:
        growing = self._snapshot.parts[len(self._folders) :]
        return len(growing[0].block) if growing else 0


def _name_of(snapshot: Snapshot, view: int) -> ViewName:
    return ViewName(
        snapshot.view_iris[view],
        snapshot.object_iris[snapshot.object_of_view[view]],
        snapshot.class_iris[snapshot.class_of_view[view]],
    )


def _state_of(folder: IndexFolder) -> tuple[Any, ...]:
    """Return what changes whenever the index in a folder does: manifest and journal length."""
    manifest = folder.read_manifest()
    if manifest is None:
        return ()
    journal = folder.path / manifest.journal
    return manifest.to_json(), journal.stat().st_size if journal.exists() else 0
