"""A frame is sent when the scene changed, and only then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from features.geometry import Frame, Intrinsics
from features.scene_change import SceneChangeGate, SceneChangeParams

CAMERA = Intrinsics.from_fov(320, 240, 1.0)


def table(seed: int, box_at: int | None = None, height: float = 0.05) -> Frame:
    """Return a noisy look straight down at a table 0.9 m away, with a box of 60 px on it."""
    rng = np.random.default_rng(seed)
    depth = np.full((240, 320), 0.9)
    grey = np.full((240, 320), 120.0)
    if box_at is not None:
        depth[90:150, box_at : box_at + 60] -= height
        grey[90:150, box_at : box_at + 60] = 190
    depth += rng.normal(0, 0.0017, depth.shape)  # sigma of the sensor model at 0.9 m
    depth[rng.random(depth.shape) < 0.01] = 0
    grey += rng.normal(0, 3, grey.shape)
    rgb = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=-1)
    return Frame(depth.astype(np.float32), CAMERA, rgb)


def test_still_moved_still_sends_two_frames() -> None:
    gate = SceneChangeGate()
    frames = [table(k, 100) for k in range(5)] + [table(k, 112) for k in range(5, 10)]
    sent = [gate.offer(frame, 0.1 * k) for k, frame in enumerate(frames)]
    assert [change.send for change in sent] == [k in (0, 5) for k in range(10)]
    assert sent[5].reason == "depth"


def test_slow_drift_adds_up_because_the_last_frame_sent_is_the_measure() -> None:
    gate = SceneChangeGate()
    gate.offer(table(0, 100), 0.0)
    sent = [gate.offer(table(k, 100 + k), 0.1 * k).send for k in range(1, 12)]
    assert any(sent)
    assert not all(sent)


def test_something_taken_away_is_noticed_and_noise_is_not() -> None:
    gate = SceneChangeGate()
    gate.offer(table(0, 100), 0.0)
    assert not gate.offer(table(1, 100), 0.1).send
    gone = gate.offer(table(2), 0.2)
    # the blocks inside the box go from one distribution to a disjoint one: 1 bit
    assert gone.send
    assert gone.depth_change > 0.9


def test_a_surface_that_vanishes_counts_as_changed() -> None:
    frame = table(0)
    hole = frame.depth_m.copy()
    hole[100:160, 100:160] = 0
    gate = SceneChangeGate()
    gate.offer(frame, 0.0)
    assert gate.offer(replace(frame, depth_m=hole), 0.1).depth_change == 1.0


def test_light_that_dims_everywhere_is_no_change_and_paint_is() -> None:
    frame = table(0, 100)
    assert frame.rgb is not None
    gate = SceneChangeGate()
    gate.offer(frame, 0.0)
    dim = (frame.rgb * 0.8).astype(np.uint8)
    assert not gate.offer(replace(frame, rgb=dim), 0.1).send
    painted = frame.rgb.copy()
    painted[20:80, 20:80] = 20
    assert gate.offer(replace(frame, rgb=painted), 0.2).reason == "colour"


def test_age_force_camera_and_segments_send_too() -> None:
    frame = table(0, 100)
    at = np.array([[0.0, 0.0, 0.8], [0.1, 0.0, 0.8]])
    gate = SceneChangeGate(SceneChangeParams(max_age_s=5))
    assert gate.offer(frame, 0.0, centroids=at).reason == "first"
    assert gate.offer(frame, 1.0, centroids=at[::-1] + 0.004).reason == "unchanged"
    assert gate.offer(frame, 1.1, centroids=at[:1]).reason == "segments"
    assert gate.offer(frame, 1.2, centroids=at[:1] + 0.02).reason == "segments"
    assert gate.offer(frame, 1.3, force=True).reason == "forced"
    assert gate.offer(frame, 6.3).reason == "age"
    small = Frame(frame.depth_m[:120], CAMERA)
    assert gate.offer(small, 6.4).reason == "camera"


def test_frames_without_any_depth_or_smaller_than_a_block_are_no_accident() -> None:
    blind = Frame(np.zeros((240, 320), np.float32), CAMERA)
    gate = SceneChangeGate()
    gate.offer(blind, 0.0)
    assert not gate.offer(blind, 0.1).send
    broken = Frame(np.full((240, 320), np.nan, np.float32), CAMERA)
    assert not gate.offer(broken, 0.2).send
    assert gate.offer(table(0), 0.3).send  # from nothing to a full view
    tiny = SceneChangeGate()
    speck = Frame(np.ones((4, 4), np.float32), Intrinsics(4, 4, 5, 5, 1.5, 1.5))
    tiny.offer(speck, 0.0)
    assert not tiny.offer(speck, 0.1).send


@pytest.mark.parametrize("name", ["depth_bits", "colour_bits", "max_age_s", "moved_m"])
def test_thresholds_must_be_positive(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        SceneChangeParams(**{name: 0.0})
