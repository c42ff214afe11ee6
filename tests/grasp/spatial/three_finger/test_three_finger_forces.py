"""Three coupled fingers push until two or three of them jam what is between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grasp.spatial.meshes.shapes import box_mesh, cup_mesh
from grasp.spatial.three_finger.closing import close
from grasp.spatial.three_finger.forces import Grip, asked_of_fingers, gripped
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand

HAND = ThreeFingerHand("centric", 0.1)
PLACES = 0.03 * WAYS[None, :, :2]
ALL, PAIR = np.ones((1, 3), bool), np.array([[False, True, True]])
SIDES = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
"""Normals of a bar: one finger on its end, two on opposite sides."""


def from_above(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, s, 0, x], [s, -c, 0, y], [0, 0, -1, z], [0, 0, 0, 1.0]])


def net_of(grip: Grip) -> tuple[np.ndarray, float, float]:
    """Return the sums of the forces (2,), of their moments, and of what the drive gives, N."""
    beside = np.stack([-grip.normals[..., 1], grip.normals[..., 0]], axis=-1)
    force = -grip.push[..., None] * grip.normals + grip.aside[..., None] * beside
    x, y = np.moveaxis(grip.places, -1, 0)
    moment = (x * force[..., 1] - y * force[..., 0]).sum()
    return force[0].sum(axis=0), float(moment), float(-(force * WAYS[None, :, :2]).sum())


@pytest.mark.parametrize(
    ("normals", "touching"), [(WAYS[None], ALL), (SIDES, ALL), (SIDES, PAIR)],
    ids=["round", "bar", "pair"],
)  # fmt: skip
def test_forces_balance_and_use_the_whole_drive(normals: np.ndarray, touching: np.ndarray) -> None:
    grip = gripped(HAND, PLACES, normals, touching)
    assert grip.holds[0]
    force, moment, drive = net_of(grip)
    assert force == pytest.approx((0.0, 0.0), abs=1e-6)
    assert moment == pytest.approx(0.0, abs=1e-6)
    assert drive == pytest.approx(3 * HAND.max_force)
    used = np.hypot(grip.aside, grip.spare)
    assert used == pytest.approx(HAND.friction * grip.push, abs=1e-6)


def test_fingers_share_the_drive_as_the_object_needs() -> None:
    equal = gripped(HAND, PLACES, WAYS[None], ALL)
    assert equal.push[0] == pytest.approx([20.0] * 3)
    pair = gripped(HAND, PLACES, SIDES, PAIR)
    assert pair.push[0] == pytest.approx([0.0, 34.64, 34.64], abs=0.01)
    # Side by side with the one on the end, nothing balances what a finger on one side does.
    assert not gripped(HAND, PLACES, SIDES, np.array([[True, True, False]])).holds[0]


def test_leaning_faces_use_friction_up() -> None:
    lean = np.deg2rad(20.0)
    tilted = WAYS * np.cos(lean) + np.array([0.0, 0.0, np.sin(lean)])
    grip = gripped(HAND, PLACES, tilted[None], ALL)
    assert grip.holds[0]
    assert (grip.spare < 0.7 * 10).all()
    steep = WAYS * np.cos(0.5) + np.array([0.0, 0.0, np.sin(0.5)])  # tan .5 > .5
    assert not gripped(HAND, PLACES, steep[None], ALL).holds[0]


def test_two_fingers_jam_a_bar_that_three_equal_forces_would_not_hold() -> None:
    """Two of three equal forces push 30 degrees beside the normals; tan 30 = .58 > .5."""
    bar = box_mesh((0.05, 0.05, 0.1))
    found = close(bar, HAND, np.stack([from_above(0.003, 0.005, 0.0), from_above(0, 0, 0, 0.1)]))
    assert found.holds.all()
    assert found.touching.sum(axis=1).tolist() == [2, 2]
    assert found.poses[0, 1, 3] == pytest.approx(0.0, abs=5e-4)  # centred between both sides
    assert np.abs(found.contacts[0, 1:, 1]) == pytest.approx([0.025, 0.025], abs=1e-4)


def test_what_slides_between_two_fingers_comes_to_the_third() -> None:
    can = cup_mesh(radius=0.03, height=0.1, wall=0.004)
    slippery = replace(HAND, friction=0.1)
    found = close(can, slippery, from_above(0.007, -0.004, 0.02)[None])
    assert found.touching.all()
    assert found.holds[0]
    assert found.poses[0, :3, 3] == pytest.approx((0.0, 0.0, 0.02), abs=1e-3)


def test_a_wedge_is_squeezed_out() -> None:
    """The sides of a wedge of 60 degrees push it out of two fingers, and away from the third."""
    found = gripped(
        HAND, PLACES,
        np.array([[[1.0, 0, 0], [0.5, 3**0.5 / 2, 0], [0.5, -(3**0.5) / 2, 0]]]), PAIR,
    )  # fmt: skip
    assert not found.holds[0]


def test_loads_in_all_directions_are_borne() -> None:
    grip = gripped(HAND, PLACES, WAYS[None], ALL)
    none = np.zeros((1, 3))

    def asked(force: tuple[float, ...], moment: tuple[float, ...]) -> float:
        return float(asked_of_fingers(HAND, grip, none + force, none + moment)[0])

    assert asked((0, 0, 30), (0, 0, 0)) == pytest.approx(1.0)  # 3 x .5 x 20 N
    assert asked((30, 0, 0), (0, 0, 0)) == pytest.approx(1.0)  # one finger and half of two others
    assert asked((0, 0, 0), (0, 0, 0.9)) == pytest.approx(1.0)  # 30 N at 30 mm
    assert asked((0, 0, 15), (0, 0, 0.45)) == pytest.approx(np.hypot(0.5, 0.5))
    # About a line across the axis at least 1.5 x 10 N at 30 mm, and what the pads' height adds.
    assert 0.5 < asked((0, 0, 0), (0.45, 0, 0)) < 1.0
    # The two fingers of a bar leave the moment about the line between them to their pads.
    pair = gripped(HAND, PLACES, SIDES, PAIR)
    about = asked_of_fingers(HAND, pair, none, np.array([[0.0, 0.1, 0.0]]))[0]
    across = asked_of_fingers(HAND, pair, none, np.array([[0.1, 0.0, 0.0]]))[0]
    assert about > 3 * across
