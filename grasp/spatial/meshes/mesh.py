"""Triangle meshes for grasp planning: cleaned, oriented outwards, with centre of mass.

Holes are allowed (lines only ask what they meet); what cannot be decided is said in the notes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.meshes.rays import Tree, build_tree, crossings

__all__ = ["Mesh", "as_mesh", "surfels"]


_SMALL_M, _LARGE_M = 0.005, 1.0
_MERGE = 1e-7
_FARTHEST_M = 1e9
_FLAT = 1e-12
_VOTES = 7
_SLITS = 0.005


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles in the frame of its object.

    Parameters
    ----------
    vertices : (v, 3), m
    faces : (f, 3)
        Counter-clockwise seen from outside.
    normals : (f, 3)
        Unit vectors out of the object.
    areas : (f,), m2
    com : (3,), m
        Centre of mass at uniform density.
    com_from
        ``volume`` of a closed surface, slits apart; else of its convex ``hull``; ``points`` when
        that is flat.
    watertight
        Whether every edge belongs to exactly two faces.
    notes
        What was done and what is odd, for people.

    Examples
    --------
    >>> corners = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)]
    >>> tetrahedron = as_mesh(corners, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    >>> tetrahedron.watertight, tetrahedron.com.round(3).tolist()
    (True, [0.025, 0.025, 0.025])
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    areas: FloatArray
    com: FloatArray
    com_from: Literal["volume", "hull", "points"] = "volume"
    watertight: bool = True
    notes: tuple[str, ...] = ()

    @cached_property
    def tree(self) -> Tree:
        """Hierarchy for lines through the mesh."""
        return build_tree(self.vertices, self.faces, self.normals)

    @cached_property
    def radius(self) -> float:
        """Largest distance of the surface from the centre of mass, m."""
        if len(self.vertices) == 0:
            return 0.0
        return float(np.linalg.norm(self.vertices - self.com, axis=1).max())

    @property
    def extent(self) -> FloatArray:
        """Size along the axes (3,), m."""
        if len(self.vertices) == 0:
            return np.zeros(3)
        return np.asarray(np.ptp(self.vertices, axis=0))

    def sample(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        """Draw points (count, 3) evenly from the surface, and their faces (count,)."""
        share = np.cumsum(self.areas)
        face = np.searchsorted(share, rng.random(count) * share[-1])
        face = np.minimum(face, len(self.faces) - 1)
        root, v = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        return (1 - root) * a + root * (1 - v) * b + root * v * c, face

    def moved(self, target_from_mesh: FloatArray) -> Mesh:
        """Return the mesh in another frame, given the transform (4, 4) into it."""
        r, t = target_from_mesh[:3, :3], target_from_mesh[:3, 3]
        return Mesh(
            self.vertices @ r.T + t, self.faces, self.normals @ r.T, self.areas,
            self.com @ r.T + t, self.com_from, self.watertight, self.notes,
        )  # fmt: skip


def as_mesh(
    vertices: ArrayLike,
    faces: ArrayLike,
    scale: float = 1.0,
) -> Mesh:
    """Clean a triangle mesh: merge vertices, drop what has no area, turn normals outwards.

    Parameters
    ----------
    vertices : (v, 3)
        In units of ``scale`` m; faces at vertices that are not finite are dropped.
    faces : (f, 3)
    scale
        Metres per unit of the vertices.

    Raises
    ------
    ValueError
        When shapes are wrong, a face names a vertex that does not exist, ``scale`` is not positive,
        or a vertex is more than a million km away. A mesh without a usable face is no error:
        nothing will be found on it.
    """
    v = np.asarray(vertices, dtype=np.float64)
    f = np.asarray(faces)
    v, f = v.reshape(-1, 3) if v.size == 0 else v, f.reshape(-1, 3) if f.size == 0 else f
    if v.ndim != 2 or v.shape[1] != 3 or f.ndim != 2 or f.shape[1] != 3:
        raise ValueError(
            f"a mesh has vertices (v, 3) and triangles (f, 3), got {v.shape} and {f.shape}"
        )
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"the scale of a mesh is a positive number of m per unit, got {scale}")
    if not (np.issubdtype(f.dtype, np.integer) or f.size == 0):
        raise ValueError(f"faces name vertices by whole numbers, got {f.dtype}")
    f = f.astype(np.int64)
    if f.size and (f.min() < 0 or f.max() >= len(v)):
        raise ValueError(f"faces name vertices 0 .. {len(v) - 1}, got {f.min()} .. {f.max()}")
    notes: list[str] = []
    finite = np.asarray(np.isfinite(v).all(axis=1))
    if not finite.all():
        notes.append(f"{int((~finite).sum())} vertices are not finite: dropped with their faces")
        f = f[finite[f].all(axis=1)]
        v = np.where(finite[:, None], v, 0.0)
    far = float(np.abs(v).max(initial=0.0)) * scale
    if far > _FARTHEST_M:
        raise ValueError(f"a vertex is {far:.3g} m away: is a scale of {scale:g} m per unit right?")
    v, f = _without_waste(v * scale, f, notes)
    normals, areas = _normals(v, f)
    open_share, directed = _edges(f)
    closed = open_share == 0
    if len(f):
        _check_size(float(np.ptp(v, axis=0).max()), scale, notes)
        volume = _volume(v, f)[0]
        if not (closed and directed and volume > 0):
            flips = _inside_out(v, f, normals, notes)
            f = np.where(flips[:, None], f[:, ::-1], f)
            normals = np.where(flips[:, None], -normals, normals)
    if not closed and len(f):
        notes.append("the surface is not closed")
    # A few slits between faces without area leave the volume what it is.
    com, com_from = _centre_of_mass(v, f, open_share < _SLITS)
    if com_from != "volume" and len(f):
        notes.append(f"centre of mass of the {'convex hull' if com_from == 'hull' else 'vertices'}")
    return Mesh(v, f, normals, areas, com, com_from, closed, tuple(notes))


def surfels(points: FloatArray, normals: FloatArray, size: float) -> Mesh:
    """Return a cloud as small squares, one for each point, so that lines can meet it.

    Parameters
    ----------
    points, normals : (n, 3)
        m; unit vectors out of the object.
    size
        Edge of a square, m: a little more than the points' distance closes the gaps.

    Returns
    -------
    Mesh
        Open; its centre of mass is that of the convex hull.
    """
    across = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    across *= size / 2 / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    up = np.cross(normals, across)
    corners = np.stack(
        [points - across - up, points + across - up, points + across + up, points - across + up],
        axis=1,
    )
    base = 4 * np.arange(len(points))[:, None]
    faces = np.vstack([base + np.array([0, 1, 2]), base + np.array([0, 2, 3])])
    vertices = corners.reshape(-1, 3)
    com, com_from = _centre_of_mass(points, np.empty((len(points), 3), np.int64), False)
    return Mesh(
        vertices, faces, np.vstack([normals, normals]), np.full(len(faces), size**2 / 2), com,
        com_from, False, (),
    )  # fmt: skip


def _without_waste(v: FloatArray, f: IntArray, notes: list[str]) -> tuple[FloatArray, IntArray]:
    """Merge equal vertices; drop faces without area, repeated faces and unused vertices."""
    if len(f) == 0:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    used = np.unique(f)
    size = float(np.ptp(v[used], axis=0).max()) or 1.0
    _, first, index = np.unique(
        np.round((v[used] - v[used].min(axis=0)) / (size * _MERGE)), axis=0, return_index=True,
        return_inverse=True,
    )  # fmt: skip
    number = np.zeros(len(v), np.int64)
    number[used] = index.ravel()
    v, f = v[used][first], number[f]
    _, areas = _normals(v, f)
    solid = areas > _FLAT * size**2
    _, unique = np.unique(np.sort(f, axis=1), axis=0, return_index=True)
    keep = np.zeros(len(f), bool)
    keep[unique] = True
    if not solid.all():
        notes.append(f"{int((~solid).sum())} faces without area: dropped")
    if not keep.all():
        notes.append(f"{int((~keep).sum())} faces twice: dropped")
    f = f[solid & keep]
    left, renumbered = np.unique(f, return_inverse=True)
    return v[left], renumbered.reshape(-1, 3).astype(np.int64)


def _normals(v: FloatArray, f: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (f, 3) and areas (f,)."""
    cross = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], length / 2


