"""The principal axes of view and posed model in the image (Kehoe 2014, 4.6).

A pose whose silhouette points elsewhere than what was measured is wrong. On objects that others
hide in part the axes of right poses differ as well, so the check is not part of the search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.pose.model import PoseModel

__all__ = ["AxisCheck", "axis_check"]

_CELL_PX = 4.0
_CELL_SPACINGS = 2.5
_OCCLUSION_M = 0.008
_MIN_POINTS = 10


@dataclass(frozen=True)
class AxisCheck:
    """Comparison of the major axes of view and model.

    Parameters
    ----------
    angle_rad
        Between them, 0..pi/2.
    ratio
        Length of the longer axis over the shorter one, the less of view and model: what is round
        in the image has no axis.
    applies
        Both are long enough to compare.
    passes
        Nothing speaks against the pose.
    """

    angle_rad: float
    ratio: float
    applies: bool
    passes: bool


def axis_check(
    model: PoseModel,
    frame: Frame,
    camera_from_object: NDArray[np.float64],
    max_rad: float = np.pi / 10,
    min_ratio: float = 1.6,
) -> AxisCheck:
    """Compare the principal axes of the measured object and of the posed model.

    Parameters
    ----------
    model
        Of the object.
    frame
        Its mask, or its depth, says which pixels are the object.
    camera_from_object : (4, 4) float64, m
    max_rad
        Kehoe's bound, pi/10.
    min_ratio
        Below, either axis is no axis and the check passes.

    Returns
    -------
    AxisCheck
        Does not apply with fewer than 10 pixels or visible samples.
    """
    rows, columns = np.nonzero(frame.object_mask() & (frame.depth_m > 0))
    seen = np.column_stack([columns, rows]).astype(np.float64)
    expected = _visible_px(model, frame, np.asarray(camera_from_object, np.float64))
    if min(len(seen), len(expected)) < _MIN_POINTS:
        return AxisCheck(0.0, 1.0, applies=False, passes=True)
    (here, ratio_here), (there, ratio_there) = _major_axis(seen), _major_axis(expected)
    angle = float(np.arccos(np.clip(abs(here @ there), 0.0, 1.0)))
    ratio = min(ratio_here, ratio_there)
    applies = ratio >= min_ratio
    return AxisCheck(angle, ratio, applies, not applies or angle <= max_rad)


def _major_axis(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return direction (2,) and ratio of axes of the second moments of points (n, 2)."""
    values, vectors = np.linalg.eigh(np.cov(points.T))
    return vectors[:, 1], float(np.sqrt(values[1] / max(values[0], 1e-12)))


def _visible_px(model: PoseModel, frame: Frame, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pixels (n, 2) of the samples that the camera should see."""
    samples = model.samples.astype(np.float64)
    places = (samples[:, :3] + model.centre) @ pose[:3, :3].T + pose[:3, 3]
    facing = np.einsum("ni,ni->n", samples[:, 3:] @ pose[:3, :3].T, places) < 0
    places = places[facing & (places[:, 2] > 0.01)]
    if len(places) == 0:
        return np.empty((0, 2))
    lens, depth = frame.intrinsics, places[:, 2]
    pixels = places[:, :2] / depth[:, None] * (lens.fx, lens.fy)
    pixels += (lens.cx - frame.x0, lens.cy - frame.y0)
    cell = max(_CELL_PX, _CELL_SPACINGS * model.spacing_m * lens.fx / float(depth.min()))
    keys = np.floor(pixels / cell).astype(np.int64)
    _, number = np.unique(keys, axis=0, return_inverse=True)
    number = number.ravel()
    front = np.full(number.max() + 1, np.inf)
    np.minimum.at(front, number, depth)
    visible = depth < front[number] + _OCCLUSION_M
    at = np.floor(pixels + 0.5).astype(np.int64)
    height, width = frame.depth_m.shape
    visible &= (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
    pixels, depth, at = pixels[visible], depth[visible], at[visible]
    measured = frame.depth_m[at[:, 1], at[:, 0]]
    # What something else stands in front of was not measured as this object either.
    free: NDArray[np.float64] = pixels[~((measured > 0) & (measured < depth - _OCCLUSION_M))]
    return free
