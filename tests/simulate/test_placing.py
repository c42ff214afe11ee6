"""Places where a held thing may be let go, and the room that it takes on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simulate.grasping.executor import GraspRequest, PlannedGrasp, Workcell
from simulate.grasping.judgement import HeightMap
from simulate.grasping.placing import PlaceSpot
from simulate.world.hidden import NO_SECRET
from simulate.world.objects import product
from simulate.world.world import PlaceBox

_YAW, _OFF_M = 0.8, 0.045
BOX = PlaceBox("right", (0.40, 0.58), (-0.50, -0.30), 0.20, 0.23)


def seen(*things: tuple[float, float]) -> HeightMap:
    """Return the view of a box in which things of (place along x, height) m lie across it."""
    heights = np.zeros((30, 33))
    for x, height in things:
        start = round(x / 0.006)
        heights[start : start + 5, 5:28] = height
    return HeightMap(heights, np.array([0.40, -0.50]))


@pytest.mark.parametrize(
    ("view", "grounds"),
    [
        (None, (0.20,)),
        (seen(), (0.20,)),
        (seen((0.03, 0.04)), (0.24, 0.20)),
        (seen((0.03, 0.02), (0.09, 0.05)), (0.25, 0.20)),
        (seen((0.0, 0.03)), (0.23, 0.20)),
        (seen((0.03, 0.04), (0.09, 0.15)), (0.20,)),  # an arm is before it
    ],
)
def test_a_thing_is_let_go_over_what_lies_in_the_box(
    view: HeightMap | None, grounds: tuple[float, ...]
) -> None:
    spot = PlaceSpot.in_box(BOX, 0, 0.1, view)
    assert spot.grounds == pytest.approx(grounds)


@pytest.mark.slow
@pytest.mark.parametrize(("x", "y"), [(0.50, -0.15), (0.55, -0.10)])
def test_a_long_thing_held_by_its_end_clears_the_walls_of_the_box(x: float, y: float) -> None:
    # Not its middle is in the hand: the other end sticks out twice as far as from there.
    bar = replace(product("bar", 12), mass=0.2, secret=NO_SECRET)
    length, width, height = bar.extent
    with Workcell("panda", preset="fast") as cell:
        body = cell.world.spawn(bar, (x, y), _YAW)
        cell.world.step(0.2)
        request = GraspRequest(
            x=x + _OFF_M * np.cos(_YAW), y=y + _OFF_M * np.sin(_YAW),
            theta=_YAW + np.pi / 2, width=width, height=height, length=length,
            table_height=cell.world.table_height, only_theta=True,
            outline=(x, y, _YAW, length, width),
        )  # fmt: skip
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        box = cell.world.place_boxes["right"]
        record = cell.executor.execute(plan)
        assert (record.reason, record.place_reason) == ("ok", "ok")
        there = cell.world.object_pose(body)
        assert box.x_range[0] < there.x < box.x_range[1]
        assert box.y_range[0] < there.y < box.y_range[1]
