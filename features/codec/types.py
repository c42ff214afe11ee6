"""A cloud, unorganised or on the grid of pixels that it was measured on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["Cloud"]

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class Cloud:
    """Points without a camera.

    Parameters
    ----------
    positions : (n, 3) float32, m
        Finite.
    colours : (n, 3) uint8, RGB, or None
    frame_id
        Name of the frame the points are in (tf).
    stamp_s
        Time of capture, s since the epoch.
    shape
        Leading shape of the cloud as it came: ``(h, w)`` when organised, ``(m,)`` when points were
        missing; empty = ``(n,)``.
    places : (n,) int64 or None
        Of each point in the flattened ``shape``; None = no point is missing.
    viewpoint : (4, 4) float64, m, or None
        Pose of the sensor in the frame of the points, where the file says it and it is not there.
    """

    positions: NDArray[np.float32]
    colours: UInt8Array | None = None
    frame_id: str = ""
    stamp_s: float = 0.0
    shape: tuple[int, ...] = ()
    places: NDArray[np.int64] | None = None
    viewpoint: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        if self.places is None and self.shape and math.prod(self.shape) != len(self.positions):
            raise ValueError(f"{len(self.positions)} points do not fill a cloud of {self.shape}")

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def is_organised(self) -> bool:
        """Whether the points lie on a grid (h, w) of more than one row."""
        return len(self.shape) == 2 and min(self.shape) > 1

    def spread(self, values: NDArray[T], fill: float) -> NDArray[T]:
        """Return values (n, ...) of the points in the cloud's own shape, ``fill`` where missing.

        Examples
        --------
        >>> cloud = Cloud(np.ones((1, 3), np.float32), shape=(2, 2), places=np.array([2]))
        >>> cloud.spread(np.array([7]), 0).tolist()
        [[0, 0], [7, 0]]
        """
        shape = self.shape or (len(self.positions),)
        if self.places is None:
            return values.reshape(*shape, *values.shape[1:])
        whole = np.full((math.prod(shape), *values.shape[1:]), fill, values.dtype)
        whole[self.places] = values
        return whole.reshape(*shape, *values.shape[1:])

    def grid(self) -> tuple[NDArray[np.float32], UInt8Array | None]:
        """Return points (..., 3), m, NaN where missing, and colours in the cloud's own shape."""
        colours = None if self.colours is None else self.spread(self.colours, 0)
        return self.spread(self.positions, np.nan), colours

    def points(self) -> NDArray[np.float32]:
        """Return the positions (n, 3), m; the same name as an organised frame has."""
        return self.positions
