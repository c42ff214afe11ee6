"""SIFT keypoints of one object's crop, described as RootSIFT (Lowe 2004; Gatto 2016, 2.7)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["SiftParams", "detect_keypoints", "root_sift"]

ROOT_SIFT_SCALE = 512.0


@dataclass(frozen=True)
class SiftParams:
    """Parameters of the keypoint detection on an object's crop.

    Parameters
    ----------
    contrast
        Lowe's contrast threshold; 0.04, OpenCV's default, starves small crops.
    max_keypoints
        The strongest by response are kept.
    min_side_px, max_side_px
        The crop is resized until the longer side of the mask's box lies between the two: small
        objects carry most of their print in the finest octaves, large ones cost time.
    margin_px
        Context around the mask's box, px of the given image.
    """

    contrast: float = 0.02
    max_keypoints: int = 600
    min_side_px: int = 240
    max_side_px: int = 640
    margin_px: int = 12


def root_sift(descriptors: NDArray[np.float32]) -> UInt8Array:
    """Return the square roots of L1-normalised descriptors, times 512, as uint8.

    The Euclidean distance of the result is the Hellinger distance of the histograms, which the
    few large bins no longer dominate (Arandjelovic and Zisserman 2012).

    Parameters
    ----------
    descriptors : (n, 128) float32

    Returns
    -------
    (n, 128) uint8

    Examples
    --------
    >>> root_sift(np.full((1, 128), 7, np.float32))[0, :3].tolist()
    [45, 45, 45]
    """
    sums = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)
    scaled = np.sqrt(descriptors / sums) * ROOT_SIFT_SCALE
    rooted: UInt8Array = np.clip(scaled, 0, 255).astype(np.uint8)
    return rooted


def detect_keypoints(
    grey: UInt8Array, mask: NDArray[np.bool_], params: SiftParams | None = None
) -> tuple[NDArray[np.float32], UInt8Array]:
    """Find and describe the keypoints of the object under a mask.

    Parameters
    ----------
    grey : (h, w) uint8
    mask : (h, w) bool
        Not empty.

    Returns
    -------
    keypoints : (n, 4) float32
        x, y (px of ``grey``), size (px, diameter), angle (degrees, image axes).
    descriptors : (n, 128) uint8
        RootSIFT. Both empty, of the right shapes, when nothing was found.
    """
    params = params or SiftParams()
    rows, columns = np.nonzero(mask)
    top = max(int(rows.min()) - params.margin_px, 0)
    left = max(int(columns.min()) - params.margin_px, 0)
    bottom, right = (
        int(rows.max()) + params.margin_px + 1,
        int(columns.max()) + params.margin_px + 1,
    )
    crop = grey[top:bottom, left:right]
    crop_mask: UInt8Array = mask[top:bottom, left:right].astype(np.uint8)

    crop = continue_outwards(crop, crop_mask)
    side = max(int(np.ptp(rows)), int(np.ptp(columns))) + 1
    scale = float(np.clip(side, params.min_side_px, params.max_side_px)) / side
    if scale != 1.0:
        size = (round(crop.shape[1] * scale), round(crop.shape[0] * scale))
        way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        crop = np.asarray(cv2.resize(crop, size, interpolation=way), dtype=np.uint8)
        crop_mask = np.asarray(cv2.resize(crop_mask, size, interpolation=cv2.INTER_NEAREST))
    detected, raw = cv2.SIFT.create(contrastThreshold=params.contrast).detectAndCompute(
        crop, crop_mask
    )
    if raw is None or len(detected) == 0:
        return np.empty((0, 4), np.float32), np.empty((0, 128), np.uint8)
    order = np.argsort([-k.response for k in detected], kind="stable")[: params.max_keypoints]
    keypoints = np.array(
        [(*detected[i].pt, detected[i].size, detected[i].angle) for i in order], dtype=np.float32
    )
    # Resizing maps pixel centres: x_small = (x_large + 1/2) / scale - 1/2.
    keypoints[:, :2] = (keypoints[:, :2] + 0.5) / scale - 0.5 + (left, top)
    keypoints[:, 2] /= scale
    return keypoints, root_sift(np.asarray(raw, dtype=np.float32)[order])


def continue_outwards(grey: UInt8Array, mask: NDArray[np.uint8]) -> UInt8Array:
    """Give every pixel outside the object the grey value of the nearest one well inside.

    A descriptor looks far beyond its keypoint. Without this, what stands behind or beside an
    object is described with it, and found again beside another.

    Parameters
    ----------
    grey : (h, w) uint8
    mask : (h, w) uint8, 1 = object
    """
    inside = np.asarray(cv2.erode(mask, np.ones((3, 3), np.uint8)))
    if not inside.any():
        return grey
    _, nearest = cv2.distanceTransformWithLabels(
        1 - inside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    value = np.zeros(int(nearest.max()) + 1, np.uint8)
    value[nearest[inside > 0]] = grey[inside > 0]
    filled: UInt8Array = np.where(inside > 0, grey, value[nearest])
    return filled
