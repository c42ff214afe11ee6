"""Blocks of views and their descriptors, in memory or as an immutable folder of flat files.

Each array is one little-endian file named after what it holds, opened with ``numpy.memmap``;
``meta.json`` carries the shape and CRC-32 of every file and is written last.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.cascade import build_tables
from features.recognition.index.hashing import TABLES, Hasher, used_table_bits
from features.recognition.views.appearance import APPEARANCE_SIZE, colours_of
from features.recognition.views.light import spread
from features.recognition.views.shape import SHAPE_SIZE
from features.recognition.views.view import ViewFeatures

__all__ = ["Block", "IndexCorruptError", "ViewName", "block_of_view", "load_block", "save_block"]

# Field of a block -> file, little-endian type, columns (0 = a vector), counted per row or view.
_LAYOUT: dict[str, tuple[str, str, int, str]] = {
    "descriptors": ("desc.u8", "u1", 128, "row"),
    "codes": ("code.u64", "<u8", 2, "row"),
    "buckets": ("bucket.u32", "<u4", TABLES, "row"),
    "keypoints": ("kp.f32", "<f4", 4, "row"),
    "points3d": ("xyz.f32", "<f4", 3, "row"),
    "view_of_row": ("view.i32", "<i4", 0, "row"),
    "looks": ("look.f32", "<f4", APPEARANCE_SIZE, "view"),
    "measures": ("measure.f32", "<f4", 3, "view"),
    "shapes": ("shape.f32", "<f4", SHAPE_SIZE, "view"),
}
_NAMES = "views.jsonl"
_PICTURES = "picture.bin"
_TABLE_FILES = {"offsets": "off.i32", "rows": "ids.i32"}


class IndexCorruptError(ValueError):
    """A file of the index is damaged; the index can be made again from the graph."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}; make the index again with 'rtask rebuild'")
        self.path = path


class ViewName(NamedTuple):
    """Identifiers of a view, its object and its class; IRIs are opaque here."""

    view_iri: str
    object_iri: str
    class_iri: str


@dataclass(frozen=True, eq=False)
class Block:
    """V views with N descriptors in all; the rows of a view stand together, in order.

    Parameters
    ----------
    descriptors : (N, 128) uint8
    codes : (N, 2) uint64
    buckets : (N, L) uint32
    keypoints : (N, 4) float32
    points3d : (N, 3) float32
    view_of_row : (N,) int32
        0 to V - 1, ascending.
    looks : (V, 768) float32
        Appearance vectors.
    measures : (V, 3) float32
        Longer side of the mask (px), visible diagonal (m or NaN), 1 where the object was cut.
    shapes : (V, 240) float32
        Histograms of shape, NaN where there is none.
    names
        Of each view.
    tables
        Offsets and rows of the hash tables, where the block has them.
    pictures
        Encoded picture of each view, empty where there is none; none at all in a block that was
        written before pictures were kept.
    """

    descriptors: UInt8Array
    codes: NDArray[np.uint64]
    buckets: NDArray[np.uint32]
    keypoints: NDArray[np.float32]
    points3d: NDArray[np.float32]
    view_of_row: NDArray[np.int32]
    looks: NDArray[np.float32]
    measures: NDArray[np.float32]
    shapes: NDArray[np.float32]
    names: tuple[ViewName, ...] = ()
    tables: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
    pictures: tuple[bytes | memoryview, ...] = ()

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.descriptors)

    @cached_property
    def colours(self) -> NDArray[np.float32]:
        """Colour histograms (V, 192) of the views, spread over neighbouring bins."""
        return spread(colours_of(self.looks))

    def rows_of(self, view: int) -> slice:
        """Return the rows of one view."""
        # Numbers of another type would have the whole column converted for every view.
        ends = np.array([view, view + 1], self.view_of_row.dtype)
        start, stop = np.searchsorted(self.view_of_row, ends)
        return slice(int(start), int(stop))

    def picture(self, view: int) -> bytes | memoryview:
        """Return the encoded picture of one view, empty where there is none."""
        return self.pictures[view] if view < len(self.pictures) else b""

    def arrays(self) -> dict[str, Any]:
        """Return every array by its field's name, without the tables."""
        return {field: getattr(self, field) for field in _LAYOUT}

    def with_tables(self) -> Block:
        """Return the block with hash tables, their size chosen by the number of rows."""
        tables = build_tables(np.ascontiguousarray(self.buckets), used_table_bits(len(self)))
        return Block(**self.arrays(), names=self.names, tables=tables, pictures=self.pictures)

    def kept(self, views: NDArray[np.bool_], names: Sequence[ViewName]) -> Block:
        """Return only the chosen views (V,) under the names (V) that they have by now."""
        rows = views[self.view_of_row]
        number = np.cumsum(views) - 1
        chosen = {
            field: array[views if _LAYOUT[field][3] == "view" else rows]
            for field, array in self.arrays().items()
        }
        chosen["view_of_row"] = number[chosen["view_of_row"]].astype(np.int32)
        return Block(
            **chosen,
            names=tuple(n for n, keep in zip(names, views, strict=True) if keep),
            pictures=tuple(self.picture(v) for v in np.flatnonzero(views).tolist()),
        )

    @staticmethod
    def joined(blocks: Sequence[Block]) -> Block:
        """Return one block with the views of several, without tables."""
        first_views = np.cumsum([0] + [len(b.looks) for b in blocks])
        columns: dict[str, Any] = {
            field: np.concatenate([b.arrays()[field] for b in blocks]) for field in _LAYOUT
        }
        columns["view_of_row"] = np.concatenate(
            [b.view_of_row + first for b, first in zip(blocks, first_views[:-1], strict=True)]
        ).astype(np.int32)
        return Block(
            **columns,
            names=tuple(name for b in blocks for name in b.names),
            pictures=tuple(b.picture(v) for b in blocks for v in range(len(b.looks))),
        )

    @staticmethod
    def empty(rows: int = 0, views: int = 0) -> Block:
        """Return a block of that many unset rows and views."""
        columns: dict[str, Any] = {}
        for field, (_, dtype, width, per) in _LAYOUT.items():
            count = rows if per == "row" else views
            columns[field] = np.zeros((count, width) if width else (count,), dtype)
        return Block(**columns)


