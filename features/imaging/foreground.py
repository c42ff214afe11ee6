"""The object in a photograph that has neither depth nor mask (GrabCut, Rother et al. 2004)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.imaging.masks import box_mask

__all__ = ["find_foreground"]

_WORK_PX = 160
"""Longer side of the picture that is cut; twice that takes four times as long and is no better."""
_ROUNDS = 4
_MARGIN = 0.06
_SURE = 0.3
"""Share of both sides about the middle that surely is the object: one points the camera at it."""
_LIKELY = 0.8
"""Width of the ellipse that may be the object, in widths of the picture."""
_SPECK_PX, _BRIDGE_PX = 3, 9
"""Smaller things are noise; narrower ones, in a picture without a box, lead to other things."""
_MIN_SHARE, _MIN_SHARE_OF_MIDDLE, _MAX_SHARE = 0.05, 0.12, 0.98


def find_foreground(rgb: UInt8Array, box: Sequence[float] | None = None) -> NDArray[np.bool_]:
    """Return the mask (h, w) of the object that a photograph is about.

    Colours of the background are learned from what lies outside the box. Where nobody drew one, the
    object is taken to be in the middle of the picture, as what is held before a camera is, and to
    be convex. Where it cannot be told from the background, the whole box is returned: recognition
    copes with background better than with half an object.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
    box
        [left, top, width, height] px around the object; None = the image without a margin of 6 %.

    Raises
    ------
    CloudFormatError
        When the box lies outside the image.

    Examples
    --------
    >>> scene = np.random.default_rng(0).integers(90, 110, (120, 160, 3)).astype(np.uint8)
    >>> scene[30:90, 50:110] = (200, 40, 30)
    >>> mask = find_foreground(scene)
    >>> bool(mask[60, 80]), bool(mask[10, 80]), abs(int(mask.sum()) - 3600) < 200
    (True, False, True)
    """
    height, width = rgb.shape[:2]
    is_drawn = box is not None
    if box is None:
        box = (_MARGIN * width, _MARGIN * height, (1 - 2 * _MARGIN) * width,
               (1 - 2 * _MARGIN) * height)  # fmt: skip
    inside = box_mask(box, (height, width))
    scale = min(1.0, _WORK_PX / max(height, width))
    size = (max(round(width * scale), 8), max(round(height * scale), 8))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    within = cv2.resize(inside.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    foreground = _cut(np.ascontiguousarray(small[..., ::-1]), within, is_drawn)
    if foreground is None:
        return inside
    whole = cv2.resize(foreground.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR)
    mask: NDArray[np.bool_] = (whole > 0) & inside
    return mask


def _cut(bgr: UInt8Array, within: NDArray[np.bool_], is_drawn: bool) -> NDArray[np.bool_] | None:
    """Return the largest foreground inside a box, filled; None where there is no telling."""
    if within.all() or not within.any():
        return None
    marks = np.where(within, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    if not is_drawn:
        _mark_middle(marks, within)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)  # the mixtures start from random clusters
    try:
        cv2.grabCut(bgr, marks, (0, 0, 1, 1), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    except cv2.error:
        return None  # one colour everywhere gives no mixture
    foreground = ((marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)).astype(np.uint8)
    for step, size in (
        (cv2.MORPH_CLOSE, _SPECK_PX),
        (cv2.MORPH_OPEN, _SPECK_PX if is_drawn else _BRIDGE_PX),
    ):
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        foreground = cv2.morphologyEx(foreground, step, kernel)
    outlines, _ = cv2.findContours(foreground, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    outline = max(outlines, key=cv2.contourArea)
    if not is_drawn:
        outline = cv2.convexHull(outline)
    filled = cv2.drawContours(np.zeros_like(foreground), [outline], -1, 1, cv2.FILLED) > 0
    share = float(filled[within].mean())
    least = _MIN_SHARE if is_drawn else _MIN_SHARE_OF_MIDDLE
    return filled & within if least <= share <= _MAX_SHARE else None


def _mark_middle(marks: NDArray[np.uint8], within: NDArray[np.bool_]) -> None:
    """Mark the middle of a picture as the object, and its left and right sides as hardly so."""
    left, top, wide, high = cv2.boundingRect(within.astype(np.uint8))
    down, across = np.mgrid[: within.shape[0], : within.shape[1]]
    x, y = (across - left) / (wide / 2) - 1, (down - top) / (high / 2) - 1
    marks[within & ((x / _LIKELY) ** 2 + y**2 > 1)] = cv2.GC_PR_BGD
    marks[within & (np.abs(x) < _SURE) & (np.abs(y) < _SURE)] = cv2.GC_FGD
