"""Pictures of runs as files."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["png"]


def png(rgb: NDArray[np.uint8]) -> bytes:
    """Return an image (h, w, 3) RGB as PNG."""
    return bytes(cv2.imencode(".png", np.ascontiguousarray(rgb[..., ::-1]))[1])
