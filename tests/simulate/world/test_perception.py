"""Perception of tables laid with products, through a noisy camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from features.geometry import Frame
from features.perception import Ignored, perceive
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.robots.nao import describe_nao
from simulate.world.camera import INTRINSICS, Camera
from simulate.world.noise import SensorNoise
from simulate.world.objects import product, sample_objects, write_assets
from simulate.world.robot_body import RobotBody
from simulate.world.scene import Placement, arrange, lay
from simulate.world.world import World


@pytest.fixture(scope="module")
def assets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("assets")


@pytest.mark.slow
def test_objects_on_noisy_tables_are_found_one_segment_each(assets: Path) -> None:
    """Four tables of six products, both halves: 24 objects."""
    found = extra = total = 0
    offsets, heights = [], []
    for seed in range(4):
        with World() as world:
            camera, robot = Camera(world.client), RobotBody(world, describe_nao())
            world.add_table()
            boxes = [world.add_place_box(side) for side in ("right", "left")]
            specs = sample_objects(np.random.default_rng(seed), 6)
            laid = lay(world, arrange(specs, np.random.default_rng(seed + 100)), assets)
            for side, sign in (("right", -1), ("left", 1)):
                pose = robot.look(side)
                frame, bodies = camera.capture(pose)
                noisy = SensorNoise().apply(frame, np.random.default_rng(seed))
                ignored = tuple(Ignored(box.x_range, box.y_range) for box in boxes)
                view = perceive(noisy, pose, ignored)
                assert view.table_height == pytest.approx(0.27, abs=3e-3)
                mine = [s for s in view.objects if s.position[1] * sign >= 0]
                standing = [x for x in laid if world.object_pose(x.body).y * sign >= 0]
                total += len(standing)
                for thing in standing:
                    true = world.object_pose(thing.body)
                    own = [s for s in mine if np.mean(bodies[s.mask] == thing.body) > 0.8]
                    found += len(own) == 1
                    if len(own) == 1:
                        offsets.append(np.linalg.norm(own[0].position - [true.x, true.y]))
                        heights.append(own[0].shape.height - thing.placement.spec.extent[2])
                extra += len(mine) - len(standing)
    assert total == 24
    # At most one object of 24 hidden or merged, and nothing invented.
    assert found >= 23
    assert extra <= 0
    # A hand that opens 5 cm needs the middle of a 4 cm thing to about half a centimetre.
    assert np.median(offsets) < 4e-3
    assert np.quantile(offsets, 0.9) < 9e-3
    assert np.median(np.abs(heights)) < 4e-3


@pytest.mark.slow
def test_a_tall_can_below_the_eyes_shows_little_but_its_lid_and_stands_all_the_same(
    tmp_path: Path,
) -> None:
    can = Placement(product("can", 55), 0.130662, 0.044516, 2.0935)
    body = SimulatedBody([can], tmp_path, Conditions(noise_seed=(8803, 13, 5)))
    try:
        frame, base_from_camera = body.look("left")
        (seen,) = perceive(frame, base_from_camera, body.ignored).objects
    finally:
        body.close()
    assert np.percentile(seen.points[:, 2], 5) > 0.2985  # nearly 3 cm over the table
    assert seen.position == pytest.approx((can.x, can.y), abs=0.006)


def test_an_empty_frame_has_no_table() -> None:
    frame = Frame(np.zeros((480, 640), np.float32), INTRINSICS, np.zeros((480, 640, 3), np.uint8))
    view = perceive(frame, np.eye(4))
    assert (view.status, view.objects) == ("empty", ())
    assert np.isnan(view.table_height)


def test_a_frame_without_colour_is_refused() -> None:
    with pytest.raises(ValueError, match="colour"):
        perceive(Frame(np.zeros((480, 640), np.float32), INTRINSICS), np.eye(4))


@pytest.mark.parametrize(("out_m", "lean_rad", "seen"), [(0.016, 0.39, False), (0.060, -0.6, True)])
def test_an_end_that_sticks_out_of_the_box_is_no_thing_on_the_table(
    tmp_path: Path, out_m: float, lean_rad: float, seen: bool
) -> None:
    """A bottle whose foot is in the box, and one whose neck leans on its wall from outside."""
    body = SimulatedBody([], tmp_path, Conditions(preset="fast", noise_seed=(77,)))
    try:
        world, box = body.world, body.world.place_boxes["right"]
        bottle = product("bottle", 77)
        thing = world.spawn(bottle, (0.17, -0.29), 0.0, write_assets(bottle, tmp_path))
        # It lies towards the middle of the table: the neck points there, or away from there.
        turn = lean_rad - np.pi / 2 if lean_rad > 0 else np.pi / 2 + lean_rad
        half = bottle.extent[2] / 2
        reach, rise = half * np.cos(lean_rad), half * np.sin(abs(lean_rad))
        middle = (0.17, box.y_range[1] + out_m - reach, box.floor + 0.013 + rise)
        world.put(thing, middle, Rotation.from_euler("x", turn).as_quat().tolist())
        frame, base_from_camera = body.look("right")
        objects = perceive(frame, base_from_camera, body.ignored).objects
        assert (body.eyes.labels == thing).any()
    finally:
        body.close()
    assert bool(objects) == seen