def block_of_view(name: ViewName, features: ViewFeatures, hasher: Hasher) -> Block:
    """Return the block of a single view."""
    codes, buckets = hasher.encode(features.descriptors)
    measures = [features.side_px, features.size_m, float(features.is_cut)]
    unknown = np.full(SHAPE_SIZE, np.nan, np.float32)
    return Block(
        descriptors=features.descriptors,
        codes=codes,
        buckets=buckets,
        keypoints=features.keypoints,
        points3d=features.points3d,
        view_of_row=np.zeros(len(features), np.int32),
        looks=features.appearance[None, :],
        measures=np.array([measures], np.float32),
        shapes=(unknown if features.shape is None else features.shape)[None, :],
        names=(name,),
        pictures=(features.picture,),
    )


def save_block(folder: Path, block: Block) -> None:
    """Write a block with tables as a new folder; complete once ``meta.json`` is there."""
    folder.mkdir()
    files: dict[str, bytes] = {}
    for field, (file_name, dtype, _, _) in _LAYOUT.items():
        array = np.asarray(getattr(block, field))
        files[file_name] = np.ascontiguousarray(array, dtype).tobytes()
    if block.tables is None:
        raise ValueError("a block is stored with its tables; see Block.with_tables")
    offsets, rows = block.tables
    files[_TABLE_FILES["offsets"]] = np.ascontiguousarray(offsets, "<i4").tobytes()
    files[_TABLE_FILES["rows"]] = np.ascontiguousarray(rows, "<i4").tobytes()
    pictures = [bytes(block.picture(view)) for view in range(len(block.looks))]
    files[_PICTURES] = b"".join(pictures)
    files[_NAMES] = "".join(json.dumps(name) + "\n" for name in block.names).encode()
    meta = {
        "rows": len(block),
        "views": len(block.looks),
        "table_bits": int(np.log2(offsets.shape[1] - 1)),
        "picture_bytes": [len(picture) for picture in pictures],
        "crc32": {file_name: zlib.crc32(data) for file_name, data in files.items()},
    }
    files["meta.json"] = json.dumps(meta, indent=1).encode()
    for file_name, data in files.items():
        write_durably(folder / file_name, data)
    sync_folder(folder)


def load_block(folder: Path) -> Block:
    """Open a folder that :func:`save_block` wrote.

    Raises
    ------
    IndexCorruptError
        When a file is missing, cut short, or fails its CRC.
    """
    try:
        meta = json.loads((folder / "meta.json").read_bytes())
        for file_name, expected in meta["crc32"].items():
            if zlib.crc32((folder / file_name).read_bytes()) != expected:
                raise IndexCorruptError(folder / file_name, "its CRC-32 does not fit")
        counts = {"row": int(meta["rows"]), "view": int(meta["views"])}
        columns = {
            field: _mapped(folder / name, dtype, (counts[per], width) if width else (counts[per],))
            for field, (name, dtype, width, per) in _LAYOUT.items()
            if field != "shapes" or name in meta["crc32"]
        }
        # A block that was written before shapes were kept has none.
        columns.setdefault("shapes", np.full((counts["view"], SHAPE_SIZE), np.nan, np.float32))
        size = 2 ** int(meta["table_bits"]) + 1
        offsets = _mapped(folder / _TABLE_FILES["offsets"], "<i4", (TABLES, size))
        rows = _mapped(folder / _TABLE_FILES["rows"], "<i4", (TABLES, counts["row"]))
        lines = (folder / _NAMES).read_text(encoding="utf-8").splitlines()
        names = tuple(ViewName(*json.loads(line)) for line in lines)
        pictures = _pictures(folder / _PICTURES, meta.get("picture_bytes", []))
    except (KeyError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise IndexCorruptError(folder / "meta.json", f"unreadable ({error})") from error
    if len(names) != counts["view"]:
        raise IndexCorruptError(folder / _NAMES, f"{len(names)} names for {counts['view']} views")
    return Block(**columns, names=names, tables=(offsets, rows), pictures=pictures)


def _pictures(path: Path, lengths: list[int]) -> tuple[memoryview, ...]:
    """Return views into a file of pictures one behind the other; nothing is read yet."""
    if not lengths:
        return ()
    ends = np.cumsum(lengths).tolist()
    data = _mapped(path, "u1", (ends[-1],)).data
    return tuple(data[end - n : end] for end, n in zip(ends, lengths, strict=True))


def _mapped(path: Path, dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    expected = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if path.stat().st_size != expected:
        raise IndexCorruptError(path, f"{path.stat().st_size} bytes, expected {expected}")
    if expected == 0:
        return np.empty(shape, dtype)
    # Copy-on-write, though nothing writes: kernels are compiled once, for writable arrays.
    return np.asarray(np.memmap(path, dtype, mode="c", shape=shape))


def write_durably(path: Path, data: bytes) -> None:
    """Write a file and wait until the disk has it."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