def _edges(f: IntArray) -> tuple[float, bool]:
    """Return the share of edges without exactly two faces, and whether no two run the same way."""
    if len(f) == 0:
        return 1.0, False
    ends = f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, counts = np.unique(np.sort(ends, axis=1), axis=0, return_counts=True)
    _, ways = np.unique(ends, axis=0, return_counts=True)
    return float((counts != 2).mean()), bool((ways == 1).all())


def _volume(v: FloatArray, f: IntArray) -> tuple[float, FloatArray]:
    """Return the signed volume of a closed surface, m3, and its centroid (3,)."""
    middle = v.mean(axis=0)
    a, b, c = (v[f[:, k]] - middle for k in range(3))
    parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    total = float(parts.sum())
    moment = (parts[:, None] * (a + b + c) / 4).sum(axis=0)
    return total, middle + moment / (total if total else 1.0)


def _centre_of_mass(
    v: FloatArray, f: IntArray, closed: bool
) -> tuple[FloatArray, Literal["volume", "hull", "points"]]:
    from scipy.spatial import ConvexHull, QhullError

    if len(v) == 0:
        return np.zeros(3), "points"
    box = float(np.prod(np.ptp(v, axis=0)))
    if closed:
        volume, centre = _volume(v, f)
        if volume > 1e-6 * box > 0:
            return centre, "volume"
    try:
        hull = ConvexHull(v)
    except (QhullError, ValueError):
        return v.mean(axis=0), "points"
    middle = v[hull.vertices].mean(axis=0)
    corners = v[hull.simplices] - middle
    parts = np.abs(np.linalg.det(corners)) / 6
    weighted = (parts[:, None] * corners.sum(axis=1) / 4).sum(axis=0)
    return middle + weighted / parts.sum(), "hull"


