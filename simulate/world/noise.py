"""Errors of a structured-light sensor, applied to perfect frames.

Axial noise after Khoshelham and Elberink (2012) in the form of Nguyen, Izadi and Lovell (3DIM
2012, eq. 3); the disparity step of an eighth of a pixel on a baseline of 0.1 m is that of the
thesis's simulated sensor (Gatto 2016, 1.5.1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame

__all__ = ["SensorNoise"]

Depth = NDArray[np.float32]


@dataclass(frozen=True)
class SensorNoise:
    """Lateral jitter, axial noise, quantised disparity, drop-out at edges, grain in colour.

    Parameters
    ----------
    lateral_px
        Standard deviation of the image position at which a depth was measured, px.
    axial_base_m, axial_square
        Standard deviation ``base + square * (z - 0.4)^2`` of depth, m.
    disparity_px, baseline_m
        Step of the disparity, and the distance of projector and camera; 0 px = none.
    dropout
        Share of pixels lost where depth jumps by more than ``edge_m`` from pixel to pixel.
    colour
        Standard deviation of every colour value, of 255.
    """

    lateral_px: float = 0.5
    axial_base_m: float = 0.0012
    axial_square: float = 0.0019
    disparity_px: float = 1 / 8
    baseline_m: float = 0.1
    dropout: float = 0.6
    edge_m: float = 0.02
    colour: float = 2.0

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the frame with the errors of the sensor.

        Parameters
        ----------
        frame
            Exact depth, 0 = missing.
        rng
            Draws the same number of values whatever the frame shows.

        Examples
        --------
        >>> from features.geometry import Intrinsics
        >>> flat = Frame(np.full((48, 64), 0.3, np.float32), Intrinsics.from_fov(64, 48, 1.2))
        >>> noisy = SensorNoise().apply(flat, np.random.default_rng(0)).depth_m
        >>> bool(0.001 < noisy.std() < 0.002)
        True
        """
        exact = np.where(np.isfinite(frame.depth_m), frame.depth_m, 0).astype(np.float32)
        jump = np.maximum(
            np.abs(np.diff(exact, axis=1, prepend=exact[:, :1])),
            np.abs(np.diff(exact, axis=0, prepend=exact[:1])),
        )
        depth = self._jitter(exact, rng)
        sigma = self.axial_base_m + self.axial_square * (depth - 0.4) ** 2
        depth = depth + _normal(rng, depth.shape) * sigma
        depth = self._quantise(depth, frame.intrinsics.fx)
        lost = (jump > self.edge_m) & (rng.random(depth.shape, np.float32) < self.dropout)
        depth[lost | (exact <= 0) | (depth <= 0)] = 0
        rgb = frame.rgb
        if rgb is not None:
            grain = _normal(rng, rgb.shape) * self.colour
            rgb = np.clip(np.rint(rgb + grain), 0, 255).astype(np.uint8)
        return replace(frame, depth_m=depth.astype(np.float32), rgb=rgb)

    def _jitter(self, depth: Depth, rng: np.random.Generator) -> Depth:
        """Take each depth from a nearby pixel, unless that has none."""
        height, width = depth.shape
        shift = np.rint(_normal(rng, (2, height, width)) * self.lateral_px).astype(np.int32)
        rows = np.clip(np.arange(height, dtype=np.int32)[:, None] + shift[0], 0, height - 1)
        columns = np.clip(np.arange(width, dtype=np.int32)[None, :] + shift[1], 0, width - 1)
        moved = depth.ravel()[rows * np.int32(width) + columns]
        return np.where(moved > 0, moved, depth)

    def _quantise(self, depth: Depth, focal_px: float) -> Depth:
        if self.disparity_px <= 0:
            return depth
        # Disparity in steps; float32 holds whole steps exactly up to 2^24.
        scale = np.float32(focal_px * self.baseline_m / self.disparity_px)
        steps = np.maximum(np.rint(scale / np.maximum(depth, np.float32(1e-3))), np.float32(1))
        return np.where(depth > 0, scale / steps, np.float32(0))


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Depth:
    """Return standard normal values; single precision halves the time of a frame."""
    return rng.standard_normal(shape, np.float32)
