"""Of postures that hold as well, the one whose whole motion is the fastest is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simulate.grasping.candidates import Candidate, groups_as_good
from simulate.grasping.hand_rules import rules_for
from simulate.grasping.planning import GraspPlanner
from simulate.grasping.rules import GraspRequest
from simulate.grasping.whole_motion import WholeMotion
from simulate.motion.arm_space import SPEED, ArmSpace
from simulate.motion.collision import Obstacle
from simulate.motion.trajectory import time_path
from simulate.robots import describe
from simulate.world.world import PlaceBox

PANDA = describe("panda")
HEIGHT = PANDA.workplace.table_height
BOXES = {side: PlaceBox.at(PANDA.workplace, side, HEIGHT) for side in ("left", "right")}
CAN = GraspRequest(
    0.45, -0.12, 0.0, width=0.05, length=0.05, height=0.09, table_height=HEIGHT, round=True
)


def box_for(side: int, y: float) -> PlaceBox:
    return BOXES["left" if (side or y) > 0 else "right"]


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    walls = [Obstacle.box("box", *wall) for box in BOXES.values() for wall in box.walls()]
    return GraspPlanner(ArmSpace(PANDA, walls), box_for=box_for)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.deep)])
def test_the_whole_motion_is_no_slower_than_that_of_the_first_free_posture(planner, seed):
    fastest = planner.plan(CAN, [], seed)
    planner.takes_shortest = False
    first = planner.plan(CAN, [], seed)
    planner.takes_shortest = True
    assert not isinstance(fastest, str)
    assert not isinstance(first, str)
    assert fastest.least_s < first.least_s - 0.5
    ways = (fastest.free, fastest.approach, fastest.lift)
    assert fastest.least_s > sum(way.duration for way in ways)
    for plan in (fastest, first):
        rotation, position = planner.space.chains[plan.arm].tool_poses(plan.posture[None])
        assert position[0, :2] == pytest.approx([CAN.x, CAN.y], abs=0.002)
        assert rotation[0, 2, 2] < -0.97


def test_no_motion_is_faster_than_its_bound(planner):
    (arm,) = PANDA.arms.values()
    chain, home = planner.space.chains[arm.name], np.array(arm.home)
    postures = home + np.random.default_rng(0).uniform(-0.4, 0.4, (5, chain.dof))
    bounds = WholeMotion(chain, home, None, postures).bounds(postures)
    for posture, bound in zip(postures, bounds, strict=True):
        way = time_path(np.stack([home, posture]), SPEED["free"] * chain.velocity)
        assert 0 < bound <= way.duration
    over = WholeMotion(chain, home, BOXES["right"], postures).bounds(postures)
    assert (over > bounds).all()


def test_only_postures_that_hold_as_well_are_in_one_group():
    rules = rules_for(next(iter(PANDA.arms.values())))
    base = Candidate(np.zeros(7), 1.0, 0.05, 0.0, 0.0, 0.0, 0, 0, 0)
    tilts = [0.0, 0.05, 0.10, 0.30, 0.35]
    candidates = [
        replace(base, posture=np.full(7, 0.5 * k), tilt=tilt) for k, tilt in enumerate(tilts)
    ]
    near = replace(base, posture=np.full(7, 0.05), tilt=0.2)

    def tilts_of(within: float, least: int) -> list[list[float]]:
        groups = groups_as_good([*candidates[::-1], near], CAN, rules, within, least)
        return [[candidate.tilt for candidate in group] for group in groups]

    assert tilts_of(0.21, 14) == [[0.0, 0.05, 0.10], [0.30, 0.35]]
    assert tilts_of(0.21, 3) == [[0.0, 0.05, 0.10]]
    assert tilts_of(0.0, 14) == [[0.0], [0.05], [0.10], [0.30], [0.35]]
