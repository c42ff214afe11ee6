"""The robot's RGB-D camera, rendered from its physics world (Gatto 2016, 1.5.1).

A hypothetical near-range sensor: 640 x 480, field of view 1.2 rad, from 5 cm. No sensor on the
market measures depth that near; the thesis's own cut-off of 0.4 m would remove the whole table of a
small robot.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics, look_at
from rtask.errors import RobotError, UsageError
from simulate.robots import Workplace

__all__ = ["INTRINSICS", "Camera", "Lighting"]

INTRINSICS = Intrinsics.from_fov(640, 480, 1.2)
_NEAR_M, _FAR_M = 0.05, 8.0
_GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
_SNAPSHOT_FOV_RAD = 0.62
_PLACE = Workplace()


@dataclass(frozen=True)
class Lighting:
    """One light over the table.

    Parameters
    ----------
    direction : (x, y, z)
        Towards the light, base frame.
    colour : (r, g, b)
        0..1.
    ambient, diffuse, specular
        Shares of the light.
    """

    direction: tuple[float, float, float] = (0.4, -0.3, 1.0)
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ambient: float = 0.55
    diffuse: float = 0.45
    specular: float = 0.05

    @classmethod
    def sample(cls, rng: np.random.Generator) -> Lighting:
        """Draw the light of another room: direction, tint and hardness."""
        azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(0.7, 1.4)
        tint = np.clip(rng.uniform(0.88, 1.0) + rng.normal(0, 0.04, 3), 0.7, 1.0)
        return cls(
            (
                float(np.cos(elevation) * np.cos(azimuth)),
                float(np.cos(elevation) * np.sin(azimuth)),
                float(np.sin(elevation)),
            ),
            (float(tint[0]), float(tint[1]), float(tint[2])),
            ambient=float(rng.uniform(0.45, 0.65)),
            diffuse=float(rng.uniform(0.30, 0.50)),
            specular=float(rng.uniform(0.0, 0.12)),
        )


class Camera:
    """Camera that takes frames and pictures in one physics client.

    Parameters
    ----------
    client
        Of a :class:`simulate.world.world.World`.
    intrinsics
        Of the RGB-D camera.
    renderer
        ``tiny`` renders on the CPU and works everywhere (0.1 s a frame, 0.1 s of one core);
        ``egl`` uses the plug-in, which must be loaded before the world holds any body, shows
        other light and writes lines of its own to standard output at every frame.

    Raises
    ------
    RobotError
        If ``egl`` is requested and does not load.
    """

    def __init__(
        self, client: Any, intrinsics: Intrinsics = INTRINSICS, renderer: str = "tiny"
    ) -> None:
        if renderer not in ("tiny", "egl"):
            raise UsageError(f"unknown renderer {renderer!r}: expected tiny or egl")
        self.intrinsics = intrinsics
        self._client = client
        self._renderer = client.ER_TINY_RENDERER
        if renderer == "egl":
            _load_egl(client)
            self._renderer = client.ER_BULLET_HARDWARE_OPENGL

    def capture(
        self, world_from_camera: NDArray[np.float64], lighting: Lighting | None = None
    ) -> tuple[Frame, NDArray[np.int32]]:
        """Take a frame.

        Parameters
        ----------
        world_from_camera : (4, 4)
            Pose of the optical frame (x right, y down, z forward).
        lighting
            None = the standard light.

        Returns
        -------
        Frame
            Colour and exact depth.
        (h, w) int32
            Ground truth for scoring: the body that each pixel shows, -1 = none.
        """
        camera = self.intrinsics
        vertical_fov = 2 * np.arctan(camera.height / 2 / camera.fy)
        rgb, buffer, bodies = self._render(
            world_from_camera, (camera.width, camera.height), vertical_fov, lighting
        )
        depth = _FAR_M * _NEAR_M / (_FAR_M - (_FAR_M - _NEAR_M) * buffer)
        seen = buffer < 1.0
        frame = Frame(
            np.where(seen, depth, 0.0).astype(np.float32),
            camera,
            rgb,
            frame_id="camera_depth_optical_frame",
        )
        return frame, bodies

    def snapshot(
        self,
        lighting: Lighting | None = None,
        size: tuple[int, int] = (320, 240),
        side: str = "right",
        eye: tuple[float, float, float] = _PLACE.eye,
        target: tuple[float, float, float] = _PLACE.target,
    ) -> bytes:
        """Return a picture for people as PNG, from in front of the robot.

        Parameters
        ----------
        size : (width, height), px
        side
            ``left`` or ``right``: the half of the table to look at.
        eye, target : (x, y, z), m
            Viewpoint and point to look at, for the right half; mirrored for the left.
        """
        mirror = np.array([1.0, -1.0 if side == "left" else 1.0, 1.0])
        pose = look_at(np.array(eye) * mirror, np.array(target) * mirror)
        rgb, _, _ = self._render(pose, size, _SNAPSHOT_FOV_RAD, lighting)
        done, data = cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))
        if not done:
            raise RobotError(f"cannot write a picture of {size[0]}x{size[1]} px")
        return bytes(data.tobytes())

    def _render(
        self,
        world_from_camera: NDArray[np.float64],
        size: tuple[int, int],
        vertical_fov_rad: float,
        lighting: Lighting | None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.int32]]:
        """Return colour (h, w, 3), depth buffer (h, w) in 0..1, bodies (h, w)."""
        light = lighting or Lighting()
        width, height = size
        view = _GL_FROM_OPTICAL @ np.linalg.inv(world_from_camera)
        projection = self._client.computeProjectionMatrixFOV(
            float(np.degrees(vertical_fov_rad)), width / height, _NEAR_M, _FAR_M
        )
        _, _, rgba, buffer, mask = self._client.getCameraImage(
            width,
            height,
            [float(v) for v in view.T.ravel()],
            projection,
            lightDirection=light.direction,
            lightColor=light.colour,
            lightDistance=2.0,
            shadow=1,
            lightAmbientCoeff=light.ambient,
            lightDiffuseCoeff=light.diffuse,
            lightSpecularCoeff=light.specular,
            renderer=self._renderer,
        )
        colours = np.asarray(rgba, np.uint8).reshape(height, width, 4)[..., :3].copy()
        depth = np.asarray(buffer, np.float64).reshape(height, width)
        return colours, depth, np.asarray(mask, np.int32).reshape(height, width)


def _load_egl(client: Any) -> None:
    if client.getNumBodies():
        raise RobotError("the EGL renderer must be loaded before the world holds any body")
    spec = importlib.util.find_spec("eglRenderer")
    if (
        spec is None
        or spec.origin is None
        or client.loadPlugin(spec.origin, "_eglRendererPlugin") < 0
    ):
        raise RobotError("the EGL renderer does not load on this machine; use renderer='tiny'")
