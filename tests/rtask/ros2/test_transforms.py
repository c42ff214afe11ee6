"""Transforms at the time of a view: by interpolation, over several frames, and never of another."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from grasp.messages import matrix_from_message
from grasp.spatial.frames import matrix_from_pose
from rtask.errors import UsageError
from rtask.ros2.transforms import TransformBuffer


def stamp(seconds):
    return SimpleNamespace(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))


def stamped(parent, child, seconds, move=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0, 1.0)):
    transform = SimpleNamespace(
        translation=SimpleNamespace(**dict(zip("xyz", move, strict=True))),
        rotation=SimpleNamespace(**dict(zip("xyzw", turn, strict=True))),
    )
    header = SimpleNamespace(frame_id=parent, stamp=stamp(seconds))
    return SimpleNamespace(transforms=[
        SimpleNamespace(header=header, child_frame_id=child, transform=transform)
    ])  # fmt: skip


def random_pose(rng):
    turn = rng.normal(size=4)
    return tuple(rng.normal(size=3)), tuple(turn / np.linalg.norm(turn))


def matrix(buffer, target, source, seconds):
    return matrix_from_message(buffer.lookup(target, source, stamp(seconds), 0.0).as_pose())


def test_a_chain_over_a_common_frame_is_the_product_of_its_matrices():
    rng, buffer = np.random.default_rng(4), TransformBuffer()
    torso, head, arm = (random_pose(rng) for _ in range(3))
    buffer.take(stamped("base", "torso", 1.0, *torso))
    buffer.take(stamped("torso", "head", 1.0, *head))
    buffer.take(stamped("/torso", "arm", 0.0, *arm), is_static=True)
    parts = [matrix_from_pose(np.array(move), np.array(turn)) for move, turn in (torso, head, arm)]
    np.testing.assert_allclose(matrix(buffer, "base", "head", 1.0), parts[0] @ parts[1], atol=1e-9)
    expected = np.linalg.inv(parts[2]) @ parts[1]
    np.testing.assert_allclose(matrix(buffer, "arm", "head", 1.0), expected, atol=1e-9)
    np.testing.assert_allclose(matrix(buffer, "head", "head", 9.0), np.eye(4), atol=1e-12)


def test_between_two_times_it_moves_straight_and_turns_evenly():
    buffer = TransformBuffer()
    half = np.sqrt(0.5)
    buffer.take(stamped("base", "camera", 1.0))
    # The same turn as (0, 0, half, half), by the longer way round.
    buffer.take(stamped("base", "camera", 2.0, (1.0, 0.0, 0.0), (0.0, 0.0, -half, -half)))
    seen = matrix(buffer, "base", "camera", 1.5)
    assert seen[0, 3] == pytest.approx(0.5)
    assert np.degrees(np.arctan2(seen[1, 0], seen[0, 0])) == pytest.approx(45)


def test_another_times_transform_is_never_used():
    buffer = TransformBuffer()
    for seconds in (1.0, 2.0):
        buffer.take(stamped("base", "camera", seconds))
    for seconds in (0.9, 2.1):
        with pytest.raises(UsageError, match=r"camera is known from 1.000 to 2.000 s only"):
            matrix(buffer, "base", "camera", seconds)
    with pytest.raises(UsageError, match="nobody publishes head"):
        matrix(buffer, "base", "head", 1.0)
    buffer.take(stamped("world", "map", 0.0), is_static=True)
    with pytest.raises(UsageError, match="they are not connected"):
        matrix(buffer, "map", "camera", 1.0)
    buffer.clear()
    with pytest.raises(UsageError, match="nobody publishes"):
        matrix(buffer, "base", "camera", 1.0)


def test_what_is_no_rotation_is_left_out_and_old_transforms_are_dropped():
    buffer = TransformBuffer()
    buffer.take(stamped("base", "camera", 1.0, turn=(0.0, 0.0, 0.0, 0.0)))
    with pytest.raises(UsageError, match="nobody publishes"):
        matrix(buffer, "base", "camera", 1.0)
    for seconds in (3.0, 1.0, 20.0):
        buffer.take(stamped("base", "camera", seconds))
    with pytest.raises(UsageError, match=r"from 20.000 to 20.000 s only"):
        matrix(buffer, "base", "camera", 3.0)


def test_a_ring_of_frames_ends():
    buffer = TransformBuffer()
    buffer.take(stamped("a", "b", 1.0))
    buffer.take(stamped("b", "a", 1.0))
    with pytest.raises(UsageError, match="no transform from b to c"):
        matrix(buffer, "c", "b", 1.0)


@pytest.mark.parametrize(
    ("seconds", "move", "says"),
    [
        (4.0, (0.2, 0.0, 0.0), "camera: its transforms are 3.0 s apart then, 0.20 m"),
        (1.2, (0.2, 0.0, 0.0), ""),  # ten a second or so: nothing happens in between
        (4.0, (0.001, 0.0, 0.0), ""),  # it stood still
    ],
)
def test_a_place_between_two_distant_transforms_is_doubted_if_it_moved(seconds, move, says):
    buffer = TransformBuffer()
    buffer.take(stamped("base", "camera", 1.0))
    buffer.take(stamped("base", "camera", seconds, move))
    said = buffer.doubt("base", "camera", 1_100_000_000)
    assert said.startswith(says)
    assert bool(said) is bool(says)
    assert not buffer.doubt("base", "camera", 1_000_000_000)
