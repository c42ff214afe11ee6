"""Simulated tables before a camera: stand-ins for the images of Gatto 2016."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics, look_at
from rtask.scratch import ScratchFolder
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import sample_objects, write_assets
from simulate.world.scene import arrange
from simulate.world.world import World

__all__ = ["CAMERA", "EYE", "TARGET", "SeenTable", "seen_tables"]

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
"""As a Kinect registers depth to colour."""
EYE, TARGET = np.array([-0.05, 0.0, 0.55]), np.array([0.22, 0.0, 0.02])


@dataclass(frozen=True, eq=False)
class SeenTable:
    """A table with products on it.

    Parameters
    ----------
    bodies : (h, w) int32
        Ground truth: the body that each pixel shows.
    products
        Their numbers there.
    down : (3,)
        Direction of gravity, camera frame.
    """

    frame: Frame
    bodies: NDArray[np.int32]
    products: tuple[int, ...]
    down: NDArray[np.float64]

    def grey(self) -> NDArray[np.uint8]:
        """Return the image (h, w) in grey."""
        assert self.frame.rgb is not None  # of a simulated camera
        return np.asarray(cv2.cvtColor(self.frame.rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def seen_tables(count: int, on_table: int, seed: int, of: int = 0) -> Iterator[SeenTable]:
    """Yield tables of drawn products under drawn light, with sensor noise.

    Parameters
    ----------
    of
        Number of products that all tables share; 0 = each table draws its own.
    """
    shared = sample_objects(np.random.default_rng([seed, 0x7AB1E]), of)
    for number in range(count):
        rng = np.random.default_rng([seed, number, 0x7AB1E])
        chosen = rng.permutation(of)[:on_table].tolist()
        specs = [shared[k] for k in chosen] if of else sample_objects(rng, on_table)
        with ScratchFolder("tables") as folder, World() as world:
            world.add_table(0.0)
            bodies = tuple(
                world.spawn(p.spec, (p.x, p.y), p.yaw, write_assets(p.spec, folder))
                for p in arrange(specs, rng)
            )
            world.step(0.5)
            pose = look_at(EYE, TARGET)
            exact, shown = Camera(world.client, CAMERA).capture(pose, Lighting.sample(rng))
            down = pose[:3, :3].T @ np.array([0.0, 0.0, -1.0])
            yield SeenTable(SensorNoise().apply(exact, rng), shown, bodies, down)
