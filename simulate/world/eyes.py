"""Cameras of a robot: noisy RGB-D frames, and points in its base frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, transform
from simulate.robots.description import Floats
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.robot_body import RobotBody

__all__ = ["Eyes"]

_View = tuple[Frame, Floats, NDArray[np.int32]]


class Eyes:
    """Takes frames with the cameras of a robot.

    A frame is cached until time passes or something is put or taken away by hand, so that two views
    of the same scene cost one frame.

    Parameters
    ----------
    robot
        The robot that carries the cameras.
    lighting
        None selects the standard light.
    noise
        Noise of the sensor; None for a perfect sensor.
    noise_seed
        Entropy of the noise.
    """

    def __init__(
        self,
        robot: RobotBody,
        lighting: Lighting | None = None,
        noise: SensorNoise | None = None,
        noise_seed: tuple[int, ...] = (0,),
    ) -> None:
        self.camera = Camera(robot.world.client)
        self.lighting = lighting or Lighting()
        self.labels: NDArray[np.int32] = np.zeros((0, 0), np.int32)
        """Ground truth for scoring: the body that each pixel of the last frame shows."""
        self.frames = 0
        """Number of frames taken so far."""
        self._robot = robot
        self._noise = noise
        self._rng = np.random.default_rng(np.random.SeedSequence(noise_seed))
        self._views: dict[tuple[str, str | None], _View] = {}
        self._clouds: dict[tuple[str, str | None], Floats] = {}
        self._moment = (float("nan"), 0)

    def look(self, side: str, camera: str | None = None) -> tuple[Frame, Floats]:
        """Turn the head towards a side and take a frame.

        Parameters
        ----------
        side
            ``left``, ``right`` or ``ahead``; or another direction of the camera.
        camera
            Name of the camera; None = the robot's first.

        Returns
        -------
        Frame
            Colour and depth with the noise of the sensor.
        (4, 4) float
            ``base_from_camera``, optical frame.
        """
        if self._robot.world.moment != self._moment:
            self._views.clear()
            self._clouds.clear()
            self._moment = self._robot.world.moment
        if (side, camera) not in self._views:
            self._views[side, camera] = self._capture(side, camera)
        frame, base_from_camera, self.labels = self._views[side, camera]
        return frame, base_from_camera

    def _capture(self, side: str, camera: str | None) -> _View:
        self.frames += 1
        base_from_camera = self._robot.look(side, camera)
        world_from_camera = self._robot.world_from_base @ base_from_camera
        frame, labels = self.camera.capture(world_from_camera, self.lighting)
        if self._noise is not None:
            frame = self._noise.apply(frame, self._rng)
        return frame, base_from_camera, labels

    def points(self, side: str) -> Floats:
        """Return the points (n, 3), m, base frame, of a look at one side of the table."""
        return self._points(side, None)

    def box_points(self, side: str) -> Floats:
        """Return the points (n, 3), m, base frame, of a look at the box of one side.

        A camera named after the box takes the frame where the robot has one; a head that has a
        direction of that name turns to the box.
        """
        name, cameras = f"box_{side}", self._robot.description.cameras
        if name in cameras:
            return self._points(side, name)
        first = next(iter(cameras.values()))
        return self._points(name if name in first.look else side, None)

    def _points(self, side: str, camera: str | None) -> Floats:
        frame, base_from_camera = self.look(side, camera)
        if (side, camera) not in self._clouds:
            cloud = frame.points().reshape(-1, 3).astype(np.float64)
            seen = np.isfinite(cloud).all(axis=1) & (cloud[:, 2] > 0)
            points = np.asarray(transform(base_from_camera, cloud[seen]), dtype=np.float64)
            points.setflags(write=False)  # several looks share them
            self._clouds[side, camera] = points
        return self._clouds[side, camera]
