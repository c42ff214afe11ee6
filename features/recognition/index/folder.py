"""The folder of an index: lock, header, and the manifest whose replacement is every commit.

Whatever the manifest does not name is the rest of a writer that was killed, and is deleted when
the next one opens the folder.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from features.recognition.index.hashing import Hasher
from features.recognition.index.segments import IndexCorruptError, sync_folder, write_durably
from features.recognition.views.view import EXTRACTOR

__all__ = ["IndexFolder", "IndexLockedError", "Manifest", "SegmentEntry"]

FORMAT = 1
_MANIFEST, _HEADER, _LOCK = "manifest.json", "header.npz", "lock"


class IndexLockedError(RuntimeError):
    """Another writer has the folder open."""


@dataclass(frozen=True)
class SegmentEntry:
    """A segment and what changed since it was written.

    Parameters
    ----------
    name
        Of its folder.
    dead
        Views removed since.
    relabelled
        View -> (object IRI, class IRI).
    """

    name: str
    dead: tuple[int, ...] = ()
    relabelled: dict[int, tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """List of the files that make up the index.

    Parameters
    ----------
    header
        Digest of the projections with which all codes were made.
    segments
        In the order of their views.
    journal
        File with the changes since.
    """

    header: str
    segments: tuple[SegmentEntry, ...]
    journal: str

    def to_json(self) -> bytes:
        """Return the text of the file."""
        segments = [
            {"name": s.name, "dead": list(s.dead), "relabelled": s.relabelled}
            for s in self.segments
        ]
        content = {
            "format": FORMAT,
            "extractor": EXTRACTOR,
            "header": self.header,
            "segments": segments,
            "journal": self.journal,
        }
        return json.dumps(content, indent=1).encode()

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Manifest:
        """Read what :meth:`to_json` wrote."""
        segments = tuple(
            SegmentEntry(
                str(s["name"]),
                tuple(s["dead"]),
                {int(view): (new[0], new[1]) for view, new in s["relabelled"].items()},
            )
            for s in content["segments"]
        )
        header, journal = str(content["header"]), str(content["journal"])
        return cls(header, segments, journal)


class IndexFolder:
    """Opens, locks and commits the folder of an index.

    Parameters
    ----------
    path
        Made when missing and ``writable``.
    writable
        Take the writer's lock; a reader takes none.
    """

    def __init__(self, path: Path, writable: bool) -> None:
        self.path = path
        self._lock: int | None = None
        if writable:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = self._take_lock()

    def _take_lock(self) -> int:
        handle = os.open(self.path / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.read(handle, 32).decode(errors="replace").strip() or "unknown"
            os.close(handle)
            raise IndexLockedError(
                f"{self.path} is open for writing in process {holder}; one index has one writer"
            ) from None
        os.ftruncate(handle, 0)
        os.write(handle, f"{os.getpid()}\n".encode())
        return handle

    def release(self) -> None:
        """Give the writer's lock back."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def read_header(self) -> Hasher:
        """Return the projections that the index was made with."""
        try:
            with np.load(self.path / _HEADER, allow_pickle=False) as arrays:
                return Hasher(**{name: arrays[name].astype(np.int16) for name in arrays.files})
        except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise IndexCorruptError(self.path / _HEADER, f"unreadable ({error})") from error

    def write_header(self, hasher: Hasher) -> None:
        """Store the projections; before the first manifest."""
        with (self.path / _HEADER).open("wb") as file:
            arrays: dict[str, Any] = hasher.arrays()
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())

    def read_manifest(self) -> Manifest | None:
        """Return the manifest, or nothing where no index was made yet."""
        path = self.path / _MANIFEST
        if not path.exists():
            return None
        try:
            content = json.loads(path.read_bytes())
            if content["format"] != FORMAT or content["extractor"] != EXTRACTOR:
                raise IndexCorruptError(path, "made by another version of the extractor")
            manifest = Manifest.from_json(content)
        except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            if isinstance(error, IndexCorruptError):
                raise
            raise IndexCorruptError(path, f"unreadable ({error})") from error
        if self.read_header().digest() != manifest.header:
            raise IndexCorruptError(self.path / _HEADER, "not the header that the manifest names")
        return manifest

    def commit(self, manifest: Manifest) -> None:
        """Replace the manifest: from here on what it names is the index."""
        fresh = self.path / (_MANIFEST + ".tmp")
        write_durably(fresh, manifest.to_json())
        fresh.replace(self.path / _MANIFEST)
        sync_folder(self.path)

    def next_free_number(self) -> int:
        """Return a number above those in all names: no name is ever used for something else."""
        numbers = [
            int(path.name.split("-")[1].split(".")[0])
            for pattern in ("seg-*", "delta-*.log")
            for path in self.path.glob(pattern)
            if path.name.split("-")[1].split(".")[0].isdigit()
        ]
        return max(numbers, default=0) + 1

    def sweep(self, manifest: Manifest) -> None:
        """Delete what the manifest does not name; maps that are open stay readable."""
        named = {segment.name for segment in manifest.segments} | {manifest.journal}
        for path in [*self.path.glob("seg-*"), *self.path.glob("delta-*.log")]:
            if path.name not in named:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        (self.path / (_MANIFEST + ".tmp")).unlink(missing_ok=True)
