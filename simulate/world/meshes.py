"""Triangle meshes of products with a printed look, and their files (OBJ, MTL, PNG).

Surfaces share a few printed panels: a can shows its side panel three times around, a ball its
panel on six patches, a box the same print on opposite faces.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simulate.robots.description import Floats
from simulate.world.textures import Image, Look, paint_panel

__all__ = ["TexturedMesh", "build_mesh", "write_mesh"]

_COPIES = 3  # of the side panel around a lathed body
_COLUMNS = 12  # facets per copy: 36 around, 0.4 % off the true radius at most
_GRID = 10  # facets along an edge of a ball's patch
_GUTTER = 4  # px around each panel, repeated edge: no bleeding between panels


@dataclass
class TexturedMesh:
    """A mesh under construction; points in the body frame, m.

    Attributes
    ----------
    points, normals : lists of (n, 3) float
    uv : list of (n, 2) float
        Pixel positions in ``atlas``, origin at its upper left corner, v downwards.
    faces : list of (m, 3) int
        Counter-clockwise seen from outside.
    atlas : (h, w, 3) uint8 RGB
    """

    atlas: Image
    points: list[Floats] = field(default_factory=list)
    normals: list[Floats] = field(default_factory=list)
    uv: list[Floats] = field(default_factory=list)
    faces: list[NDArray[np.int64]] = field(default_factory=list)

    def add_grid(self, points: Floats, normals: Floats, uv: Floats) -> None:
        """Add a patch given on a grid (rows, columns, 3 | 3 | 2); rows go down the print."""
        rows, columns = points.shape[:2]
        base = sum(len(block) for block in self.points)
        index = base + np.arange(rows * columns).reshape(rows, columns)
        upper, lower = index[:-1], index[1:]
        corners = (upper[:, :-1], lower[:, :-1], lower[:, 1:], upper[:, 1:])
        a, b, c, d = (corner.ravel() for corner in corners)
        self.points.append(points.reshape(-1, 3))
        self.normals.append(normals.reshape(-1, 3))
        self.uv.append(uv.reshape(-1, 2))
        self.faces.append(np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


@dataclass(frozen=True)
class _Region:
    """Position of a panel in the atlas, px."""

    left: int
    top: int
    width: int
    height: int

    def at(self, across: Floats, down: Floats) -> Floats:
        """Return atlas pixels of positions in [0, 1] across and down the panel."""
        return np.stack([self.left + across * self.width, self.top + down * self.height], axis=-1)


def build_mesh(
    kind: str,
    extent: tuple[float, float, float],
    profile: Sequence[tuple[float, float]] | None,
    look: Look,
) -> TexturedMesh:
    """Build the printed mesh of a product.

    Parameters
    ----------
    kind
        Of :data:`simulate.world.objects.KINDS`.
    extent
        Size along x, y, z of the body frame, m.
    profile
        For bodies of revolution: (radius, height) from bottom to top, m.
    look
        Of the print.
    """
    if kind == "ball":
        return _ball(0.5 * extent[0], look)
    if kind == "box":
        return _box(np.array(extent), look)
    if profile is None:
        raise ValueError(f"a {kind} is a body of revolution and needs a profile")
    mesh = _revolved(np.array(profile), look)
    if kind == "pen":
        # The axis from z onto x: a turn about y by 90 degrees.
        mesh.points = [p[:, [2, 1, 0]] * (1, 1, -1) for p in mesh.points]
        mesh.normals = [n[:, [2, 1, 0]] * (1, 1, -1) for n in mesh.normals]
    return mesh


def write_mesh(mesh: TexturedMesh, folder: Path, name: str) -> None:
    """Write ``name.png``, ``name.mtl`` and, last, ``name.obj``, each atomically."""
    folder.mkdir(parents=True, exist_ok=True)
    height, width = mesh.atlas.shape[:2]
    uv = np.concatenate(mesh.uv) / (width, height)
    uv[:, 1] = 1.0 - uv[:, 1]  # OBJ counts v from the bottom
    corners = np.concatenate(mesh.faces) + 1
    lines = [f"mtllib {name}.mtl", f"o {name}", f"usemtl {name}"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in np.concatenate(mesh.points)]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in uv]
    lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in np.concatenate(mesh.normals)]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in corners]
    material = f"newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0.1 0.1 0.1\nmap_Kd {name}.png\n"
    ok, png = cv2.imencode(".png", mesh.atlas[..., ::-1])
    if not ok:
        raise ValueError(f"cannot encode a print of shape {mesh.atlas.shape}")
    _replace(folder / f"{name}.png", png.tobytes())
    _replace(folder / f"{name}.mtl", material.encode())
    _replace(folder / f"{name}.obj", ("\n".join(lines) + "\n").encode())


def _replace(path: Path, data: bytes) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_bytes(data)
    part.replace(path)


def _atlas(panels: Sequence[Image]) -> tuple[Image, list[_Region]]:
    """Lay panels side by side, each with its edge repeated around it."""
    height = max(panel.shape[0] for panel in panels) + 2 * _GUTTER
    blocks, regions, left = [], [], 0
    for panel in panels:
        rows, columns = panel.shape[:2]
        below = height - rows - _GUTTER
        blocks.append(
            cv2.copyMakeBorder(panel, _GUTTER, below, _GUTTER, _GUTTER, cv2.BORDER_REPLICATE)
        )
        regions.append(_Region(left + _GUTTER, _GUTTER, columns, rows))
        left += columns + 2 * _GUTTER
    atlas = np.concatenate(blocks, axis=1)
    # OpenGL renderers read rows of RGB in groups of four bytes.
    padded = cv2.copyMakeBorder(atlas, 0, -height % 4, 0, -left % 4, cv2.BORDER_REPLICATE)
    return np.asarray(padded, dtype=np.uint8), regions


def _revolved(profile: Floats, look: Look) -> TexturedMesh:
    """Return a body of revolution about z with lids."""
    radii, heights = profile.T
    steps = np.hypot(np.diff(radii), np.diff(heights))
    along = np.concatenate([[0.0], np.cumsum(steps)])
    side = paint_panel(look, "side", 2 * np.pi * float(radii.max()) / _COPIES, float(along[-1]))
    lids = [paint_panel(look, name, 2 * r, 2 * r) for name, r in _lids(radii)]
    atlas, (side_region, *lid_regions) = _atlas([side, *lids])
    mesh = TexturedMesh(atlas)
    for k in range(_COPIES):
        across = np.linspace(0, 1, _COLUMNS + 1)
        angle = 2 * np.pi * (k + across) / _COPIES
        for i in range(len(steps)):
            slope = np.array([heights[i + 1] - heights[i], radii[i] - radii[i + 1]]) / steps[i]
            # The print's upper edge is the body's upper end.
            rows = [(radii[j], heights[j], 1 - along[j] / along[-1]) for j in (i + 1, i)]
            points = np.stack([_ring(angle, r, h) for r, h, _ in rows])
            normals = np.stack([_ring(angle, slope[0], slope[1])] * 2)
            uv = np.stack([side_region.at(across, np.full_like(across, d)) for _, _, d in rows])
            mesh.add_grid(points, normals, uv)
    for sign, region, radius, height in zip(
        (1, -1), lid_regions, (radii[-1], radii[0]), (heights[-1], heights[0]), strict=True
    ):
        _add_lid(mesh, region, float(radius), float(height), sign)
    return mesh


def _lids(radii: Floats) -> list[tuple[str, float]]:
    return [("lid", float(radii[-1])), ("base", float(radii[0]))]


def _ring(angle: Floats, radius: float, height: float) -> Floats:
    return np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, height)], axis=-1
    )


def _add_lid(mesh: TexturedMesh, region: _Region, radius: float, height: float, sign: int) -> None:
    """Add a disc at ``height`` that faces up (``sign`` 1) or down (-1)."""
    angle = sign * np.linspace(0, 2 * np.pi, _COPIES * _COLUMNS + 1)
    points = np.stack([_ring(angle, 0.0, height), _ring(angle, radius, height)])
    normals = np.broadcast_to((0.0, 0.0, float(sign)), points.shape).copy()
    across = 0.5 + 0.5 * points[..., 0] / radius
    down = 0.5 - sign * 0.5 * points[..., 1] / radius
    mesh.add_grid(points, normals, region.at(across, down))


_FACES = (
    # name of the print, outward normal, direction of the print's right, of its up
    ("front", (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ("front", (-1, 0, 0), (0, -1, 0), (0, 0, 1)),
    ("flank", (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    ("flank", (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ("lid", (0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ("lid", (0, 0, -1), (0, 1, 0), (1, 0, 0)),
)


def _box(extent: Floats, look: Look) -> TexturedMesh:
    sizes = {}
    for name, _, right, up in _FACES:
        sizes[name] = float(extent @ np.abs(right)), float(extent @ np.abs(up))
    panels = [paint_panel(look, name, *size) for name, size in sizes.items()]
    atlas, regions_found = _atlas(panels)
    regions = dict(zip(sizes, regions_found, strict=True))
    mesh = TexturedMesh(atlas)
    across, down = np.meshgrid([0.0, 1.0], [0.0, 1.0])
    for name, normal, right, up in _FACES:
        unit = _patch(across, down, normal, right, up)
        normals = np.broadcast_to(np.array(normal, float), unit.shape).copy()
        mesh.add_grid(0.5 * extent * unit, normals, regions[name].at(across, down))
    return mesh


def _ball(radius: float, look: Look) -> TexturedMesh:
    """Return a sphere as six patches of a cube, all with the same print.

    Whichever way it has rolled, some patch lies within 55 degrees of the view.
    """
    panel = paint_panel(look, "patch", 0.5 * np.pi * radius, 0.5 * np.pi * radius)
    atlas, (region,) = _atlas([panel])
    mesh = TexturedMesh(atlas)
    across, down = np.meshgrid(np.linspace(0, 1, _GRID + 1), np.linspace(0, 1, _GRID + 1))
    # Equal angles, not equal lengths on the cube: the print is stretched less at the corners.
    bent = [0.5 + 0.5 * np.tan((t - 0.5) * np.pi / 2) for t in (across, down)]
    for _, normal, right, up in _FACES:
        cube = _patch(bent[0], bent[1], normal, right, up)
        unit = cube / np.linalg.norm(cube, axis=-1, keepdims=True)
        mesh.add_grid(radius * unit, unit, region.at(across, down))
    return mesh


def _patch(
    across: Floats,
    down: Floats,
    normal: tuple[int, int, int],
    right: tuple[int, int, int],
    up: tuple[int, int, int],
) -> Floats:
    """Return points of one face of the cube [-1, 1]^3 for positions on its print."""
    n, r, u = (np.array(axis, float) for axis in (normal, right, up))
    points: Floats = n + (2 * across[..., None] - 1) * r + (1 - 2 * down[..., None]) * u
    return points
