"""Tables at which whole robots carry out tasks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rtask.errors import UsageError
from simulate.robots import describe
from simulate.tasks.arms.bench import Area, Layout, Post
from simulate.world.objects import ObjectSpec
from simulate.world.scene import Placement, arrange

__all__ = ["SORTING", "own_table", "place_things", "sorting_table"]


def own_table(robot: str, kind: str) -> Layout:
    """Return the table of one robot: a half for each of its sides, and a box beside each.

    An arm of one side gets to that half and its box; one in the middle, such as a Panda's, to all.
    """
    described = describe(kind)
    place = described.workplace
    areas = []
    for side, sign in (("left", 1), ("right", -1)):
        low, high = (sign * value for value in place.area_abs_y)
        (x, y), half = place.box_centre, place.box_inner / 2
        near, far = place.area_x
        margin = _HALF_MARGIN_M
        areas += [
            Area(f"{side} half", (near - margin, far + margin),
                 (min(low, high) - margin * (sign < 0), max(low, high) + margin * (sign > 0))),
            Area(f"{side} box", (x - half, x + half), (sign * y - half, sign * y + half), True),
        ]  # fmt: skip
    every = tuple(area.name for area in areas)
    reach = {
        name: tuple(n for n in every if arm.side == 0 or _SIDES[arm.side] in n)
        for name, arm in described.arms.items()
    }
    return Layout(place, tuple(areas), (Post(robot, kind, reach),))


_HALF_MARGIN_M = 0.025
_SIDES = {1: "left", -1: "right"}


def sorting_table() -> Layout:
    """Return a long table: a Panda in the middle of one side, a Nao at each end of the other.

    Each Nao has a box beside its inner hand, which no other hand gets to, and a part of the table
    that the Panda gets to, too: there things change hands.
    """
    nao = describe("nao").workplace
    table = replace(
        nao, table_size=(_DEPTH_M, 2 * _HALF_LENGTH_M, 0.02),
        eye=(0.75, -1.75, 1.0), target=(0.13, -0.05, 0.36),
    )  # fmt: skip
    near, far = nao.area_x
    low, high = _PART_M
    box_x, box_y = nao.box_centre
    half = nao.box_inner / 2
    areas, posts = [], []
    for side, sign in (("left", 1), ("right", -1)):
        seat = sign * _SEAT_M
        part = sorted((seat - sign * low, seat - sign * high))
        box = seat - sign * box_y
        areas += [
            Area(f"{side} part", (near + 0.01, far + 0.04), (part[0], part[1])),
            Area(f"{side} box", (box_x - half, box_x + half), (box - half, box + half), True),
        ]  # fmt: skip
        arm = "right_arm" if side == "left" else "left_arm"
        reach = {arm: (f"{side} part", f"{side} box")}
        posts.append(Post(f"nao-{1 + (sign < 0)}", "nao", reach, (0.0, seat)))
    middle = Area("middle", (0.15, 0.31), (-_MIDDLE_M, _MIDDLE_M))
    away, aside = _PANDA_X_M - sum(nao.area_x) / 2, _SEAT_M - (low + high) / 2
    panda = Post(
        "panda-1", "panda", {"panda_arm": ("middle", "left part", "right part")},
        (_PANDA_X_M, 0.0), is_opposite=True,
        cameras={"box_left": (away, aside), "box_right": (away, -aside)},
    )  # fmt: skip
    return Layout(table, (*areas, middle), (*posts, panda))


_PART_M = (0.06, 0.17)
"""Beside the middle of a Nao, where its hand and that of the Panda get to: nearer, the body of the
Nao is in the way of the Panda, and farther the wall of the box."""
_DEPTH_M, _HALF_LENGTH_M = 0.26, 0.95
_SEAT_M = 0.50
_PANDA_X_M = 0.63
_MIDDLE_M = 0.085

SORTING = "sorting"
"""Name of the long table of two Naos and a Panda."""


def place_things(
    layout: Layout, specs: list[ObjectSpec], rng: np.random.Generator
) -> list[Placement]:
    """Put things somewhere on the table, in areas in turn, with room for a hand between them.

    Raises
    ------
    UsageError
        There is no room for them.
    """
    if len(layout.posts) == 1 and layout.posts[0].at == (0.0, 0.0):
        try:
            return arrange(specs, rng, workplace=layout.table)
        except ValueError as error:
            raise UsageError(str(error)) from error
    for _ in range(_RESTARTS):
        placed = _placed_in_turn(layout, specs, rng)
        if placed is not None:
            return placed
    raise UsageError(f"the table has no room for {len(specs)} things; ask for fewer")


def _placed_in_turn(
    layout: Layout, specs: list[ObjectSpec], rng: np.random.Generator
) -> list[Placement] | None:
    """Return places one after another; None where the first ones leave no room for the last."""
    areas = [area for area in layout.areas if not area.is_box]
    placed: list[Placement] = []
    for number, spec in enumerate(specs):
        for _ in range(_TRIES):
            area = areas[(number + int(rng.integers(2))) % len(areas)]
            margin = spec.footprint_radius
            x = _drawn(rng, area.x, 0.4 * margin)
            y = _drawn(rng, area.y, margin)
            spot = Placement(spec, x, y, float(rng.uniform(0, np.pi)))
            if all(_apart(spot, other) for other in placed):
                placed.append(spot)
                break
        else:
            return None
    return placed


_TRIES = 300
_RESTARTS = 20
_GAP_M = 0.025


def _drawn(rng: np.random.Generator, ends: tuple[float, float], margin: float) -> float:
    low, high = ends[0] + margin, ends[1] - margin
    middle = (ends[0] + ends[1]) / 2
    return float(rng.uniform(min(low, middle), max(high, middle)))


def _apart(first: Placement, other: Placement) -> bool:
    away = float(np.hypot(first.x - other.x, first.y - other.y))
    return away > first.spec.footprint_radius + other.spec.footprint_radius + _GAP_M
