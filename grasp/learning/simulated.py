"""A world of simulated objects to compare learners of grasping on, always the same for a seed.

Objects come in families of polygons; candidates are push grasps, their outcomes those of the
quasi-static simulation of a push with parallel jaws under lateral noise (Kehoe 2014, 3.8; after
Dogar and Srinivasa 2010). What a learner is told beforehand, the analytic quality, is the
conservative bound of Kehoe 2014, 3.4 on the object as perceived, well or poorly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.push.candidates import Grasps, needed_openings, sample_grasps
from grasp.push.mechanics.quasistatic import simulate
from grasp.push.polygon import Part, as_part
from grasp.push.push_plan import analyse_push_grasps

__all__ = ["GOOD", "POOR", "Perception", "Thing", "World", "WorldSettings", "make_world"]


_JAW = 0.35
_FRICTION = 0.7
_MOMENT_ARM = 0.4
_STEP = 0.008
_RAYS = 32
_RAY_NOISE = 0.02
FEATURES = 5


@dataclass(frozen=True)
class Perception:
    """Quality of the perception on which grasps are rated.

    Parameters
    ----------
    vertex_std, com_std
        Standard deviation of the perceived vertices and centre of mass, in the unit in which the
        vertices of a family lie 0.35 to 1 from its middle (before stretching).
    friction
        Assumed; the real coefficient is 0.7.
    """

    vertex_std: float
    com_std: float
    friction: float


GOOD = Perception(0.02, 0.04, 0.7)
POOR = Perception(0.10, 0.15, 0.35)


@dataclass(frozen=True)
class WorldSettings:
    """Parameters of the simulated world.

    Parameters
    ----------
    families, objects
        How many.
    seed
        Of everything random.
    runs
        Simulations a candidate, of which its chance of success is the share that closed.
    lateral_std
        Of the object's position across the push, part diameters.
    samples
        Perturbed parts a candidate's quality is counted from.
    """

    families: int = 12
    objects: int = 72
    seed: int = 0
    runs: int = 20
    lateral_std: float = 0.05
    samples: int = 100


@dataclass(frozen=True, eq=False)
class Thing:
    """One object and its candidate grasps. Lengths in diameters, centre of mass as origin.

    Parameters
    ----------
    family
        Which kind it is of.
    places : (n, 3)
        Where the jaw meets the outline; z = 0.
    directions : (n,), rad
        In which the jaw moves.
    chances : (n,)
        Share of simulated pushes that closed around the object.
    good, poor : (n,)
        Quality by geometry, 0..1, for the two perceptions.
    features : (n, 5)
        Measures of the poorly perceived part about each candidate, of order one: angle to the
        edge, offset of the centre of mass from the jaw's middle and its distance, opening, slope
        of the edge on the other side.
    extents : (32,)
        Radii of the view around the centre of mass, with noise.
    """

    family: int
    places: FloatArray
    directions: FloatArray
    chances: FloatArray
    good: FloatArray
    poor: FloatArray
    features: FloatArray
    extents: FloatArray

    def __len__(self) -> int:
        return len(self.directions)


@dataclass(frozen=True, eq=False)
class World:
    """Objects, and how they look in five numbers.

    Parameters
    ----------
    views : (objects, 5)
        Principal components of the extents, standardised.
    """

    settings: WorldSettings
    things: tuple[Thing, ...]
    views: FloatArray

    def families(self) -> NDArray[np.int64]:
        """Return the family of each object, (objects,)."""
        return np.array([item.family for item in self.things])


@lru_cache(maxsize=8)
def make_world(settings: WorldSettings | None = None) -> World:
    """Draw the objects and simulate every candidate.

    Notes
    -----
    Four seconds of one core for the 72 objects of the default settings; kept for the next call.
    """
    chosen = settings or WorldSettings()
    rng = np.random.default_rng(chosen.seed)
    outlines = [_family(rng) for _ in range(chosen.families)]
    objects = []
    for _ in range(chosen.objects):
        family = int(rng.integers(chosen.families))
        part = _distorted(outlines[family], 0.05, rng)
        objects.append(_simulated_object(family, part, chosen, rng))
    return World(chosen, tuple(objects), principal_views(objects))


def principal_views(objects: list[Thing]) -> FloatArray:
    """Return five standardised principal components of the extents, (objects, 5)."""
    rows = np.array([item.extents for item in objects])
    centred = rows - rows.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    axes = axes[:FEATURES]
    largest = np.argmax(np.abs(axes), axis=1)
    signs = np.sign(axes[np.arange(len(axes)), largest])
    scores = centred @ (axes * signs[:, None]).T
    scores = scores / np.maximum(scores.std(axis=0), 1e-12)
    return np.pad(scores, ((0, 0), (0, FEATURES - scores.shape[1])))


def _family(rng: np.random.Generator) -> FloatArray:
    """Return a polygon of 4 to 9 vertices around the origin, (n, 2)."""
    count = int(rng.integers(4, 10))
    while True:
        angles = np.sort(rng.uniform(0, 2 * np.pi, count))
        gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
        if gaps.max() <= 2.6:
            break
    radii = rng.uniform(0.35, 1.0, count)
    stretch = rng.uniform(1.0, 1.9)
    return np.column_stack([radii * np.cos(angles) * stretch, radii * np.sin(angles)])


def _distorted(outline: FloatArray, std: float, rng: np.random.Generator) -> Part:
    """Return a part with noise at its vertices; drawn again while the outline crosses itself."""
    while True:
        try:
            return as_part(outline + rng.normal(0, std, outline.shape))
        except ValueError:
            continue


def _simulated_object(
    family: int, part: Part, settings: WorldSettings, rng: np.random.Generator
) -> Thing:
    grasps = sample_grasps(part, density=2, angles=3)
    places = (grasps.contacts - part.com) / part.diameter
    chances = _chances(part, grasps, settings, rng)
    sharp, blurred = _perceived(part, GOOD, rng), _perceived(part, POOR, rng)
    return Thing(
        family,
        np.column_stack([places, np.zeros(len(places))]),
        np.arctan2(grasps.approaches[:, 1], grasps.approaches[:, 0]),
        chances,
        _quality(sharp, grasps, GOOD, settings),
        _quality(blurred, grasps, POOR, settings),
        _features(blurred, grasps),
        _extents(part) + rng.normal(0, _RAY_NOISE, _RAYS),
    )


def _perceived(part: Part, seen: Perception, rng: np.random.Generator) -> Part:
    """Return the part as it is seen, in its own unit."""
    outline = _distorted(part.vertices, seen.vertex_std, rng)
    return as_part(outline.vertices, part.com + rng.normal(0, seen.com_std, 2))


def _chances(
    part: Part, grasps: Grasps, settings: WorldSettings, rng: np.random.Generator
) -> FloatArray:
    """Return the share of simulated pushes that close, (g,)."""
    size = part.diameter / part.radius
    rows = np.repeat(grasps.rows(part), settings.runs, axis=0)
    offsets = rng.normal(0, settings.lateral_std * size, len(rows))
    rows[:, 0] += offsets * rows[:, 3]
    rows[:, 1] -= offsets * rows[:, 2]
    ring = (part.vertices - part.centroid) / part.radius
    codes = np.empty((len(rows), 1), np.int8)
    simulate(
        np.ascontiguousarray(ring[None, :, 0]), np.ascontiguousarray(ring[None, :, 1]),
        (part.com - part.centroid)[None] / part.radius, np.ones(1, np.bool_), rows, _JAW * size,
        _FRICTION, _MOMENT_ARM**2, size, _STEP * size, codes,
    )  # fmt: skip
    closed: FloatArray = (codes[:, 0] > 0).reshape(len(grasps), settings.runs).mean(axis=1)
    return closed


def _quality(part: Part, grasps: Grasps, seen: Perception, settings: WorldSettings) -> FloatArray:
    """Return the bound on closure of the candidates on the perceived part, (g,)."""
    return analyse_push_grasps(
        grasps, part.vertices, part.com, jaw_width=_JAW * part.diameter, friction=seen.friction,
        samples=settings.samples,
    ).quality  # fmt: skip


def _features(part: Part, grasps: Grasps) -> FloatArray:
    """Return measures of the candidates on the perceived part, (g, 5)."""
    jaw = _JAW * part.diameter
    along = grasps.approaches
    right = np.column_stack([along[:, 1], -along[:, 0]])
    middles = grasps.contacts + right * np.where(grasps.left, jaw / 2, -jaw / 2)[:, None]
    away = (part.com - middles) / part.diameter
    offset, depth = np.sum(away * right, axis=1), np.sum(away * along, axis=1)
    opening = needed_openings(part, grasps, jaw) / part.diameter
    slope = [_slope_behind(part, m, v) for m, v in zip(middles, along, strict=True)]
    return np.column_stack(
        [np.abs(grasps.angles) / 0.26, 5 * np.abs(offset), 3 * depth, 2 * opening, slope]
    )


def _slope_behind(part: Part, middle: FloatArray, along: FloatArray) -> float:
    """Return the sine between jaw and the last edge that a ray along the push crosses; 1 = none."""
    starts, ends = part.vertices - middle, np.roll(part.vertices, -1, axis=0) - middle
    across = np.array([-along[1], along[0]])
    s, e = starts @ across, ends @ across
    crossing = np.flatnonzero((s > 0) != (e > 0))
    if len(crossing) == 0:
        return 1.0
    share = s[crossing] / (s[crossing] - e[crossing])
    reach = starts[crossing] @ along * (1 - share) + ends[crossing] @ along * share
    edge = (ends - starts)[crossing[np.argmax(reach)]]
    return float(abs(edge @ along) / np.hypot(*edge))


def _extents(part: Part) -> FloatArray:
    """Return how far the outline reaches from the centre of mass in 32 directions, radii."""
    ring = part.vertices - part.com
    starts, ends = ring, np.roll(ring, -1, axis=0)
    reach = np.zeros(_RAYS)
    for k in range(_RAYS):
        turn = 2 * math.pi * k / _RAYS
        along, across = (
            np.array([math.cos(turn), math.sin(turn)]),
            np.array([-math.sin(turn), math.cos(turn)]),
        )
        s, e = starts @ across, ends @ across
        crossing = (s > 0) != (e > 0)
        share = s[crossing] / (s[crossing] - e[crossing])
        hits = starts[crossing] @ along * (1 - share) + ends[crossing] @ along * share
        reach[k] = hits.max(initial=0.0)
    return reach / part.radius
