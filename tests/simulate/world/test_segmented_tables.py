"""Segmentation of what the simulated head camera sees, against the renderer's own labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from features.codec import decode, encode_frame
from features.segmentation import Scene, segment_scene
from simulate.robots.nao import describe_nao
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import ObjectSpec, product, write_assets
from simulate.world.robot_body import RobotBody
from simulate.world.world import World

Place = tuple[ObjectSpec, float, float, float]

# The smallest of each family that a hand of this size is meant to take.
SMALL: tuple[Place, ...] = (
    (ObjectSpec("pen", (0.016, 0.09), 0.01, 4_000_901, "pen-thin"), 0.19, -0.12, 0.6),
    (ObjectSpec("can", (0.024, 0.06), 0.02, 901, "can-thin"), 0.14, -0.05, 0.0),
    (ObjectSpec("ball", (0.030,), 0.01, 1_000_901, "ball-small"), 0.13, -0.11, 0.0),
    (ObjectSpec("box", (0.022, 0.022, 0.035), 0.01, 2_000_901, "box-small"), 0.16, -0.17, 0.4),
)


def _look(folder: Path, places: Sequence[Place], seed: int) -> tuple[Scene, np.ndarray, list[int]]:
    """Return the scene found, the true label of each pixel and the number of each object."""
    rng = np.random.default_rng(seed)
    with World() as world:
        camera = Camera(world.client)
        robot = RobotBody(world, describe_nao())
        world.add_table()
        bodies = [
            world.spawn(spec, (x, y), yaw, write_assets(spec, folder)) for spec, x, y, yaw in places
        ]
        world.step(0.3)
        pose = robot.look("right")
        frame, seen = camera.capture(pose, Lighting.sample(rng))
        frame = SensorNoise().apply(frame, rng)
        table = world.table_body
    down = pose[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    scene = segment_scene(frame.points(), frame.rgb, gravity=down)
    # The robot's own arm is in the picture too: only objects and table are judged.
    truth = np.where(np.isin(seen, bodies), seen, np.where(seen == table, 0, -1))
    return scene, truth, bodies


def _best_f(scene: Scene, truth: np.ndarray, body: int) -> float:
    """Return the F-measure of an object and the segment that holds most of it."""
    valid, mine = truth >= 0, truth == body
    label = int(np.bincount(scene.labels[mine]).argmax())
    common = np.count_nonzero((scene.labels == label) & mine)
    both = np.count_nonzero((scene.labels == label) & valid) + np.count_nonzero(mine)
    return 2 * common / both if label else 0.0


def test_the_smallest_things_are_one_segment_each_on_a_noisy_frame(tmp_path: Path) -> None:
    scene, truth, bodies = _look(tmp_path, SMALL, seed=1)
    assert scene.status == "ok"
    # About 0.98 each; what is missing are pixels that the sensor loses along the outline.
    assert min(_best_f(scene, truth, body) for body in bodies) > 0.9
    # Besides them only the robot's own arm is found, nothing of the bare table.
    shown = [truth.ravel()[found.indices] for found in scene.objects]
    assert sorted(int(np.median(pixels)) for pixels in shown if np.median(pixels) >= 0) == bodies


def test_a_bottle_keeps_its_neck(tmp_path: Path) -> None:
    # The neck's valley is sharp; what keeps it is that it stands wholly on the body.
    places = tuple(
        (product("bottle", number), 0.15, -0.05 - 0.07 * i, 0.0) for i, number in enumerate((3, 8))
    )
    scene, truth, bodies = _look(tmp_path, places, seed=2)
    assert min(_best_f(scene, truth, body) for body in bodies) > 0.9


def test_things_that_touch_are_told_apart(tmp_path: Path) -> None:
    box = ObjectSpec("box", (0.03, 0.04, 0.05), 0.03, 2_000_902, "box-touching")
    ball = ObjectSpec("ball", (0.036,), 0.01, 1_000_902, "ball-touching")
    scene, truth, bodies = _look(tmp_path, ((box, 0.15, -0.10, 0), (ball, 0.15, -0.1392, 0)), 3)
    assert min(_best_f(scene, truth, body) for body in bodies) > 0.85


def test_an_object_goes_over_the_wire_in_a_few_kilobytes_and_comes_back(tmp_path: Path) -> None:
    with World() as world:
        camera = Camera(world.client)
        robot = RobotBody(world, describe_nao())
        world.add_table()
        can = product("can", 3)
        body = world.spawn(can, (0.15, -0.1), 0.0, write_assets(can, tmp_path))
        exact, seen = camera.capture(robot.look("right"))
    frame = SensorNoise().apply(exact, np.random.default_rng(0))
    crop = frame.crop(seen == body)
    data = encode_frame(crop)
    assert 2_000 < len(data) < 20_000
    back = decode(data)
    # Depth in steps of 0.1 mm: half a step, and float32.
    np.testing.assert_allclose(back.depth_m, crop.depth_m, atol=5.1e-5)
    np.testing.assert_array_equal(back.object_mask(), crop.object_mask())
    assert (back.x0, back.y0) == (crop.x0, crop.y0)


@pytest.mark.slow
def test_the_same_table_gives_the_same_labels(tmp_path: Path) -> None:
    first, again = (_look(tmp_path, SMALL[:2], seed=11)[0] for _ in range(2))
    np.testing.assert_array_equal(first.labels, again.labels)
