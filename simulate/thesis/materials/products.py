"""Simulated products before a camera: stand-ins for the objects and images of both theses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics, look_at
from features.recognition.views.view import ViewFeatures, describe_view
from rtask.scratch import ScratchFolder
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import ObjectSpec, product, write_assets
from simulate.world.world import World

__all__ = ["SIX", "STAND_INS", "Turned", "household", "turned"]

STAND_INS = "the thesis's objects are stood in for by printed products of the simulator"

SIX = ("box-3", "box-11", "bottle-5", "bottle-14", "can-8", "can-21")
"""Stand-ins of Kehoe's air freshener, candy, juice, mustard, peanut butter and soap."""

_CAMERA = Intrinsics(384, 384, 579.4, 579.4, 191.5, 191.5)
"""The middle of a 640 x 480 image with a vertical field of view of 45 degrees."""
_DISTANCE_RADII = 4.5
_LOW_RAD = (0.26, 0.52)
"""Two low elevations, as on Kehoe's turntable (4.6)."""


def household(name: str) -> ObjectSpec:
    """Return a product by its name, such as ``can-8``."""
    kind, _, number = name.partition("-")
    return product(kind, int(number))  # type: ignore[arg-type]  # kinds are checked there


@dataclass(frozen=True, eq=False)
class Turned:
    """A view of a product on a turntable.

    Parameters
    ----------
    azimuth_deg
        None from above.
    """

    name: str
    azimuth_deg: int | None
    frame: Frame

    def described(self) -> ViewFeatures:
        """Describe it for recognition, with depth."""
        frame = self.frame
        assert frame.rgb is not None  # of a simulated camera
        return describe_view(frame.rgb, frame.object_mask(), frame.depth_m, frame.intrinsics)


def turned(name: str, step_deg: int, seed: int) -> Iterator[Turned]:
    """Yield views every so many degrees at two low elevations, and four from above."""
    spec = household(name)
    rng = np.random.default_rng([seed, spec.texture_seed])
    with ScratchFolder("turned") as folder, World() as world:
        world.add_table(0.0)
        body = world.spawn(spec, (0.0, 0.0), assets=write_assets(spec, folder))
        camera = Camera(world.client, _CAMERA)
        centre = world.object_pose(body).position
        distance = _DISTANCE_RADII * float(np.linalg.norm(spec.extent)) / 2
        places = [(a, e) for e in _LOW_RAD for a in range(0, 360, step_deg)]
        for azimuth, elevation in [*places, *((a, 1.5) for a in range(0, 360, 90))]:
            frame = _seen(world, camera, body, centre, distance, azimuth, elevation, rng)
            yield Turned(name, azimuth if elevation < 1 else None, frame)


def _seen(
    world: World, camera: Camera, body: int, centre: NDArray[np.float64], distance: float,
    azimuth_deg: float, elevation: float, rng: np.random.Generator,
) -> Frame:  # fmt: skip
    azimuth = np.deg2rad(azimuth_deg)
    towards = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
               np.sin(elevation)]  # fmt: skip
    pose = look_at(centre + distance * np.array(towards), centre)
    frame, bodies = camera.capture(pose, Lighting.sample(rng))
    noisy = SensorNoise().apply(frame, rng)
    return replace(noisy, mask=bodies == body)
