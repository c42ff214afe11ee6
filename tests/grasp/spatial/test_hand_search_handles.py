"""Rows of grasps that agree, and what does not make a row."""

from __future__ import annotations

import numpy as np

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.hand_search.handles import find_handles


def along_y(places: list[float], tilt: float = 0.0, x: float = 0.0) -> list[GraspCandidate]:
    found = []
    for y in places:
        pose = np.eye(4)
        c, s = np.cos(tilt), np.sin(tilt)
        pose[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]]
        pose[:3, 3] = x, y, 0
        found.append(GraspCandidate(pose, 0.03))
    return found


def test_ten_in_a_row_are_a_handle_and_nine_are_not() -> None:
    row = list(np.linspace(0, 0.09, 10))
    (handle,) = find_handles(along_y(row))
    assert handle.members == tuple(range(10))
    assert np.isclose(handle.length, 0.09)
    assert 0.03 < handle.grasp.centre[1] < 0.06
    assert find_handles(along_y(row[:9])) == []
    assert find_handles([]) == []


def test_a_gap_ends_a_row_and_each_grasp_serves_once() -> None:
    parts = [*np.linspace(0, 0.05, 12), *np.linspace(0.08, 0.12, 10)]
    first, second = find_handles(along_y(parts))
    assert (len(first.members), len(second.members)) == (12, 10)
    assert not set(first.members) & set(second.members)


def test_neighbours_that_lean_or_lie_beside_are_no_members() -> None:
    row = along_y(list(np.linspace(0, 0.05, 12)))
    leaning = along_y(list(np.linspace(0, 0.05, 12)), tilt=0.4)
    beside = along_y(list(np.linspace(0, 0.05, 12)), x=0.012)
    found = find_handles([*row, *leaning, *beside])
    groups = [{member // 12 for member in handle.members} for handle in found]
    assert sorted(groups, key=min) == [{0}, {1}, {2}]
    close = along_y([0.01] * 12)
    assert find_handles(close) == []


def test_a_bar_is_a_handle() -> None:
    rng = np.random.default_rng(0)
    turn, along = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(-0.08, 0.08, 6000)
    bar = np.stack([0.012 * np.cos(turn), along, 0.012 * np.sin(turn)], axis=1)
    gripper = ParallelGripper("jaw", "jaw", 0.0, 0.08, finger_width=0.012, finger_length=0.06)
    found = propose_from_cloud(bar, gripper, samples=100)
    handle = find_handles(list(found))[0]
    assert abs(handle.axis[1]) > 0.95
    assert handle.length > 0.05
