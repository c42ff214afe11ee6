"""Turns of a held object in the hand, as they are seen."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.motion.load import Load
from simulate.robots.description import Floats

_SIZE = np.array([0.12, 0.026, 0.030])
_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
"""``base_from_tool`` of a hand above the origin that points down and closes along x."""
_GAP = 0.026


def bar(held_at: float = 0.0) -> Load:
    """Return a bar along y of the base, held that far (m) from its middle."""
    base_from_load = np.eye(4)
    base_from_load[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    base_from_load[1, 3] = held_at
    return Load.of(_DOWN, base_from_load, _SIZE)


def seen_from_one_side(load: Load, rng: np.random.Generator, count: int = 400) -> Floats:
    """Return points (n, 3), tool frame, on the sides that a camera before the hand sees."""
    local = (rng.random((count, 3)) - 0.5) * _SIZE
    local[: count // 2, 0] = _SIZE[0] / 2
    local[count // 2 :, 2] = _SIZE[2] / 2
    local += rng.normal(0.0, 0.001, local.shape)
    rotation, origin = load.tool_from_load[:3, :3], load.tool_from_load[:3, 3]
    return np.asarray(local @ rotation.T + origin)


@pytest.mark.parametrize("angle_deg", [-90, -50, 0, 35, 90])
def test_no_end_hangs_lower_than_the_load_reaches(angle_deg: int) -> None:
    load = bar(0.03)
    assert load.reach == pytest.approx(np.hypot(0.06 + 0.03, 0.015), abs=1e-6)
    assert load.turned(np.radians(angle_deg)).bottom(_DOWN) >= -load.reach
    lowest = min(load.turned(float(a)).bottom(_DOWN) for a in np.radians(np.arange(-90, 91)))
    assert lowest == pytest.approx(-load.reach, abs=1e-3)


@pytest.mark.parametrize("angle_deg", [-60, -45, -12, 0, 20, 50, 80])
@pytest.mark.parametrize("held_at", [-0.04, 0.0, 0.03])
def test_a_turn_in_the_hand_is_seen_from_one_side(angle_deg: int, held_at: float) -> None:
    load = bar(held_at)
    points = seen_from_one_side(load.turned(np.radians(angle_deg)), np.random.default_rng(5))
    assert load.seen_turn(points, _GAP) == pytest.approx(np.radians(angle_deg), abs=0.15)


def test_points_of_the_fingers_the_palm_and_a_neighbour_do_not_count() -> None:
    rng = np.random.default_rng(6)
    load = bar(0.02)
    seen = seen_from_one_side(load.turned(0.8), rng)
    fingers = rng.uniform([0.013, -0.01, -0.05], [0.02, 0.01, 0.01], (500, 3))
    palm = rng.uniform([-0.05, -0.03, -0.06], [0.05, 0.03, -0.05], (500, 3))
    neighbour = rng.uniform([-0.05, 0.15, 0.0], [0.05, 0.20, 0.05], (500, 3))
    points = np.concatenate([seen, fingers, palm, neighbour])
    assert load.seen_turn(points, _GAP) == pytest.approx(0.8, abs=0.15)


def test_nothing_is_said_of_what_is_hardly_seen_or_not_explained() -> None:
    rng = np.random.default_rng(7)
    load = bar()
    assert load.seen_turn(seen_from_one_side(load, rng, 20), _GAP) is None
    anything = rng.uniform([-0.01, -0.06, -0.04], [0.01, 0.06, 0.06], (400, 3))
    assert load.seen_turn(anything, _GAP) is None


def test_a_bar_that_hangs_reaches_lower_than_one_that_lies() -> None:
    load, tool = bar(), _DOWN.copy()
    tool[2, 3] = 0.3
    assert load.bottom(tool) == pytest.approx(0.3 - 0.015)
    assert load.turned(np.pi / 2).bottom(tool) == pytest.approx(0.3 - 0.06)


def test_its_spheres_turn_with_it() -> None:
    centres, radii = bar().turned(np.pi / 2).spheres()
    assert centres[:, 2].max() + radii[0] == pytest.approx(0.06, abs=1e-6)
    assert np.abs(centres[:, 1]).max() < 0.015
