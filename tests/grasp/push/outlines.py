"""Outlines with curves, drawn by as many vertices as are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def ellipse(count: int, height: float = 0.6) -> Floats:
    """Return an ellipse with half axes 1 and ``height``, (count, 2)."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([np.cos(angle), height * np.sin(angle)])


def plate(count: int, radius: float = 0.3) -> Floats:
    """Return a plate of 2.6 x 1.6 with rounded corners of ``count`` vertices each, (4 count, 2)."""
    corners = []
    for x, y, first in ((1.0, 0.5, 0.0), (-1.0, 0.5, 0.5), (-1.0, -0.5, 1.0), (1.0, -0.5, 1.5)):
        angle = np.pi * np.linspace(first, first + 0.5, count)
        corners.append(np.column_stack([np.cos(angle), np.sin(angle)]) * radius + (x, y))
    return np.vstack(corners)


def stadium(count: int) -> Floats:
    """Return two half circles of radius .6 joined by straight sides of length 2, (2 count, 2)."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, count)
    end = np.column_stack([1 + 0.6 * np.cos(angle), 0.6 * np.sin(angle)])
    return np.vstack([end, -end])


def pebble(count: int) -> Floats:
    """Return an outline that is round at its ends and hollow at its sides, (count, 2)."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    distance = 1 + 0.25 * np.cos(2 * angle) + 0.12 * np.cos(3 * angle + 0.5)
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])
