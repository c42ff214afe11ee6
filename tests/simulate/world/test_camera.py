"""The RGB-D camera: depth in metres, where rays say it is; light and noise that show."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from features.geometry import transform
from rtask.errors import UsageError
from simulate.robots.nao import describe_nao
from simulate.world.camera import INTRINSICS, Camera, Lighting
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise
from simulate.world.objects import product, write_assets
from simulate.world.robot_body import RobotBody
from simulate.world.world import World


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[World, Camera, np.ndarray]]:
    """A NAO that looks to the right at a can."""
    folder: Path = tmp_path_factory.mktemp("assets")
    with World() as world:
        camera = Camera(world.client)
        robot = RobotBody(world, describe_nao())
        world.add_table()
        can = product("can", 3)
        world.spawn(can, (0.15, -0.10), 0.0, write_assets(can, folder))
        yield world, camera, robot.look("right")


def test_the_intrinsics_are_those_of_a_1_2_rad_wide_image() -> None:
    assert INTRINSICS.fx == pytest.approx(320 / np.tan(0.6))
    assert (INTRINSICS.cx, INTRINSICS.cy) == (319.5, 239.5)


def test_the_table_lies_where_it_was_put(scene) -> None:
    world, camera, pose = scene
    frame, bodies = camera.capture(pose)
    points = transform(pose, frame.points()[bodies == world.table_body].astype(np.float64))
    # The depth buffer has 24 bits over 8 m: at 0.3 m its steps stay below a tenth of a millimetre.
    # The front face of the table, 2 cm high, is in the picture too.
    assert np.quantile(np.abs(points[:, 2] - 0.27), 0.95) < 1e-3


def test_depth_agrees_with_rays_cast_through_the_pixels(scene) -> None:
    world, camera, pose = scene
    frame, _ = camera.capture(pose)
    rng = np.random.default_rng(0)
    v, u = rng.integers(20, 460, 200), rng.integers(20, 620, 200)
    directions = np.stack(
        [(u - INTRINSICS.cx) / INTRINSICS.fx, (v - INTRINSICS.cy) / INTRINSICS.fy, np.ones(200)], -1
    )
    start = np.repeat(pose[None, :3, 3], 200, axis=0)
    end = transform(pose, directions * 2.0)
    hits = world.client.rayTestBatch(start.tolist(), end.tolist())
    expected = np.array([hit[2] * 2.0 if hit[0] >= 0 else 0.0 for hit in hits])
    seen = (expected > 0) & (frame.depth_m[v, u] > 0)
    error = np.abs(frame.depth_m[v, u][seen] - expected[seen])
    # Textured meshes are faceted and silhouettes differ by a pixel: judge by quantiles.
    assert np.median(error) < 1e-3
    assert np.quantile(error, 0.95) < 5e-3


def test_light_changes_colour_and_never_depth(scene) -> None:
    _, camera, pose = scene
    dim = Lighting(ambient=0.3, diffuse=0.2, specular=0.0, colour=(1.0, 0.8, 0.7))
    bright, _ = camera.capture(pose)
    dark, _ = camera.capture(pose, dim)
    np.testing.assert_array_equal(bright.depth_m, dark.depth_m)
    assert dark.rgb.mean() < 0.8 * bright.rgb.mean()


def test_light_is_drawn_from_its_seed() -> None:
    first = Lighting.sample(np.random.default_rng(4))
    assert first == Lighting.sample(np.random.default_rng(4))
    assert first != Lighting.sample(np.random.default_rng(5))
    assert first.direction[2] > 0.5


def test_a_picture_for_people_is_a_png(scene) -> None:
    _, camera, _ = scene
    assert camera.snapshot(size=(64, 48)).startswith(b"\x89PNG")


def test_two_looks_at_one_scene_cost_a_frame_until_something_is_taken_away(tmp_path: Path) -> None:
    with World("fast") as world:
        eyes = Eyes(RobotBody(world, describe_nao()))
        world.add_table()
        can = product("can", 3)
        body = world.spawn(can, (0.15, -0.10), 0.0, write_assets(can, tmp_path))
        first, _ = eyes.look("right")
        assert eyes.look("right")[0] is first
        assert (eyes.labels == body).any()
        world.remove(body)  # no time passes
        eyes.look("right")
        assert not (eyes.labels == body).any()
        assert eyes.frames == 2


def test_an_unknown_renderer_is_refused(scene) -> None:
    with pytest.raises(UsageError, match="tiny or egl"):
        Camera(scene[0].client, renderer="magic")


def test_noise_is_as_large_as_stated_and_the_same_for_the_same_seed(scene) -> None:
    world, camera, pose = scene
    frame, bodies = camera.capture(pose)
    noise = SensorNoise()
    noisy = noise.apply(frame, np.random.default_rng(1))
    again = noise.apply(frame, np.random.default_rng(1))
    np.testing.assert_array_equal(noisy.depth_m, again.depth_m)
    flat = (bodies == world.table_body) & (noisy.depth_m > 0)
    spread = float(np.std((noisy.depth_m - frame.depth_m)[flat]))
    # Axial 1.2 mm plus lateral jitter of half a pixel on a table seen at a slant.
    assert 0.001 < spread < 0.01
    assert 1.0 < np.std(noisy.rgb.astype(float) - frame.rgb) < 3.0


def test_noise_loses_pixels_at_edges_only(scene) -> None:
    _, camera, pose = scene
    frame, _ = camera.capture(pose)
    noisy = SensorNoise().apply(frame, np.random.default_rng(1))
    lost = (frame.depth_m > 0) & (noisy.depth_m == 0)
    assert 0 < lost.mean() < 0.02
