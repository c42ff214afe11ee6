"""Arrangement of products on a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulate.robots import Workplace
from simulate.world.objects import ObjectSpec, write_assets
from simulate.world.world import World

__all__ = ["PlacedObject", "Placement", "arrange", "arrange_in_reach", "lay"]

_CLEAR_MIDDLE_M, _CLEAR_OUTSIDE_M = 0.010, 0.025
_CLEAR_EDGE_M = 0.010
_GROWTH_M = 0.015
_GAP_M = 0.022
_ROUNDS = 14
_TRIES = 400
_DRAWN = 150
"""Places drawn for each product; less than half are clear and need to be judged."""
_SETTLE_S = 0.5


@dataclass(frozen=True)
class Placement:
    """Place of one product: centre of its footprint (m) and yaw (rad), base frame."""

    spec: ObjectSpec
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class PlacedObject:
    """A product in a world, with its body."""

    placement: Placement
    body: int


_Place = tuple[Placement, NDArray[np.float64]]
"""A place with the outline of the footprint there."""


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


def arrange(
    specs: Sequence[ObjectSpec],
    rng: np.random.Generator,
    sides: Sequence[int] | None = None,
    workplace: Workplace | None = None,
) -> list[Placement]:
    """Find a place for every product, with room for a hand between them.

    If the table is crowded, the area is extended away from the robot, out of its reach.

    Parameters
    ----------
    specs
        The products.
    rng
        Source of randomness.
    sides
        For each product +1 = left (y > 0) or -1 = right; None = half of them on each side.
    workplace
        Area that the robot reaches; None selects that of the smallest robot.

    Raises
    ------
    ValueError
        If the table is too small for them.
    """
    place = workplace or Workplace()
    order = sorted(range(len(specs)), key=lambda i: -specs[i].footprint_radius)
    for grown in range(_ROUNDS):
        if sides is None:
            drawn = rng.permuted(np.resize([-1, 1], len(specs)))
        else:
            drawn = np.array([sides[i] for i in order])
        placed = _try_arrange([specs[i] for i in order], drawn, grown * _GROWTH_M, rng, place)
        if placed is not None:
            return placed
    raise ValueError(f"the table has no room for {len(specs)} objects; ask for fewer")


def arrange_in_reach(
    specs: Sequence[ObjectSpec],
    rng: np.random.Generator,
    is_in_reach: Callable[[Placement], bool],
    workplace: Workplace | None = None,
) -> list[Placement]:
    """Find a place in reach for every product, with room for a hand between them.

    Places are drawn for all products in turn until one for each of them fits beside the others. If
    the table is too crowded for that, those left over stand wherever there is room.

    Parameters
    ----------
    specs, rng, workplace
        As of :func:`arrange`.
    is_in_reach
        Judges the place of a product that stands alone on the table.

    Raises
    ------
    ValueError
        If the table is too small for them.
    """
    place = workplace or Workplace()
    sides = rng.permuted(np.resize([-1, 1], len(specs)))
    pools: dict[int, list[list[_Place]]] = {-1: [], 1: []}
    best: dict[int, list[_Place]] = {-1: [], 1: []}
    turns: list[tuple[ObjectSpec, int, int]] = []  # product, side, number of its pool there
    for spec, side in zip(specs, sides.tolist(), strict=True):
        turns.append((spec, side, len(pools[side])))
        pools[side].append([])
    for _ in range(_DRAWN):
        for spec, side, number in turns:
            drawn = _draw(spec, side, 0.0, rng, place)
            if drawn is None or len(best[side]) == len(pools[side]) or not is_in_reach(drawn[0]):
                continue
            pools[side][number].append(drawn)
            others = [pool for other, pool in enumerate(pools[side]) if other != number]
            best[side] = max(best[side], _largest_set([drawn], others), key=len)
        if all(len(best[side]) == len(pools[side]) for side in pools):
            break
    return _with_the_rest(specs, sides, [*best[-1], *best[1]], rng, place)


def _largest_set(chosen: list[_Place], pools: Sequence[list[_Place]]) -> list[_Place]:
    """Return the places chosen and as many more as fit beside them, at most one from each pool."""
    if not pools:
        return chosen
    largest = _largest_set(chosen, pools[1:])
    for place in pools[0]:
        if len(largest) == len(chosen) + len(pools):
            break
        if all(_gap(place[1], other) >= _GAP_M for _, other in chosen):
            largest = max(largest, _largest_set([*chosen, place], pools[1:]), key=len)
    return largest


def _with_the_rest(
    specs: Sequence[ObjectSpec],
    sides: NDArray[np.int64],
    chosen: Sequence[_Place],
    rng: np.random.Generator,
    place: Workplace,
) -> list[Placement]:
    """Return the chosen places, and any with room for the products that have none."""
    placed = [placement for placement, _ in chosen]
    done = {placement.spec.name for placement in placed}
    rest = [i for i, spec in enumerate(specs) if spec.name not in done]
    for grown in range(_ROUNDS):
        added = _try_arrange(
            [specs[i] for i in rest], sides[rest], grown * _GROWTH_M, rng, place,
            [outline for _, outline in chosen],
        )  # fmt: skip
        if added is not None:
            return [*placed, *added]
    return arrange(specs, rng, workplace=place)


def _draw(
    spec: ObjectSpec, side: int, grown_m: float, rng: np.random.Generator, place: Workplace
) -> _Place | None:
    """Draw a place with its outline; None if it is not clear."""
    x = float(rng.uniform(place.area_x[0], place.area_x[1] + grown_m))
    y = float(side * rng.uniform(*place.area_abs_y))
    yaw = float(rng.uniform(0, 2 * np.pi))
    outline = _outline(spec, x, y, yaw)
    return (Placement(spec, x, y, yaw), outline) if _is_clear(outline, side, place) else None


def _try_arrange(
    specs: Sequence[ObjectSpec],
    sides: NDArray[np.int64],
    grown_m: float,
    rng: np.random.Generator,
    place: Workplace,
    taken: Sequence[NDArray[np.float64]] = (),
) -> list[Placement] | None:
    """Place the products, largest first, at a distance from those placed before."""
    placed: list[Placement] = []
    outlines = list(taken)
    for spec, side in zip(specs, sides, strict=True):
        for _ in range(_TRIES):
            drawn = _draw(spec, int(side), grown_m, rng, place)
            if drawn is None:
                continue
            if all(_gap(drawn[1], other) >= _GAP_M for other in outlines):
                placed.append(drawn[0])
                outlines.append(drawn[1])
                break
        else:
            return None
    return placed


def _is_clear(outline: NDArray[np.float64], side: int, place: Workplace) -> bool:
    """Return whether a footprint stays on its side, on the table and out of the box."""
    across = outline[:, 1] * side
    return bool(
        across.min() > _CLEAR_MIDDLE_M
        and across.max() < place.area_abs_y[1] + _CLEAR_OUTSIDE_M
        and outline[:, 0].min() > place.table_near + _CLEAR_EDGE_M
    )


def _gap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.min(np.linalg.norm(a[:, None] - b[None], axis=-1)))


def lay(world: World, placements: Sequence[Placement], folder: Path) -> list[PlacedObject]:
    """Put the products on the world's table and let them settle; their files go to a folder."""
    laid = []
    for placement in placements:
        made = write_assets(placement.spec, folder)
        body = world.spawn(placement.spec, (placement.x, placement.y), placement.yaw, made)
        laid.append(PlacedObject(placement, body))
    world.step(_SETTLE_S)
    return laid
