"""Recalled paths are guesses: checked, mended where blocked, never those of another body."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from simulate.motion.arm_space import ArmSpace
from simulate.motion.remembered import (
    PathMemory,
    PathWork,
    RememberedPath,
    plan_with_memory,
)
from simulate.motion.rrt import PlanOptions, edge_is_free, plan_path
from simulate.robots import describe

LIMITS = (np.array([-2.0, -2.0]), np.array([2.0, 2.0]))
ENDS = (np.array([-1.0, 0.0]), np.array([1.0, 0.0]))
OVER_THE_WALL = np.array([[-0.3, 1.2], [0.3, 1.2]])


def wall(q):
    """A wall at x = 0 with a gap above y = 1."""
    return ~((np.abs(q[:, 0]) < 0.15) & (q[:, 1] < 1.0))


def two_walls(q):
    """A second wall, in the way of what leads over the first."""
    return wall(q) & ~((np.abs(q[:, 0] + 0.6) < 0.1) & (q[:, 1] > 0.3))


def closed(q):
    """A wall without a gap."""
    return ~(np.abs(q[:, 0]) < 0.15)


def plan(is_free, recalled, seed=0, options=None):
    work = PathWork()
    rng = np.random.default_rng(seed)
    return plan_with_memory(ENDS, LIMITS, is_free, rng, recalled, work, options), work


def assert_free(path, is_free):
    np.testing.assert_array_equal(path[[0, -1]], ENDS)
    resolution = PlanOptions().resolution
    assert all(edge_is_free(a, b, is_free, resolution) for a, b in itertools.pairwise(path))


def test_without_a_memory_the_path_is_the_planners_own():
    for seed in range(4):
        mine, work = plan(wall, [], seed)
        np.testing.assert_array_equal(
            mine, plan_path(*ENDS, *LIMITS, wall, np.random.default_rng(seed))
        )
        assert work.origins == {"planned": 1}


def test_a_path_that_still_holds_is_taken_for_less_work():
    unshortened = PlanOptions(shortcuts=0)
    recalled, work = plan(wall, [OVER_THE_WALL], options=unshortened)
    assert work.origins == {"recalled": 1}
    np.testing.assert_array_equal(recalled[1:-1], OVER_THE_WALL)
    _, anew = plan(wall, [], options=unshortened)
    assert work.of_first < anew.checks


@pytest.mark.parametrize("seed", range(4))
def test_a_path_that_something_blocks_is_mended_or_planned_anew(seed):
    path, work = plan(two_walls, [OVER_THE_WALL], seed)
    assert not isinstance(path, str)
    assert_free(path, two_walls)
    assert set(work.origins) <= {"mended", "planned"}


def test_a_blocked_piece_alone_is_planned_anew():
    """So narrow a gap that the ends hardly find it, and a piece outside of it that is blocked."""

    def narrow(q):
        gap = (q[:, 1] > 1.0) & (q[:, 1] < 1.1)
        return (~((np.abs(q[:, 0]) < 0.15) & ~gap)) & ~(
            (np.abs(q[:, 0] + 0.6) < 0.1) & (np.abs(q[:, 1] - 0.6) < 0.2)
        )

    guess = np.array([[-0.3, 1.05], [0.3, 1.05]])
    origins = set()
    for seed in range(6):
        path, work = plan(narrow, [guess], seed)
        assert not isinstance(path, str)
        assert_free(path, narrow)
        origins |= set(work.origins)
    assert "mended" in origins


def test_where_no_way_is_both_say_so():
    path, work = plan(closed, [OVER_THE_WALL], options=PlanOptions(iterations=40))
    assert path == "rrt_time"
    assert work.origins == {}


def test_paths_lead_both_ways_and_far_ends_are_no_guess():
    memory = PathMemory()
    kept = RememberedPath(np.stack([ENDS[0], *OVER_THE_WALL, ENDS[1]]))
    assert memory.add("one", kept)
    assert not memory.add("one", RememberedPath(kept.corners[::-1] + 0.01))
    assert not memory.add("one", RememberedPath(np.stack(ENDS)))
    np.testing.assert_array_equal(memory.nearest("one", *ENDS)[0], OVER_THE_WALL)
    np.testing.assert_array_equal(memory.nearest("one", *ENDS[::-1])[0], OVER_THE_WALL[::-1])
    assert memory.nearest("one", ENDS[0] + 5, ENDS[1]) == []


def test_a_path_of_one_body_is_not_offered_to_another():
    panda = describe("panda")
    arm = next(iter(panda.arms))
    joints = tuple(
        replace(joint, upper=joint.upper - 0.1)
        if joint.name == panda.arms[arm].joints[1]
        else joint
        for joint in panda.joints
    )
    mine, same, other = (
        ArmSpace(body).version(arm)
        for body in (panda, describe("panda"), replace(panda, joints=joints))
    )
    assert mine == same != other
    memory = PathMemory()
    memory.add(mine, RememberedPath(np.stack([ENDS[0], *OVER_THE_WALL, ENDS[1]])))
    assert memory.nearest(same, *ENDS)
    assert memory.nearest(other, *ENDS) == []
