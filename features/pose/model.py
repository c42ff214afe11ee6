"""The stored model that a pose is estimated against: samples, their grid, and symmetries.

Made once for each object, from a mesh or from the oriented cloud that its views grew into.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import FloatArray, UInt8Array, pose_matrix
from features.pose.nearest import nearest_grid
from features.pose.symmetry import find_symmetries

__all__ = ["PoseModel", "build_pose_model", "sample_mesh"]

_SMALLEST_M, _LARGEST_M = 0.005, 3.0
_PAD = 0.35
_DIRECTIONS = 60
_OVERSAMPLED = 4


@dataclass(frozen=True, eq=False)
class PoseModel:
    """Surface of an object, in a frame whose origin is the middle of its box.

    Parameters
    ----------
    centre : (3,) float64, m, object frame
        Middle of the box.
    samples : (n, 6) float32, m
        Places (about the centre) and outward normals.
    grid : (a, b, c) int16
        Number of the sample nearest to each cell.
    corner : (3,) float64, m
        Of the grid, about the centre.
    cell_m
        Edge of a cell.
    diameter_m
        Diagonal of the box.
    symmetries : (k, 3, 3) float64
        Turns about the centre that leave the surface as it is; the first is the identity.
    symmetric_axes : (j, 3) float64
        Axes about which every turn does.
    colours : (n, 3) uint8 RGB or None
        Of the samples; they tell apart what shape cannot.
    """

    centre: NDArray[np.float64]
    samples: NDArray[np.float32]
    grid: NDArray[np.int16]
    corner: NDArray[np.float64]
    cell_m: float
    diameter_m: float
    symmetries: NDArray[np.float64]
    symmetric_axes: NDArray[np.float64]
    colours: NDArray[np.uint8] | None = None

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the places of the samples."""
        return cKDTree(self.samples[:, :3])

    @cached_property
    def spacing_m(self) -> float:
        """Typical distance of neighbouring samples."""
        places = self.samples[:, :3]
        nearest = cKDTree(places).query(places, k=2)[0][:, 1]
        # Of points strewn at random, the nearest is half the square root of the area of each away.
        return float(2 * nearest.mean())

    def camera_from_object(
        self, rotation: NDArray[np.float64], translation: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the pose (4, 4) of the object's own frame from that of the centred one."""
        return pose_matrix(rotation, translation - rotation @ self.centre)

    def to_bytes(self) -> bytes:
        """Return an ``.npz``."""
        buffer = io.BytesIO()
        arrays: dict[str, Any] = {
            "centre": self.centre,
            "samples": self.samples,
            "symmetries": self.symmetries,
            "symmetric_axes": self.symmetric_axes,
            "numbers": np.array([max(self.grid.shape), self.diameter_m]),
        }
        if self.colours is not None:
            arrays["colours"] = self.colours
        np.savez_compressed(buffer, **arrays)
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> PoseModel:
        """Read what :meth:`to_bytes` wrote; the grid is made again."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                cells, diameter = arrays["numbers"].tolist()
                samples = arrays["samples"].astype(np.float32)
                grid, corner, cell = nearest_grid(samples[:, :3], _PAD * diameter, int(cells))
                return cls(
                    arrays["centre"].astype(np.float64), samples, grid, corner, cell, diameter,
                    arrays["symmetries"].astype(np.float64),
                    arrays["symmetric_axes"].astype(np.float64).reshape(-1, 3),
                    arrays["colours"].astype(np.uint8) if "colours" in arrays else None,
                )  # fmt: skip
        except (zipfile.BadZipFile, KeyError, OSError, EOFError, ValueError) as error:
            raise ValueError(f"these bytes are no pose model: {error}") from error


def build_pose_model(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]] | None = None,
    normals: FloatArray | None = None,
    samples: int = 3000,
    grid: int = 56,
    noise_m: float = 0.0,
    colours: tuple[FloatArray, UInt8Array] | None = None,
) -> PoseModel:
    """Make the model of a mesh, or of an oriented cloud.

    Parameters
    ----------
    vertices : (v, 3) float, m, object frame
    faces : (f, 3) int or None
        Counter-clockwise from outside.
    normals : (v, 3) float or None
        Outward; needed without faces, and then the vertices are the surface.
    samples, grid
        Number of samples (at most 32,767) and of cells along the longest side.
    noise_m
        Error of the places: what is less apart does not break a symmetry.
    colours
        Places (m, 3), m, object frame, on the surface, and their colours (m, 3) RGB; a sample takes
        that of the nearest.

    Raises
    ------
    ValueError
        When there is no surface, a number is not finite, or the size is no object's.

    Examples
    --------
    >>> corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.1
    >>> sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    >>> len(build_pose_model(corners, faces, samples=2000).symmetries)
    24
    """
    vertices = np.asarray(vertices, np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 4:
        raise ValueError(f"vertices must have shape (v, 3) with v >= 4, got {vertices.shape}")
    if not np.isfinite(vertices).all():
        raise ValueError("vertices hold NaN or infinite coordinates")
    if not 1 <= samples <= np.iinfo(np.int16).max:
        raise ValueError(f"samples must lie in 1..{np.iinfo(np.int16).max}, got {samples}")
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    diameter = float(np.linalg.norm(high - low))
    if not _SMALLEST_M <= diameter <= _LARGEST_M:
        raise ValueError(f"mesh units? diameter is {diameter:.3g} m, expected 5 mm to 3 m")
    # No seed of a caller: the same surface gives the same model, in every process.
    rng = np.random.default_rng(0)
    if faces is not None and len(faces):
        if faces.shape[1:] != (3,) or faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError(f"faces must be (f, 3) numbers of the {len(vertices)} vertices")
        surface = sample_mesh(vertices, faces, _OVERSAMPLED * samples, rng)
    elif normals is not None and normals.shape == vertices.shape:
        if not np.isfinite(normals).all():
            raise ValueError("normals hold NaN or infinite coordinates")
        surface = np.hstack([vertices, np.asarray(normals, np.float64)])
    else:
        raise ValueError("give faces, or a normal for each vertex")
    centre = (low + high) / 2
    surface[:, :3] -= centre
    seen = _is_outside(surface)
    # Of an open or very thin surface hardly a sample is outermost: it is taken as it is.
    if np.count_nonzero(seen) > samples // 10:
        surface = surface[seen]
    order = rng.permutation(len(surface))
    chosen = surface[np.sort(order[:samples])].astype(np.float32)
    rest = surface[order[-800:], :3]
    cells, corner, cell = nearest_grid(chosen[:, :3], _PAD * diameter, grid)
    turns, axes = find_symmetries(chosen[:, :3], rest, diameter, noise_m)
    inks = None
    if colours is not None and len(colours[0]):
        _, nearest = cKDTree(np.asarray(colours[0]) - centre).query(chosen[:, :3])
        inks = np.ascontiguousarray(colours[1][nearest], dtype=np.uint8)
    return PoseModel(centre, chosen, cells, corner, cell, diameter, turns, axes, inks)


def sample_mesh(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]],
    count: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return places and normals (count, 6) spread over the faces by area."""
    corners = np.asarray(vertices, np.float64)[np.asarray(faces)]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    if not area.sum() > 0:
        raise ValueError("the mesh has no area: all faces are degenerate")
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    # Folding the far half of the parallelogram back makes places uniform in the triangle.
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    a, b, c = corners[chosen].transpose(1, 0, 2)
    return np.hstack([a + u * (b - a) + v * (c - a), cross[chosen] / area[chosen, None]])


def _is_outside(surface: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which samples (n, 6) can be seen from some direction: inner walls cannot."""
    places, normals = surface[:, :3], surface[:, 3:]
    a, b, c = np.ptp(places, axis=0).tolist()
    area = 2 * (a * b + b * c + c * a)
    cell = max(2.5 * float(np.sqrt(area / len(places))), 1e-4)
    # A Fibonacci lattice spreads directions evenly over the sphere, without clusters at the poles.
    k = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1 - 2 * k / _DIRECTIONS, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - height**2)
    seen = np.zeros(len(places), np.int64)
    for towards in np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1):
        across = np.cross(towards, [1.0, 0, 0] if abs(towards[0]) < 0.7 else [0, 1.0, 0])
        across /= np.linalg.norm(across)
        plane = np.stack([across, np.cross(towards, across)], axis=1)
        keys = np.floor((places @ plane) / cell).astype(np.int64)
        keys -= keys.min(axis=0)
        number = keys[:, 0] * (keys[:, 1].max() + 1) + keys[:, 1]
        nearness = places @ towards
        nearest = np.full(number.max() + 1, -np.inf)
        np.maximum.at(nearest, number, nearness)
        # A wall that faces the direction by 45 degrees is as deep within a cell as that is wide.
        seen += (nearness > nearest[number] - 1.2 * cell) & (normals @ towards > 0.5)
    # Once may be a gap between the samples of the wall in front.
    return seen > 1
