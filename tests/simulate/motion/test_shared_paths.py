"""Movements from the graph become paths: cut where the hand closes, with corners, mirrored."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.motion.kinematics import Chain
from simulate.motion.shared_paths import (
    corners_of,
    following_joints,
    mirror_signs,
    path_of,
    way_before_closing,
)
from simulate.robots import describe

ARM, HAND = ("a", "b"), "hand"


def recorded(openings, joints=("b", "hand", "a")):
    """Return a movement of which joint a goes up by .1 a sample, while b goes up and down."""
    count = len(openings)
    up = 0.1 * np.arange(count)
    peak = 0.3 - np.abs(up - 0.3)
    rows = np.stack([{"a": up, "b": peak, "hand": np.array(openings)}[n] for n in joints], axis=1)
    return {"attempt": "urn:attempt", "joints": list(joints), "positions": rows.ravel().tolist()}


def test_the_way_ends_where_the_hand_begins_to_close():
    motion = recorded([0.5, 0.8, 1.0, 1.0, 1.0, 0.9, 0.4, 0.0])
    way = way_before_closing(motion, ARM, HAND)
    assert way[:, 0] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert way[:, 1] == pytest.approx([0, 0.1, 0.2, 0.3, 0.2])
    assert len(way_before_closing(motion, ARM, "another hand")) == 8
    assert len(way_before_closing(motion, ("a", "c"), HAND)) == 0


def test_corners_are_all_that_the_samples_need():
    way = way_before_closing(recorded([1.0] * 7), ARM, HAND)
    assert corners_of(way) == pytest.approx(np.array([[0, 0], [0.3, 0.3], [0.6, 0]]))
    assert corners_of(way, tolerance=0.5) == pytest.approx(np.array([[0, 0], [0.6, 0]]))
    path = path_of(recorded([1.0] * 7), ARM, HAND)
    assert path is not None
    assert (path.name, len(path.corners)) == ("urn:attempt", 3)
    assert path_of(recorded([1.0] * 3), ARM, HAND) is None, "it is straight"


def test_the_other_arm_of_a_nao_mirrors_a_movement_and_a_panda_does_not():
    nao = describe("nao")
    left, right = Chain.of(nao, "left_arm"), Chain.of(nao, "right_arm")
    signs = mirror_signs(left, right)
    assert signs == (1, -1, -1, -1, -1)
    posture = 0.5 * (left.lower + left.upper)[None]
    _, there = left.tool_poses(posture)
    _, here = right.tool_poses(posture * np.array(signs))
    assert here == pytest.approx(there * [1, -1, 1])
    assert mirror_signs(left, Chain.of(describe("panda"), "panda_arm")) is None
    first = following_joints(right, left.names, signs)[1]
    assert (first["name"], first["recorded"], first["scale"]) == (
        "RShoulderRoll", "LShoulderRoll", -1,
    )  # fmt: skip
    assert (first["lower"], first["upper"]) == (right.lower[1], right.upper[1])
