"""Very small clouds: which cells of an octree are occupied, one byte a node (Kammerl 2012).

Only the part within one frame of that method; colours are those of the leaves, in their order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.codec.container import (
    FLAG_COLOUR,
    KIND_OCTREE,
    SECTION_COLOURS,
    SECTION_OCTREE,
    Container,
    compress,
    expand,
    pack,
)
from features.codec.limits import CloudFormatError, Limits
from features.codec.quantised import (
    MORTON_BITS,
    cells_from_morton,
    checked_cloud,
    cloud_header,
    morton_code,
    read_lattice,
)
from features.codec.types import Cloud
from features.geometry import FloatArray, UInt8Array

__all__ = ["encode_octree", "read_octree"]


def encode_octree(
    points: FloatArray,
    colours: UInt8Array | None = None,
    voxel_m: float = 0.002,
    *,
    frame_id: str = "",
    stamp_s: float = 0.0,
) -> bytes:
    """Return the occupied voxels of a cloud as a container.

    Parameters
    ----------
    points : (n, 3) float, m
        Not finite points are dropped; several in one voxel become one, at its centre.
    colours : (n, 3) uint8 RGB, or None
        The mean of each voxel is kept.
    voxel_m
        Edge of a voxel; the error is at most half of it per axis.

    Raises
    ------
    ValueError
        Wrong shape or dtype, or an extent of more than 2^21 voxels.
    """
    cleaned, rgb = checked_cloud(points, colours, voxel_m)
    origin = cleaned.min(axis=0) if len(cleaned) else np.zeros(3)
    cells = np.floor((cleaned - origin) / voxel_m).astype(np.int64)
    if cells.size and cells.max() >= 2**MORTON_BITS:
        raise ValueError(
            f"the cloud spans {cells.max()} voxels of {voxel_m} m; use a larger voxel_m"
        )
    code, of = np.unique(morton_code(cells), return_inverse=True)
    levels = max(int(cells.max()).bit_length(), 1) if cells.size else 0
    header = cloud_header(len(code), voxel_m, origin, frame_id, stamp_s) | {"levels": levels}
    sections = {}
    if len(code):
        sections[SECTION_OCTREE] = compress(_occupancy(code, levels).tobytes())
        if rgb is not None:
            counts = np.bincount(of)
            mean = [np.bincount(of, rgb[:, channel]) / counts for channel in range(3)]
            sections[SECTION_COLOURS] = compress(
                np.diff(np.round(mean).astype(np.uint8), axis=1, prepend=np.uint8(0)).tobytes()
            )
    return pack(KIND_OCTREE, FLAG_COLOUR if SECTION_COLOURS in sections else 0, header, sections)


def _occupancy(code: NDArray[np.uint64], levels: int) -> NDArray[np.uint8]:
    """Return one byte for each inner node, breadth first; bit k = child k is occupied."""
    children = code
    by_level = []
    for _ in range(levels):
        parents, of = np.unique(children >> np.uint64(3), return_inverse=True)
        taken = np.zeros((len(parents), 8), np.uint8)
        taken[of, (children & np.uint64(7)).astype(np.int64)] = 1
        by_level.append(np.packbits(taken, axis=1, bitorder="little")[:, 0])
        children = parents
    return np.concatenate(by_level[::-1])


def read_octree(container: Container, limits: Limits) -> Cloud:
    """Return the voxel centres of a container.

    Raises
    ------
    CloudFormatError
        When header and sections do not make an octree.
    """
    lattice = read_lattice(container, limits)
    if lattice.count == 0:
        return lattice.cloud(np.zeros((0, 3)), None)
    levels = container.integer("levels")
    if not 1 <= levels <= MORTON_BITS:
        raise CloudFormatError(f"header: levels must lie in 1..{MORTON_BITS}, got {levels}")
    nodes = np.frombuffer(
        expand(container.section(SECTION_OCTREE, "octree"), "octree", limits), np.uint8
    )
    code = _leaves(nodes, levels, lattice.count)
    return lattice.cloud(cells_from_morton(code) + 0.5, lattice.colours(container, limits))


def _leaves(nodes: NDArray[np.uint8], levels: int, count: int) -> NDArray[np.uint64]:
    code = np.zeros(1, np.uint64)
    at = 0
    for _ in range(levels):
        here = nodes[at : at + len(code)]
        at += len(code)
        if len(here) < len(code) or not here.all():
            raise CloudFormatError("octree: cut off, or a node without children")
        parent, child = np.nonzero(np.unpackbits(here[:, None], axis=1, bitorder="little"))
        if len(parent) > count:
            raise CloudFormatError(f"octree: more than the {count} leaves that the header says")
        code = (code[parent] << np.uint64(3)) | child.astype(np.uint64)
    if len(code) != count or at != len(nodes):
        raise CloudFormatError(f"octree: {len(code)} leaves, the header says {count}")
    return code
