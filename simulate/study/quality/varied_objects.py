"""A wider family of generated objects: what is promised of grasps must hold on things of any shape.

The ten families of :mod:`simulate.study.quality.objects` are neat, as wide as the hand takes and
neither light nor heavy. Those here are not convex, thin-walled, have handles, legs, rims or teeth,
are much smaller than the hand or only just fit, long or flat, light or nearly as heavy as what the
hand's friction bears, and uneven.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats
from simulate.study.quality.objects import GraspObject, centred, cuboid, frustum, heaviest
from simulate.world.seeds import stream

__all__ = ["VARIED", "varied"]

_SHAPE = 22
_NARROWEST = (0.12, 0.95)
"""Of the object's least extent, over the hand's stroke."""
_WALLED = 2.5
"""How many times wider than that things with walls, rims or legs may be: these are held."""
_LONGEST = 4.0
"""Of the longest extent, over the hand's stroke."""
_DENSITIES, _SHARES = (60.0, 3000.0), (0.02, 0.9)
_LIGHTEST_KG = 0.006
"""What is lighter, the physics flings away."""
_LEAST_M = 0.0015
_FLATTEST = 0.7


def varied(seed: int, number: int, gripper: ParallelGripper) -> GraspObject:
    """Return an object of a wider family; kinds take turns.

    Parameters
    ----------
    gripper
        The object's least extent is 12 to 95 % of its stroke, the longest at most four strokes;
        half of the objects weigh 2 to 90 % of what its friction bears, half what a density from 60
        to 3,000 kg/m3 makes of them, at most 90 % as well; none less than 6 g.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> thing = varied(0, 1, panda_hand())
    >>> thing.name, len(thing.parts) > 1
    ('union-1', True)
    """
    rng = stream(seed, _SHAPE, number)
    kind = VARIED[number % len(VARIED)]
    shape = [np.asarray(part, dtype=np.float64) for part in _MAKERS[kind](rng)]
    shape = _uneven(shape, rng)
    extents = np.sort(np.ptp(np.vstack(shape), axis=0))
    least = float(np.exp(rng.uniform(*np.log(_NARROWEST)))) * gripper.max_opening
    if kind in _OF_WALLS:
        least *= rng.uniform(1.0, _WALLED)
    scale = min(least / extents[0], _LONGEST * gripper.max_opening / extents[2])
    parts = [_thick_enough(part * scale) for part in shape]
    most = heaviest(gripper)
    if rng.random() < 0.5:
        mass = float(np.exp(rng.uniform(*np.log(_SHARES)))) * most
    else:
        volume = sum(ConvexHull(part).volume for part in parts)
        density = float(np.exp(rng.uniform(*np.log(_DENSITIES))))
        mass = min(density * volume, _SHARES[1] * most)
    any_way = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    return centred(f"{kind}-{number}", parts, max(mass, _LIGHTEST_KG)).turned(any_way)


def _uneven(parts: Sequence[Floats], rng: np.random.Generator) -> list[Floats]:
    """Return parts stretched along their axes, and half of the objects with rough corners."""
    stretched = np.vstack(parts) * np.exp(rng.uniform(-0.35, 0.35, 3))
    if rng.random() < 0.5:
        size = float(np.ptp(stretched, axis=0).max())
        stretched = stretched + rng.normal(0, 0.004 * size, stretched.shape)
    ends = np.cumsum([len(part) for part in parts])[:-1]
    return list(np.split(stretched, ends))


def _thick_enough(part: Floats) -> Floats:
    """Return a part that is nowhere thinner than the physics bears, corners off its hull left out.

    A wall thinner than 1.5 mm is drawn out across its least axis.
    """
    middle = part.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov((part - middle).T))
    along = (part - middle) @ axes
    thin = np.maximum(_LEAST_M / np.maximum(np.ptp(along, axis=0), 1e-9), 1.0)
    grown = middle + (along * thin) @ axes.T
    return np.asarray(grown[ConvexHull(grown).vertices])


def _turned(rng: np.random.Generator, part: Floats, place: Floats) -> Floats:
    turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    return np.asarray(part @ turn.T + place)


