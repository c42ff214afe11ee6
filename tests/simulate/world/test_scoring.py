"""Held and placed, on states made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from simulate.agent.scoring import AttemptTruth, ObjectState, held_reason, is_placed
from simulate.grasping.executor import GraspRequest, PlannedGrasp, Workcell
from simulate.world.objects import product
from simulate.world.world import PlaceBox

START = ObjectState(np.array([0.15, -0.1, 0.30]), links=3, force_n=8.0, on_table=True)
UP = ObjectState(np.array([0.15, -0.1, 0.35]), links=3, force_n=8.0)
BOX = PlaceBox("right", (0.08, 0.22), (-0.36, -0.22), 0.27, 0.30)


def at(state, z):
    return replace(state, position=np.array([0.15, -0.1, z]))


@pytest.mark.parametrize(
    ("lifted", "held", "reason"),
    [
        (UP, UP, "ok"),
        (at(UP, 0.3201), at(UP, 0.3201), "ok"),
        (at(UP, 0.3199), UP, "slip_lift"),
        (replace(UP, links=1), UP, "slip_lift"),
        (replace(UP, on_table=True), UP, "slip_lift"),
        (UP, at(UP, 0.31), "slip_hold"),
        (UP, replace(UP, links=1), "slip_hold"),
        (UP, replace(UP, on_table=True), "slip_hold"),
        (at(UP, np.nan), UP, "not_judged"),
        (UP, at(UP, 1e9), "not_judged"),
    ],
)
def test_held(lifted, held, reason):
    assert held_reason(START, lifted, held) == reason


@pytest.mark.parametrize(
    ("position", "placed"),
    [
        ((0.15, -0.29, 0.30), True),
        ((0.081, -0.221, 0.35), True),
        ((0.15, -0.29, 0.361), False),
        ((0.15, -0.21, 0.30), False),
        ((0.23, -0.29, 0.30), False),
        ((0.15, -0.29, 0.02), False),
    ],
)
def test_placed(position, placed):
    assert is_placed(ObjectState(np.array(position)), BOX) is placed


def test_what_stands_upright_on_something_in_the_box_is_in_it():
    standing = ObjectState(np.array([0.15, -0.29, 0.37]), bottom=0.32)
    assert is_placed(standing, BOX)
    assert not is_placed(replace(standing, bottom=0.361), BOX)
    assert not is_placed(replace(standing, position=np.array([0.23, -0.29, 0.37])), BOX)


def test_the_lowest_point_of_a_watched_thing_is_that_of_the_thing_as_it_lies() -> None:
    bar = product("bar", 96)
    with Workcell("panda", preset="fast") as cell:
        world = cell.world
        x = world.workplace.table_near + world.workplace.table_size[0] / 2
        world.put(world.spawn(bar, (x, -0.2)), (x, -0.2, 0.6), (0.0, 2**-0.5, 0.0, 2**-0.5))
        request = GraspRequest(x=x, y=-0.2, theta=0.0, table_height=0.6 - bar.extent[0] / 2)
        planned = SimpleNamespace(request=request, arm="panda_arm", tool_height=0.02)
        watch = AttemptTruth(world, cell.robot, cast(PlannedGrasp, planned))
        assert watch._states["start"].bottom == pytest.approx(0.6 - bar.extent[0] / 2, abs=1e-6)


def test_an_attempt_at_the_end_of_a_long_thing_is_one_at_that_thing() -> None:
    bar, short = product("bar", 96), product("box", 4)
    with Workcell("panda", preset="fast") as cell:
        world, robot = cell.world, cell.robot
        x = world.workplace.table_near + world.workplace.table_size[0] / 2
        long = world.spawn(bar, (x, -0.2))
        end = x + bar.extent[0] / 2
        other = world.spawn(short, (end + 0.01 + short.extent[0] / 2, -0.2))
        world.step(0.2)
        for at, target in ((end - 0.005, long), (end + 0.02, other), (x - 0.3, -1)):
            request = GraspRequest(x=at, y=-0.2, theta=0.0, table_height=world.table_height)
            planned = SimpleNamespace(request=request, arm="panda_arm", tool_height=0.02)
            assert AttemptTruth(world, robot, cast(PlannedGrasp, planned)).target == target
