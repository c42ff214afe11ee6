"""Things too thin for the prism: patches of another colour that lie a little above the table.

A knife or a card rises less over the table than the prism's floor, where the sensor's noise is. Its
colour shows where it ends; the mean height of so many pixels over the table around it tells it from
a stain, a shadow or a print on the table.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.segmentation.prism import Prism

__all__ = ["add_thin_objects"]

_MIN_COLOUR, _MAX_COLOUR = 10.0, 20.0
_DEVIATIONS = 4.0
_SHRINK, _TABLE_SHRINK = 2, 4
_BLUR_PX = 15
_BESIDE_PX, _RING_PX = 5, 8
_MIN_RING_PX = 40
_RISE_M = 0.0015
_MIN_SURE = 4.0
_NOISE_PX = 6
_MAX_SHARE = 0.2
_SAMPLED = 7


def add_thin_objects(
    points: NDArray[np.floating[Any]],
    colours: NDArray[np.uint8],
    labels: NDArray[np.int32],
    prism: Prism,
    height_m: float,
    min_points: int,
) -> NDArray[np.int32]:
    """Return the labels with those of thin things, numbered after the others.

    Parameters
    ----------
    points : (h, w, 3) float, m
    colours : (h, w, 3) uint8 RGB
    labels : (h, w) int32
    height_m
        Floor of the prism.
    min_points
        Smaller patches are dropped.
    """
    every = (slice(None, None, _SHRINK), slice(None, None, _SHRINK))
    heights, labelled = prism.heights[every], labels[every]
    with np.errstate(invalid="ignore"):
        flat = (np.abs(heights) < height_m) & (labelled == 0)
    least = max(min_points // _SHRINK**2, 1)
    if np.count_nonzero(flat) < 10 * least:
        return labels
    small = cv2.resize(colours, labelled.shape[::-1], interpolation=cv2.INTER_AREA)
    differs = flat & _differs(np.asarray(small, dtype=np.uint8), flat)
    kernel = np.ones((3, 3), np.uint8)
    clean = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    count, patches, boxes, _ = cv2.connectedComponentsWithStats(clean, connectivity=8)
    if count == 1:
        return labels
    taken = cv2.dilate((labelled > 0).astype(np.uint8), np.ones((_BESIDE_PX, _BESIDE_PX), np.uint8))
    beside = np.bincount(patches[taken > 0], minlength=count)
    thin = np.zeros(count, np.int32)
    for number in range(1, count):
        size = int(boxes[number, cv2.CC_STAT_AREA])
        if size < least or size > _MAX_SHARE * flat.sum() or beside[number] > 0.1 * size:
            continue
        window = _window(boxes[number], labelled.shape)
        patch = patches[window] == number
        places = points[every][window][patch]
        if np.median(prism.distance_to_edge(places)) < 0:
            continue
        if _rises(heights[window], patch, flat[window] & (patches[window] == 0), height_m):
            thin[number] = int(labels.max()) + 1 + np.count_nonzero(thin)
    if not thin.any():
        return labels
    whole = thin[patches].repeat(_SHRINK, axis=0).repeat(_SHRINK, axis=1)
    whole = whole[: labels.shape[0], : labels.shape[1]]
    with np.errstate(invalid="ignore"):
        free = (np.abs(prism.heights) < height_m) & (labels == 0)
    return np.where(free, whole, labels).astype(np.int32)


def _differs(colours: NDArray[np.uint8], flat: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where the colour (CIELab) is not that of the table around."""
    lab = np.asarray(cv2.cvtColor(colours, cv2.COLOR_RGB2Lab), dtype=np.float32)
    use = flat.astype(np.float32)
    away: NDArray[Any] = np.zeros(flat.shape, np.float32)
    least = _MAX_COLOUR
    for _ in range(2):  # the second time without what stood out the first
        table = _around(lab, use)
        apart = cv2.absdiff(lab, table)
        away = np.asarray(
            cv2.sqrt(cv2.transform(cv2.multiply(apart, apart), np.ones((1, 3), np.float32)))
        )
        usual = float(np.median(away[use > 0][::_SAMPLED])) if use.any() else 0.0
        least = float(np.clip(_DEVIATIONS * usual, _MIN_COLOUR, _MAX_COLOUR))
        use = (flat & (away < least)).astype(np.float32)
    return np.asarray(away >= least)


def _around(lab: NDArray[np.float32], use: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean colour (h, w, 3) of the pixels to use around each pixel."""
    height, width = use.shape
    small = (max(width // _TABLE_SHRINK, 1), max(height // _TABLE_SHRINK, 1))
    weight = cv2.resize(use, small, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(cv2.multiply(lab, cv2.merge([use] * 3)), small, interpolation=cv2.INTER_AREA)
    size = (_BLUR_PX, _BLUR_PX)
    weight, mean = cv2.blur(weight, size), cv2.blur(mean, size)
    whole = cv2.resize(mean / np.maximum(weight, 1e-6)[..., None], (width, height))
    return np.asarray(whole, dtype=np.float32)


def _window(box: NDArray[Any], shape: tuple[int, ...]) -> tuple[slice, slice]:
    left, top, width, height = (int(n) for n in box[:4])
    reach = _BESIDE_PX + _RING_PX
    return (
        slice(max(top - reach, 0), min(top + height + reach, shape[0])),
        slice(max(left - reach, 0), min(left + width + reach, shape[1])),
    )


def _rises(
    heights: NDArray[np.float64], patch: NDArray[np.bool_], others: NDArray[np.bool_], most_m: float
) -> bool:
    """Tell whether a patch lies above the table around it by more than noise."""
    near = cv2.dilate(patch.astype(np.uint8), np.ones((_BESIDE_PX, _BESIDE_PX), np.uint8))
    far = cv2.dilate(near, np.ones((2 * _RING_PX + 1, 2 * _RING_PX + 1), np.uint8))
    ring = heights[others & (far > 0) & (near == 0)]
    core = cv2.erode(patch.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mine = heights[core]
    if len(ring) < _MIN_RING_PX or len(mine) < _NOISE_PX:
        return False
    rise = float(np.median(mine) - np.median(ring))
    spread = 1.4826 * float(np.median(np.abs(ring - np.median(ring))))
    # Noise of a depth camera is alike over patches of some pixels.
    doubt = spread / np.sqrt(max(len(mine) / _NOISE_PX, 1.0))
    return rise > max(_RISE_M, _MIN_SURE * doubt) and rise < most_m