def _ellipsoid(half: Floats) -> Floats:
    around = 2 * np.pi * np.arange(14) / 14
    rings = [
        np.c_[np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around),
              np.full(14, z)]
        for z in np.linspace(-0.92, 0.92, 7).tolist()
    ]  # fmt: skip
    return np.asarray(np.vstack([*rings, [[0, 0, -1]], [[0, 0, 1]]]) * half)


def _primitive(rng: np.random.Generator) -> Floats:
    size = rng.uniform(0.25, 1.0, 3)
    kind = rng.integers(4)
    if kind == 0:
        return cuboid(-size / 2, size / 2)
    if kind == 1:
        wide = float(size[0] / 2)
        return frustum(wide, wide * rng.uniform(0.2, 1.0), -size[2] / 2, size[2] / 2)
    if kind == 2:
        return _ellipsoid(size / 2)
    return np.asarray(rng.normal(size=(12, 3)) * size / 3)


def _stone(rng: np.random.Generator) -> list[Floats]:
    points = rng.normal(size=(int(rng.integers(8, 40)), 3))
    return [points / np.linalg.norm(points, axis=1)[:, None] * rng.uniform(0.3, 1.0, 3)]


def _union(rng: np.random.Generator) -> list[Floats]:
    parts = [_primitive(rng)]
    for _ in range(int(rng.integers(1, 5))):
        at = parts[int(rng.integers(len(parts)))]
        parts.append(_turned(rng, _primitive(rng), at[int(rng.integers(len(at)))] * 0.9))
    return parts


def _wedges(inner: Floats, outer: Floats, start: float = 0.0, turn: float = 2 * np.pi,
            count: int = 14) -> list[Floats]:  # fmt: skip
    """Return convex pieces of a body of revolution: profiles (2, 2) of radius and height."""
    angles = start + turn * np.arange(count + 1) / count
    rings = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [
        np.vstack([np.c_[r * rings[k : k + 2], np.full(2, z)] for r, z in (*inner, *outer)])
        for k in range(count)
    ]


def _dish(rng: np.random.Generator) -> list[Floats]:
    """Return a plate, a bowl or a lid."""
    height, wall = rng.uniform((0.1, 0.05), (0.9, 0.14))
    foot = rng.uniform(0.3, 0.9)
    rim = np.array([[foot, 0.0], [1.0, height]])
    parts = _wedges(rim, rim - (wall, 0))
    return [*parts, frustum(foot, foot, 0, wall)]


def _ring(rng: np.random.Generator) -> list[Floats]:
    """Return a ring, a tube or a piece of one, such as a hook."""
    inside, height = rng.uniform((0.5, 0.1), (0.85, 1.2))
    turn = 2 * np.pi if rng.random() < 0.5 else float(rng.uniform(2.0, 5.0))
    low, high = np.array([[1.0, 0.0], [1.0, height]]), np.array([[inside, 0.0], [inside, height]])
    return _wedges(high, low, 0.0, turn)


def _tray(rng: np.random.Generator) -> list[Floats]:
    """Return a box without a lid, or a frame without a bottom."""
    x, y, z, wall = rng.uniform((0.5, 0.5, 0.1, 0.03), (1.0, 1.0, 0.7, 0.1))
    sides = [
        cuboid((0, 0, 0), (x, wall, z)), cuboid((0, y - wall, 0), (x, y, z)),
        cuboid((0, 0, 0), (wall, y, z)), cuboid((x - wall, 0, 0), (x, y, z)),
    ]  # fmt: skip
    return sides + ([cuboid((0, 0, 0), (x, y, wall))] if rng.random() < 0.6 else [])


def _mug(rng: np.random.Generator) -> list[Floats]:
    radius, wall, height = rng.uniform((0.35, 0.03, 0.6), (0.5, 0.07, 1.2))
    inner = np.array([[radius - wall, 0.0], [radius - wall, height]])
    body = [*_wedges(inner, inner + np.array([wall, 0.0])), frustum(radius, radius, 0, wall)]
    bow, thick = rng.uniform((0.2, 0.04), (0.35, 0.09))
    loop = _wedges(np.array([[bow - thick, -thick], [bow - thick, thick]]),
                   np.array([[bow, -thick], [bow, thick]]), -np.pi / 2, np.pi, 7)  # fmt: skip
    upright = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    place = np.array([radius - wall / 2, 0.0, height / 2])
    return body + [part @ upright.T + place for part in loop]


