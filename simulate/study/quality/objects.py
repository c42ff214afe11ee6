"""Objects of convex parts for the comparison of grasps: generated ones.

Ten families of generated objects imitate machined parts and what a household holds. Planner and
physics see the same parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from simulate.robots.description import Floats
from simulate.world.seeds import stream

__all__ = [
    "FAMILIES", "GraspObject", "centred", "cuboid", "fits", "frustum", "generated", "heaviest",
]  # fmt: skip

_AROUND = 16
_SHAPE = 21
_WEIGHT_SHARE = (0.1, 0.5)
_STROKE_M = 0.08


@dataclass(frozen=True, eq=False)
class GraspObject:
    """An object made of convex parts.

    Parameters
    ----------
    name
        Of the family and number, or of the model.
    parts
        Corners (n, 3) of each convex part, m; the origin is the centre of mass of their union.
    mass
        kg.
    """

    name: str
    parts: tuple[Floats, ...]
    mass: float

    def mesh(self) -> Mesh:
        """Return the parts' hulls as one mesh."""
        vertices, faces, start = [], [], 0
        for part in self.parts:
            hull = ConvexHull(part)
            vertices.append(part)
            outward = np.einsum(
                "ij,ij->i",
                np.cross(
                    part[hull.simplices[:, 1]] - part[hull.simplices[:, 0]],
                    part[hull.simplices[:, 2]] - part[hull.simplices[:, 0]],
                ),
                hull.equations[:, :3],
            )
            turned = np.where(outward[:, None] > 0, hull.simplices, hull.simplices[:, ::-1])
            faces.append(turned + start)
            start += len(part)
        return as_mesh(np.vstack(vertices), np.vstack(faces))

    def write(self, folder: Path) -> list[Path]:
        """Write each part as an OBJ file for the physics; return their paths."""
        return [
            _write_obj(folder / f"part-{k}.obj", part, ConvexHull(part).simplices)
            for k, part in enumerate(self.parts)
        ]

    def write_whole(self, folder: Path) -> Path:
        """Write the parts' hulls as one OBJ file for cameras; return its path."""
        mesh = self.mesh()
        return _write_obj(folder / "whole.obj", mesh.vertices, mesh.faces)

    def turned(self, rotation: Floats) -> GraspObject:
        """Return the object in another orientation (3, 3)."""
        return GraspObject(self.name, tuple(p @ rotation.T for p in self.parts), self.mass)


def _write_obj(path: Path, vertices: Floats, faces: NDArray[np.integer[Any]]) -> Path:
    """Write triangles (m, 3) between points (n, 3); return the path."""
    lines = ["v {:.7f} {:.7f} {:.7f}".format(*point) for point in vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in faces]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def centred(name: str, parts: Sequence[Floats], mass: float) -> GraspObject:
    """Return an object of convex parts, each (n, 3), m, about the centre of mass of their union."""
    raw = GraspObject(name, tuple(parts), mass)
    com = raw.mesh().com
    return GraspObject(name, tuple(part - com for part in parts), mass)


def generated(seed: int, number: int, gripper: ParallelGripper) -> GraspObject:
    """Return a generated object; families take turns.

    Parameters
    ----------
    gripper
        Lengths go with its stroke; the weight is 10 to 50 % of what its friction can hold.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> thing = generated(0, 1, panda_hand())
    >>> thing.name, len(thing.parts)
    ('prism-1', 1)
    """
    rng = stream(seed, _SHAPE, number)
    family = FAMILIES[number % len(FAMILIES)]
    scale = gripper.max_opening / _STROKE_M
    parts = [np.asarray(p, dtype=np.float64) * scale for p in _MAKERS[family](rng)]
    share = float(np.exp(rng.uniform(*np.log(_WEIGHT_SHARE))))
    mass = share * heaviest(gripper)
    sides = Rotation.from_euler("xyz", rng.integers(0, 4, 3) * 90, degrees=True)
    yaw = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    item = centred(f"{family}-{number}", parts, mass)
    return item.turned((yaw * sides).as_matrix())


def heaviest(gripper: ParallelGripper) -> float:
    """Return the mass, kg, whose weight a hand's friction just holds."""
    return 2 * gripper.friction * gripper.max_force / 9.81


def fits(item: GraspObject, gripper: ParallelGripper) -> bool:
    """Tell whether a hand may hold an object: narrow enough and at most half of what it bears."""
    narrowest = min(float(np.ptp(np.vstack(item.parts), axis=0)[k]) for k in range(3))
    light = item.mass <= _WEIGHT_SHARE[1] * heaviest(gripper)
    return light and narrowest < gripper.max_opening


def cuboid(low: ArrayLike, high: ArrayLike) -> Floats:
    """Return the corners (8, 3) of an upright box between two of them."""
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    first, last = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return np.asarray(first + corners * (last - first))


def frustum(bottom: float, top: float, low: float, high: float, around: int = _AROUND) -> Floats:
    """Return a frustum about z: radii and heights, m."""
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.vstack([np.c_[r * ring, np.full(around, z)]
                      for r, z in ((bottom, low), (top, high))])  # fmt: skip


