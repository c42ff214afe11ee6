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
_CLOSE_PX = 3
_MIN_SHARE, _MAX_SHARE = 0.05, 0.98


def find_foreground(rgb: UInt8Array, box: Sequence[float] | None = None) -> NDArray[np.bool_]:
    """Return the mask (h, w) of the object that a photograph is about.

    Colours of the background are learned from what lies outside the box. Where the object cannot
    be told from it, the whole box is returned: recognition copes with background better than with
    half an object.

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
    if box is None:
        box = (_MARGIN * width, _MARGIN * height, (1 - 2 * _MARGIN) * width,
               (1 - 2 * _MARGIN) * height)  # fmt: skip
    inside = box_mask(box, (height, width))
    scale = min(1.0, _WORK_PX / max(height, width))
    size = (max(round(width * scale), 8), max(round(height * scale), 8))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    within = cv2.resize(inside.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    found = _cut(np.ascontiguousarray(small[..., ::-1]), within)
    if found is None:
        return inside
    whole = cv2.resize(found.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR)
    mask: NDArray[np.bool_] = (whole > 0) & inside
    return mask


def _cut(bgr: UInt8Array, within: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Return the largest foreground inside a box, holes filled; None where there is no telling."""
    if within.all() or not within.any():
        return None
    marks = np.where(within, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)  # the mixtures start from random clusters
    try:
        cv2.grabCut(bgr, marks, (0, 0, 1, 1), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    except cv2.error:
        return None  # one colour everywhere gives no mixture
    found = ((marks == cv2.GC_FGD) | (marks == cv2.GC_PR_FGD)).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_CLOSE_PX, _CLOSE_PX))
    found = cv2.morphologyEx(
        cv2.morphologyEx(found, cv2.MORPH_CLOSE, kernel), cv2.MORPH_OPEN, kernel
    )
    outlines, _ = cv2.findContours(found, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not outlines:
        return None
    filled = np.zeros_like(found)
    cv2.drawContours(filled, [max(outlines, key=cv2.contourArea)], -1, 1, cv2.FILLED)
    share = float(filled[within].mean())
    return filled > 0 if _MIN_SHARE <= share <= _MAX_SHARE else None
