"""Untextured shapes for training: seven families with random sizes.

They stand in for household objects; none is a copy of a test object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp.spatial.meshes.mesh import Mesh, as_mesh
from simulate.robots.description import Floats

__all__ = ["FAMILIES", "sample_shape"]
Ints = NDArray[np.int64]
Soup = tuple[Floats, Ints]

_AROUND = 32


def sample_shape(family: str, seed: int) -> Mesh:
    """Return a shape of one of :data:`FAMILIES`, resting on z = 0 with its middle on the z axis.

    Parameters
    ----------
    seed
        Of size, proportions, resting side and direction.

    Examples
    --------
    >>> mug = sample_shape("mug", 3)
    >>> round(float(mug.vertices[:, 2].min()), 6), bool(mug.extent.max() < 0.3)
    (0.0, True)
    """
    rng = np.random.default_rng([seed, FAMILIES.index(family)])
    vertices, faces = _MAKERS[family](rng)
    if family in ("box", "rod", "block") and rng.random() < 0.6:
        vertices = vertices[:, np.roll([0, 1, 2], rng.integers(1, 3))]
    turn = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    vertices = vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = (low + high) / 2
    return as_mesh(vertices - (middle[0], middle[1], low[2]), faces)


def _grid(points: Floats) -> Soup:
    """Return the triangles of a grid (rows, columns, 3)."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _joined(*parts: Soup) -> Soup:
    counts = np.cumsum([0, *(len(v) for v, _ in parts[:-1])])
    return (
        np.concatenate([v for v, _ in parts]),
        np.concatenate([f + n for (_, f), n in zip(parts, counts, strict=True)]),
    )


def _revolved(profile: Sequence[tuple[float, float]]) -> Soup:
    """Return a body of revolution about z; (radius, height) from the bottom's middle to the top's.

    A profile that comes back down inside makes a hollow body.
    """
    angle = np.linspace(0, 2 * np.pi, _AROUND + 1)
    rings = [
        np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(angle, z)], axis=1)
        for r, z in reversed(profile)
    ]
    return _grid(np.stack(rings))


def _box_of(low: ArrayLike, high: ArrayLike) -> Soup:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    first, last = np.asarray(low, float), np.asarray(high, float)
    return corners * (last - first) + first, np.array(faces)


def _along_x(soup: Soup) -> Soup:
    """Rotate a mesh from the z axis to the x axis."""
    return soup[0][:, [2, 1, 0]] * (1, 1, -1), soup[1]


def _box(rng: np.random.Generator) -> Soup:
    size = rng.uniform((0.015, 0.02, 0.02), (0.055, 0.1, 0.16))
    return _box_of((0, 0, 0), size)


def _can(rng: np.random.Generator) -> Soup:
    radius, height = rng.uniform((0.012, 0.02), (0.04, 0.16))
    top = radius * rng.uniform(0.6, 1.0)
    body = _revolved([(0, 0), (radius, 0), (top, height), (0, height)])
    return _along_x(body) if rng.random() < 0.3 else body


def _bottle(rng: np.random.Generator) -> Soup:
    radius, height = rng.uniform((0.018, 0.1), (0.04, 0.22))
    neck = radius * rng.uniform(0.3, 0.6)
    body, shoulder = rng.uniform(0.5, 0.65), rng.uniform(0.7, 0.8)
    outline = [(0, 0), (radius, 0), (radius, body * height), (neck, shoulder * height)]
    soup = _revolved([*outline, (neck, height), (0, height)])
    flat = rng.uniform(0.5, 1.0) if rng.random() < 0.5 else 1.0
    return soup[0] * (flat, 1, 1), soup[1]


def _fruit(rng: np.random.Generator) -> Soup:
    angle = np.linspace(0, np.pi, 16)
    pear = rng.uniform(0.0, 0.25)
    half = rng.uniform((0.012, 0.012, 0.012), (0.04, 0.045, 0.045))
    profile = [
        (float(np.sin(a) * (1 - pear * (1 - np.cos(a)) / 2)), float(1 - np.cos(a))) for a in angle
    ]
    soup = _revolved(profile)
    return soup[0] * half, soup[1]


def _mug(rng: np.random.Generator) -> Soup:
    radius, height = rng.uniform((0.025, 0.04), (0.045, 0.11))
    wall, flare = rng.uniform(0.002, 0.005), rng.uniform(0.7, 1.0)
    foot = radius * flare
    cup = _revolved(
        [
            (0, 0),
            (foot, 0),
            (radius, height),
            (radius - wall, height),
            (foot - wall, wall),
            (0, wall),
        ]
    )
    if rng.random() < 0.4:
        return cup
    # A handle: three bars beside the wall.
    thick, out = rng.uniform((0.006, 0.018), (0.012, 0.035))
    low, high = 0.25 * height, 0.8 * height
    inner = radius * 0.85
    bars = [
        _box_of((inner, -thick / 2, low), (radius + out, thick / 2, low + thick)),
        _box_of((inner, -thick / 2, high - thick), (radius + out, thick / 2, high)),
        _box_of((radius + out - thick, -thick / 2, low), (radius + out, thick / 2, high)),
    ]
    return _joined(cup, *bars)


def _rod(rng: np.random.Generator) -> Soup:
    radius, length = rng.uniform((0.006, 0.09), (0.016, 0.2))
    handle = _along_x(_revolved([(0, 0), (radius, 0), (radius, length), (0, length)]))
    if rng.random() < 0.5:
        return handle
    # A tool: a head across, or a thin blade on.
    head = rng.uniform((0.01, 0.02, 0.01), (0.02, 0.05, 0.02))
    if rng.random() < 0.5:
        end = _box_of((length - head[0], -head[1], -head[2]), (length + head[0], head[1], head[2]))
    else:
        end = _box_of(
            (length, -0.4 * radius, -0.4 * radius), (1.6 * length, 0.4 * radius, 0.4 * radius)
        )
    return _joined(handle, end)


def _block(rng: np.random.Generator) -> Soup:
    """Return an L, a T or a stair of two boxes."""
    a = rng.uniform((0.03, 0.015, 0.015), (0.11, 0.045, 0.05))
    b = rng.uniform((0.012, 0.015, 0.02), (0.04, 0.045, 0.09))
    at = rng.uniform(0, max(float(a[0] - b[0]), 0.0))
    side = (a[1] - b[1]) / 2
    upper = _box_of((at, side, a[2]), (at + b[0], side + b[1], a[2] + b[2]))
    return _joined(_box_of((0, 0, 0), a), upper)


_MAKERS: dict[str, Callable[[np.random.Generator], Soup]] = {
    "box": _box,
    "can": _can,
    "bottle": _bottle,
    "fruit": _fruit,
    "mug": _mug,
    "rod": _rod,
    "block": _block,
}

FAMILIES: tuple[str, ...] = tuple(_MAKERS)
"""Names of the families."""
