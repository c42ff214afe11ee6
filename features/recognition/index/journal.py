"""The log of changes since the last seal: what makes an acknowledged change survive a kill.

A record is its length and CRC-32 (both little-endian uint32) and a payload: one line of JSON that
says what happened, then the bytes of the view's features when one was added.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from features.recognition.index.segments import IndexCorruptError

__all__ = ["Change", "Journal", "read_changes"]

_HEAD = struct.Struct("<II")


@dataclass(frozen=True)
class Change:
    """One change of the index.

    Parameters
    ----------
    kind
        ``"add"``, ``"remove"`` or ``"relabel"``.
    view_iri, object_iri, class_iri
        The last two empty where they do not apply.
    features
        Bytes of the view's features when it was added.
    """

    kind: str
    view_iri: str
    object_iri: str = ""
    class_iri: str = ""
    features: bytes = b""

    def to_bytes(self) -> bytes:
        """Return the payload of a record."""
        line = json.dumps([self.kind, self.view_iri, self.object_iri, self.class_iri])
        return line.encode() + b"\n" + self.features

    @classmethod
    def from_bytes(cls, payload: bytes) -> Change:
        """Read the payload of a record."""
        line, _, features = payload.partition(b"\n")
        kind, view_iri, object_iri, class_iri = json.loads(line)
        return cls(kind, view_iri, object_iri, class_iri, features)


def read_changes(path: Path) -> tuple[list[Change], int]:
    """Read all whole records.

    Returns
    -------
    changes
        In the order in which they were made.
    length
        Bytes of the whole records. What follows is the torn record of a writer that was killed
        before it could acknowledge the change: to be cut off.

    Raises
    ------
    IndexCorruptError
        When a damaged record has others behind it: that is no torn end.
    """
    data = path.read_bytes()
    changes: list[Change] = []
    position = 0
    while position + _HEAD.size <= len(data):
        length, crc = _HEAD.unpack_from(data, position)
        end = position + _HEAD.size + length
        payload = data[position + _HEAD.size : end]
        if end > len(data) or zlib.crc32(payload) != crc:
            if end < len(data):
                raise IndexCorruptError(path, f"damaged record at byte {position}")
            break
        try:
            changes.append(Change.from_bytes(payload))
        except (ValueError, TypeError) as error:
            raise IndexCorruptError(path, f"unreadable record at byte {position}") from error
        position = end
    return changes, position


class Journal:
    """Appends changes to a log; an append that returned is on the disk.

    Parameters
    ----------
    path
        Made when missing; cut to ``length`` bytes.
    length
        What :func:`read_changes` found to be whole.
    """

    def __init__(self, path: Path, length: int = 0) -> None:
        self.path = path
        self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        self._file.truncate(length)
        self._file.seek(length)

    def append(self, change: Change) -> None:
        """Write one change through to the disk; on failure the log is as it was before."""
        payload = change.to_bytes()
        rest = memoryview(_HEAD.pack(len(payload), zlib.crc32(payload)) + payload)
        start = self._file.tell()
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            os.fsync(self._file.fileno())
        except OSError:
            self._file.seek(start)
            self._file.truncate(start)
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Journal:
        """Return the journal itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> Any:
        """Close on leaving the block."""
        self.close()