def _box(rng: np.random.Generator) -> list[Floats]:
    return [cuboid((0, 0, 0), rng.uniform((0.015, 0.03, 0.03), (0.055, 0.09, 0.18)))]


def _prism(rng: np.random.Generator) -> list[Floats]:
    radius, height = rng.uniform((0.01, 0.02), (0.034, 0.16))
    return [frustum(radius, radius, 0, height, int(rng.choice([3, 5, 6, 24])))]


def _taper(rng: np.random.Generator) -> list[Floats]:
    radius, height = rng.uniform((0.015, 0.03), (0.036, 0.14))
    return [frustum(radius, radius * rng.uniform(0.5, 0.95), 0, height, 24)]


def _bracket(rng: np.random.Generator) -> list[Floats]:
    """Return an L, a T or a U."""
    thick, deep = rng.uniform((0.008, 0.015), (0.025, 0.05))
    length, height = rng.uniform((0.05, 0.03), (0.14, 0.09))
    parts = [cuboid((0, 0, 0), (length, deep, thick))]
    kind = rng.integers(3)
    places = [[0.0], [length / 2 - thick / 2], [0.0, length - thick]][kind]
    return parts + [cuboid((x, 0, thick), (x + thick, deep, height)) for x in places]


def _cross(rng: np.random.Generator) -> list[Floats]:
    arm, wide, deep = rng.uniform((0.06, 0.012, 0.015), (0.12, 0.03, 0.04))
    off = rng.uniform(-0.2, 0.2) * arm
    return [
        cuboid((-arm / 2, -wide / 2, 0), (arm / 2, wide / 2, deep)),
        cuboid((off - wide / 2, -arm / 2, 0), (off + wide / 2, arm / 2, deep)),
    ]


def _shaft(rng: np.random.Generator) -> list[Floats]:
    parts, z = [], 0.0
    for _ in range(int(rng.integers(2, 5))):
        radius, length = rng.uniform((0.007, 0.015), (0.03, 0.06))
        parts.append(frustum(radius, radius, z, z + length))
        z += length
    return parts


def _cup(rng: np.random.Generator) -> list[Floats]:
    radius, height, wall = rng.uniform((0.02, 0.03, 0.003), (0.045, 0.1, 0.006))
    foot = radius * rng.uniform(0.75, 1.0)
    angle = 2 * np.pi * np.arange(_AROUND + 1) / _AROUND
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    parts = [frustum(foot, foot, 0, wall)]
    for k in range(_AROUND):
        two = ring[k : k + 2]
        parts.append(np.vstack([
            np.c_[r * two, np.full(2, z)]
            for r, z in ((foot, 0), (foot - wall, 0), (radius, height), (radius - wall, height))
        ]))  # fmt: skip
    return parts


def _bottle(rng: np.random.Generator) -> list[Floats]:
    radius, height = rng.uniform((0.018, 0.09), (0.036, 0.2))
    neck, body, shoulder = radius * rng.uniform(0.3, 0.6), *rng.uniform((0.5, 0.7), (0.65, 0.8))
    levels = [(radius, 0), (radius, body), (neck, shoulder), (neck, 1)]
    flat = rng.uniform(0.55, 1.0)
    return [
        frustum(a, b, low * height, high * height) * (1, flat, 1)
        for (a, low), (b, high) in pairwise(levels)
    ]


def _ball(rng: np.random.Generator) -> list[Floats]:
    half = rng.uniform((0.014, 0.014, 0.014), (0.036, 0.04, 0.05))
    height = np.linspace(-1, 1, 11)[1:-1]
    rings = [frustum(float(np.sqrt(1 - z**2)), 1.0, z, z, 20)[:20] for z in height.tolist()]
    return [np.vstack([*rings, [[0, 0, -1]], [[0, 0, 1]]]) * half]


def _tool(rng: np.random.Generator) -> list[Floats]:
    """Return a handle with a head across its end, or with a blade."""
    radius, length = rng.uniform((0.006, 0.08), (0.015, 0.18))
    handle = frustum(radius, radius, 0, length)
    if rng.random() < 0.5:
        head = rng.uniform((0.01, 0.02, 0.008), (0.02, 0.05, 0.02))
        return [handle, cuboid((-head[0], -head[1], length), (head[0], head[1], length + head[2]))]
    blade = (0.9 * radius, 0.25 * radius)
    return [handle, cuboid((-blade[0], -blade[1], length), (*blade, 1.6 * length))]


_MAKERS: dict[str, Callable[[np.random.Generator], list[Floats]]] = {
    "box": _box,
    "prism": _prism,
    "taper": _taper,
    "bracket": _bracket,
    "cross": _cross,
    "shaft": _shaft,
    "cup": _cup,
    "bottle": _bottle,
    "ball": _ball,
    "tool": _tool,
}

FAMILIES: tuple[str, ...] = tuple(_MAKERS)
"""Names of the families, in turn."""