def _inside_out(
    v: FloatArray, f: IntArray, normals: FloatArray, notes: list[str]
) -> NDArray[np.bool_]:
    """Return which faces (f,) look inwards, by the parity of crossings on both sides.

    Seven lines in fixed directions pass each face's centre. In front of a face that looks outwards
    an even number of faces follows, behind it an odd one; holes make single lines lie, not most of
    them. Where the votes are even, as on open sheets, the side that sees more open space is front.
    """
    tree = build_tree(v, f, normals)
    rng = np.random.default_rng(0x0FACE)
    spread = rng.normal(size=(_VOTES, 3))
    spread /= np.linalg.norm(spread, axis=1, keepdims=True)
    reach = 2.0 * float(np.linalg.norm(np.ptp(v, axis=0))) + 1e-9
    own = 1e-7 * reach
    centres = v[f].mean(axis=1)
    votes, open_votes = np.zeros(len(f)), np.zeros(len(f))
    for direction in spread:
        sign = np.sign(normals @ direction)
        lines = np.broadcast_to(direction, centres.shape)
        at, _, counts = crossings(tree, centres, lines, -reach, reach)
        real = np.arange(at.shape[1]) < counts[:, None]
        ahead = ((at > own) & real).sum(axis=1)
        behind = ((at < -own) & real).sum(axis=1)
        front, back = np.where(sign > 0, ahead, behind), np.where(sign > 0, behind, ahead)
        votes += np.where((front % 2 == 0) & (back % 2 == 1), 1.0, 0.0)
        votes -= np.where((front % 2 == 1) & (back % 2 == 0), 1.0, 0.0)
        open_votes += (front == 0).astype(float) - (back == 0)
    decided = np.where(votes != 0, votes, open_votes)
    flips = np.asarray(decided < 0)
    if flips.any():
        notes.append(f"{int(flips.sum())} of {len(f)} faces looked inwards: turned")
    if (decided == 0).any():
        notes.append(f"{int((decided == 0).sum())} faces have no inside: left as they are")
    return flips


def _check_size(extent: float, scale: float, notes: list[str]) -> None:
    """Note a size that no hand takes, with the factor that would make it plausible."""
    if _SMALL_M <= extent <= _LARGE_M:
        return
    factor = next(
        (k for k in (1e-3, 0.01, 0.0254, 1e3, 100.0) if _SMALL_M <= extent * k <= _LARGE_M), None
    )
    hint = (
        "" if factor is None else f"; a scale of {scale * factor:g} m per unit would be plausible"
    )
    notes.append(f"the mesh is {extent:.3g} m large{hint}")
