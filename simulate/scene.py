"""A table laid with products: where each robot's objects stand at the start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulate.objects import Assets, ObjectSpec, write_assets
from simulate.world import World

__all__ = ["Laid", "Placement", "arrange", "lay"]

# The reach of both arms with some margin, so that a table may hold an object that nobody reaches.
_AREA_X = (0.125, 0.175)
_AREA_ABS_Y = (0.035, 0.175)
_GAP_M = 0.022
_TRIES = 4000
_SETTLE_S = 0.5


@dataclass(frozen=True)
class Placement:
    """Where one product stands: centre of its footprint (m) and yaw (rad), base frame."""

    spec: ObjectSpec
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Laid:
    """A product that stands in a world."""

    placement: Placement
    body: int


def _outline(spec: ObjectSpec, x: float, y: float, yaw: float) -> NDArray[np.float64]:
    """Return points (n, 2) along the footprint, m, dense enough to measure gaps with."""
    half_x, half_y = spec.extent[0] / 2, spec.extent[1] / 2
    along = np.linspace(-1, 1, 9)
    square = np.concatenate(
        [np.stack([along, s * np.ones_like(along)], 1) for s in (-1, 1)]
        + [np.stack([s * np.ones_like(along), along], 1) for s in (-1, 1)]
    ) * [half_x, half_y]
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(square @ np.array([[c, s], [-s, c]]) + [x, y])


def arrange(specs: Sequence[ObjectSpec], rng: np.random.Generator) -> list[Placement]:
    """Find a place for every product, half of them on each side, with room for a hand between.

    Raises
    ------
    ValueError
        When the table is too small for them.
    """
    for _ in range(20):
        found = _try_arrange(specs, rng)
        if found is not None:
            return found
    raise ValueError(f"the table has no room for {len(specs)} objects; ask for fewer")


def _try_arrange(specs: Sequence[ObjectSpec], rng: np.random.Generator) -> list[Placement] | None:
    placed: list[Placement] = []
    outlines: list[NDArray[np.float64]] = []
    order = sorted(range(len(specs)), key=lambda i: -specs[i].footprint_radius)
    sides = {index: -1 if rank % 2 == 0 else 1 for rank, index in enumerate(order)}
    for index in order:
        spec = specs[index]
        for _ in range(_TRIES):
            x = float(rng.uniform(*_AREA_X))
            y = sides[index] * float(rng.uniform(*_AREA_ABS_Y))
            yaw = float(rng.uniform(0, 2 * np.pi))
            outline = _outline(spec, x, y, yaw)
            if np.any(outline[:, 1] * sides[index] < 0.01) or np.any(outline[:, 0] < 0.10):
                continue
            if all(_gap(outline, other) >= _GAP_M for other in outlines):
                placed.append(Placement(spec, x, y, yaw))
                outlines.append(outline)
                break
        else:
            return None
    return placed


def _gap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.min(np.linalg.norm(a[:, None] - b[None], axis=-1)))


def lay(
    world: World,
    placements: Sequence[Placement],
    folder: Path,
    assets: Mapping[str, Assets] | None = None,
) -> list[Laid]:
    """Put the products on the world's table and let them settle."""
    laid = []
    for placement in placements:
        made = (assets or {}).get(placement.spec.name) or write_assets(placement.spec, folder)
        body = world.spawn(placement.spec, (placement.x, placement.y), placement.yaw, made)
        laid.append(Laid(placement, body))
    world.step(_SETTLE_S)
    return laid
