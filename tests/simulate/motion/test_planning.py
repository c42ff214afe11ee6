"""RRT-Connect on problems whose answer is known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from simulate.motion.rrt import PlanOptions, edge_is_free, plan_path

LOWER, UPPER = np.array([-2.0, -2.0]), np.array([2.0, 2.0])
START, GOAL = np.array([-1.0, 0.0]), np.array([1.0, 0.0])


def wall(q):
    """A wall at x = 0 with a gap above y = 1."""
    return ~((np.abs(q[:, 0]) < 0.15) & (q[:, 1] < 1.0))


def core_of_wall(q):
    """The wall less the planner's resolution on every side: edges are checked every .06."""
    return ~((np.abs(q[:, 0]) < 0.09) & (q[:, 1] < 0.94))


def everywhere(q):
    return np.ones(len(q), dtype=bool)


def solve(is_free, start=START, goal=GOAL, seed=0, **options):
    rng = np.random.default_rng(seed)
    return plan_path(start, goal, LOWER, UPPER, is_free, rng, PlanOptions(**options))


def test_free_space_is_crossed_straight():
    np.testing.assert_array_equal(solve(everywhere), [START, GOAL])


@pytest.mark.parametrize("seed", range(8))
def test_a_wall_is_gone_around(seed):
    path = solve(wall, seed=seed)
    assert not isinstance(path, str)
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    for a, b in itertools.pairwise(path):
        assert edge_is_free(a, b, core_of_wall, 0.01)
    assert path[:, 1].max() > 1.0


def test_shortcuts_shorten():
    def length(path):
        return np.linalg.norm(np.diff(path, axis=0), axis=1).sum()

    plain = np.mean([length(solve(wall, seed=s, shortcuts=0)) for s in range(8)])
    short = np.mean([length(solve(wall, seed=s)) for s in range(8)])
    assert short < 0.9 * plain
    assert short < 4.0  # straight over the gap's edge takes 2.9


@pytest.mark.parametrize(
    ("is_free", "reason"),
    [
        (lambda q: q[:, 0] > -0.9, "rrt_start"),
        (lambda q: q[:, 0] < 0.9, "rrt_goal"),
        (lambda q: np.abs(q[:, 0]) > 0.15, "rrt_time"),
    ],
)
def test_reasons_say_what_is_wrong(is_free, reason):
    assert solve(is_free, iterations=200) == reason


def test_same_seed_same_path():
    np.testing.assert_array_equal(solve(wall, seed=5), solve(wall, seed=5))