def _figure(rng: np.random.Generator) -> list[Floats]:
    """Return a body with legs and a head, such as a toy animal's."""
    body = rng.uniform((0.3, 0.12, 0.12), (0.5, 0.25, 0.25))
    leg, long = rng.uniform((0.04, 0.2), (0.09, 0.5))
    parts = [_ellipsoid(body)]
    for x in (-0.6, 0.6):
        post = frustum(leg, leg, -body[2] * 0.7 - long, 0, 8)
        parts += [post + np.array([x * body[0], y * body[1], 0.0]) for y in (-0.6, 0.6)]
    head = rng.uniform(0.5, 1.0) * body[1:].min()
    return [*parts, _ellipsoid(np.full(3, head)) + np.array([body[0], 0.0, body[2]])]


def _rod(rng: np.random.Generator) -> list[Floats]:
    """Return a spoon, a key, a screw or a hammer: long, with something at its end."""
    thick, flat = rng.uniform((0.03, 0.3), (0.09, 1.0))
    parts = [frustum(thick, thick * rng.uniform(0.5, 1.0), -0.7, 0.3, 10) * (1, flat, 1)]
    end = _primitive(rng) * rng.uniform(0.15, 0.45) * (1, rng.uniform(0.15, 1.0), 1)
    return [*parts, end + np.array([0.0, 0.0, 0.3])]


def _plate(rng: np.random.Generator) -> list[Floats]:
    """Return flat pieces in one plane: a bracket, a card, a tool cut from sheet."""
    thick = rng.uniform(0.03, 0.12)
    parts = []
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform(0.15, 1.0, 2)
        turn = Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
        place = np.array([*rng.uniform(-0.25, 0.25, 2), 0.0])
        low, high = np.array([*-size / 2, 0.0]), np.array([*size / 2, thick])
        parts.append(cuboid(low, high) @ turn.T + place)
    return parts


def _star(rng: np.random.Generator) -> list[Floats]:
    """Return a gear or a star: teeth around a hub."""
    teeth, hub, deep = int(rng.integers(3, 11)), rng.uniform(0.3, 0.75), rng.uniform(0.1, 0.7)
    wide = np.pi * hub / teeth * rng.uniform(0.4, 0.9)
    tooth = np.array([
        [x, s * (wide if x < 1 else wide * 0.7), z] for x in (hub * 0.5, 1.0)
        for s in (-1, 1) for z in (0.0, deep)
    ])  # fmt: skip
    turns = [Rotation.from_euler("z", 2 * np.pi * k / teeth).as_matrix() for k in range(teeth)]
    return [frustum(hub, hub, 0, deep, 20), *(tooth @ turn.T for turn in turns)]


def _stool(rng: np.random.Generator) -> list[Floats]:
    """Return a seat on legs, with or without a back."""
    x, y, z = rng.uniform((0.4, 0.4, 0.3), (1.0, 1.0, 0.9))
    board, leg = rng.uniform((0.05, 0.05), (0.15, 0.12))
    parts = [cuboid((0, 0, z), (x, y, z + board))]
    parts += [cuboid((a, b, 0), (a + leg, b + leg, z)) for a in (0, x - leg) for b in (0, y - leg)]
    if rng.random() < 0.5:
        parts.append(cuboid((0, 0, z), (x, board, z + rng.uniform(0.3, 0.8))))
    return parts


_MAKERS: dict[str, Callable[[np.random.Generator], list[Floats]]] = {
    "stone": _stone,
    "union": _union,
    "dish": _dish,
    "rod": _rod,
    "ring": _ring,
    "mug": _mug,
    "figure": _figure,
    "tray": _tray,
    "plate": _plate,
    "star": _star,
    "stool": _stool,
}

_OF_WALLS = frozenset({"dish", "ring", "mug", "tray", "stool"})

VARIED: tuple[str, ...] = tuple(_MAKERS)
"""Names of the kinds, in turn."""
