"""The seal of a journal: sizes and checksums of its segments when the folder was closed.

A journal that differs from its seal was changed, truncated or deleted by something else. Without
this check such a folder would open without an error and reuse commit numbers.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import TypeAlias

from rtask.errors import StoreFormatError
from rtask.kb.durability.journal import JournalFile

__all__ = ["Seal", "require_sealed", "seal"]

Seal: TypeAlias = dict[str, tuple[int, int]]
_PIECE = 1 << 20


def seal(journal: JournalFile, earlier: Seal | None = None) -> Seal:
    """Return size and CRC-32 of each segment.

    Parameters
    ----------
    earlier
        An earlier seal. Only the last segment is ever written to, so the checksums of the others
        are copied from it where the size is the same.
    """
    segments = journal.segments()
    made: Seal = {}
    for path in segments:
        size = path.stat().st_size
        before = (earlier or {}).get(path.name)
        # Old segments never grow; to read them all would be to read a gigabyte at each closing.
        if before is not None and before[0] == size and path != segments[-1]:
            made[path.name] = before
        else:
            made[path.name] = (size, _checksum(path))
    return made


def require_sealed(folder: Path, journal: JournalFile, sealed: Seal) -> None:
    """Raise if the journal has changed since the folder was closed.

    The checksum is computed for the last segment only; for the others the size is compared.
    ``rtask verify`` reads them all.

    Raises
    ------
    StoreFormatError
        The journal has changed; the error names the segment and the remedy.
    """
    paths = {path.name: path for path in journal.segments()}
    problem = ""
    for name, (size, checksum) in sealed.items():
        path = paths.pop(name, None)
        if path is None:
            problem = f"{name} is missing"
        elif path.stat().st_size != size:
            problem = f"{name} has {path.stat().st_size} bytes instead of {size}"
        elif name == max(sealed) and _checksum(path) != checksum:
            problem = f"the checksum of {name} does not match"
        if problem:
            break
    if not problem and paths:
        problem = f"{min(paths)} was added"
    if problem:
        raise StoreFormatError(
            f"the journal in {folder} was changed after it was closed: {problem}; restore a "
            f"backup, or continue without its history: rtask rebuild journal -d {folder}",
            damaged="journal",
        )


def _checksum(path: Path) -> int:
    value = 0
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            value = zlib.crc32(piece, value)
    return value
