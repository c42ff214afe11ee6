"""A folder with one file of arrays, one document and a head that names and checks both.

The folder is written under a temporary name and renamed when all of it is on disk, so it is either
whole or not there. Reading compares sizes and CRC-32 checksums, those of the head included.
"""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from reasoner.terms.table import Array

FORMAT = 1
HEAD = "head.json"
_ARRAYS = "arrays.bin"
_DOCUMENT = "program.json"
_ALIGNMENT = 8
_PIECE = 1 << 20


class DamagedFolderError(ValueError):
    """A folder is not as it was written; the message says what differs."""


def write_folder(
    folder: Path,
    arrays: Mapping[str, Array],
    document: Mapping[str, Any],
    head: Mapping[str, Any],
) -> None:
    """Write a folder, durably and all or nothing.

    Parameters
    ----------
    folder : Path
        Must not exist; its parent must.
    arrays : mapping of str to array
    document, head : mapping of str to object
        JSON-able; `read_head` returns the head without reading anything else.
    """
    temporary = folder.with_name(folder.name + ".tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    layout: dict[str, tuple[str, int, int]] = {}
    files = {}
    pieces: list[bytes] = []
    offset = 0
    for name, array in arrays.items():
        content = np.ascontiguousarray(array)
        gap = -offset % _ALIGNMENT
        layout[name] = (content.dtype.str, offset + gap, len(content))
        pieces += [b"\0" * gap, content.tobytes()]
        offset += gap + content.nbytes
    files[_ARRAYS] = _write(temporary / _ARRAYS, pieces)
    files[_DOCUMENT] = _write(temporary / _DOCUMENT, [json.dumps(document).encode()])
    whole = {**head, "format": FORMAT, "arrays": layout, "files": files}
    text = json.dumps(whole)
    line = json.dumps({"crc32": zlib.crc32(text.encode())})
    _write(temporary / HEAD, [text.encode(), b"\n", line.encode(), b"\n"])
    _sync_folder(temporary)
    temporary.rename(folder)
    _sync_folder(folder.parent)


def _write(path: Path, pieces: list[bytes]) -> tuple[int, int]:
    """Write a file durably; return its size and checksum."""
    size = checksum = 0
    with path.open("wb") as out:
        for piece in pieces:
            out.write(piece)
            checksum = zlib.crc32(piece, checksum)
            size += len(piece)
        out.flush()
        os.fsync(out.fileno())
    return size, checksum


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_head(folder: Path) -> dict[str, Any]:
    """Return the head of a folder.

    Raises
    ------
    DamagedFolderError
        The head is missing, damaged, or of another format.
    """
    try:
        text, line, *rest = (folder / HEAD).read_bytes().split(b"\n")
        head: dict[str, Any] = json.loads(text)
        if json.loads(line) != {"crc32": zlib.crc32(text)} or rest != [b""]:
            raise DamagedFolderError(f"the checksum of {HEAD} does not match")
        if head["format"] != FORMAT:
            raise DamagedFolderError(f"format {head['format']}, this version reads {FORMAT}")
    except DamagedFolderError:
        raise
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DamagedFolderError(f"{HEAD} cannot be read: {error}") from error
    return head


def read_folder(folder: Path, head: Mapping[str, Any]) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays, mapped into memory and read-only, and the document of a folder.

    Raises
    ------
    DamagedFolderError
        A file is missing or is not as it was written.
    """
    require_whole(folder, head)
    document: dict[str, Any] = json.loads((folder / _DOCUMENT).read_bytes())
    path = folder / _ARRAYS
    has_data = path.stat().st_size > 0  # an empty file cannot be mapped
    data = np.memmap(path, np.uint8, mode="r") if has_data else np.empty(0, np.uint8)
    arrays: dict[str, Array] = {}
    for name, (kind, offset, length) in head["arrays"].items():
        dtype = np.dtype(kind)
        part = np.asarray(data)[offset : offset + length * dtype.itemsize]
        arrays[name] = part.view(dtype)
    return arrays, document


def require_whole(folder: Path, head: Mapping[str, Any]) -> None:
    """Compare the files of a folder with their sizes and checksums.

    Raises
    ------
    DamagedFolderError
        One differs; the message names it.
    """
    for name, (size, checksum) in head["files"].items():
        try:
            measured = _measure(folder / name)
        except OSError as error:
            raise DamagedFolderError(f"{name} cannot be read: {error.strerror}") from error
        if measured != (size, checksum):
            what = "size" if measured[0] != size else "checksum"
            raise DamagedFolderError(f"the {what} of {name} does not match")


def _measure(path: Path) -> tuple[int, int]:
    size = checksum = 0
    with path.open("rb") as file:
        while piece := file.read(_PIECE):
            size += len(piece)
            checksum = zlib.crc32(piece, checksum)
    return size, checksum
