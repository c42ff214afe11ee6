"""An unorganised cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["Cloud"]


@dataclass(frozen=True)
class Cloud:
    """Points without pixels.

    Parameters
    ----------
    positions : (n, 3) float32, m
        Finite.
    colours : (n, 3) uint8, RGB, or None
    frame_id
        Name of the frame the points are in (tf).
    stamp_s
        Time of capture, s since the epoch.
    """

    positions: NDArray[np.float32]
    colours: UInt8Array | None = None
    frame_id: str = ""
    stamp_s: float = 0.0

    def __len__(self) -> int:
        return len(self.positions)

    def points(self) -> NDArray[np.float32]:
        """Return the positions (n, 3), m; the same name as an organised frame has."""
        return self.positions
