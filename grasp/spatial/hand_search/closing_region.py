"""Features of the part of a cloud that lies between the fingers.

The picture and its gradients after ten Pas and Platt 2015, 5; histograms of oriented gradients
after Dalal and Triggs 2005; the statistics are our own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.clouds.cloud import SurfaceCloud
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.antipodal import REFERENCE_VOXEL_M

__all__ = ["HOG_LENGTH", "PICTURE", "STATISTICS", "closing_regions", "hog"]


PICTURE = (80, 100)
"""Rows along the approach and columns along the closing direction, cells of 1 mm."""

HOG_LENGTH = 3528
"""Two windows of 7 x 7 blocks of four cells with nine bins."""

STATISTICS = (
    "count_left",
    "count_middle",
    "count_right",
    "height_left",
    "height_middle",
    "height_right",
    "opposing_left",
    "opposing_right",
    "facing",
    "hidden",
    "width",
    "depth",
    "over_table",
    "curvature",
    "view",
)
"""The features of :func:`closing_regions`: logarithms of counts and mean heights of the points in
thirds of the width; shares whose normals oppose the jaws or face the palm; share that was
completed; width, depth and height over the table on the scale of the hand; how much the normals
differ; cosine between approach and view ray."""

_CELL_M = 0.001
_SLICE_M = 0.004
_COS = float(np.cos(np.deg2rad(20.0)))
_SCALE_M = 0.1
_BINS, _SIDE, _WINDOW = 9, 8, 64


def closing_regions(
    cloud: SurfaceCloud, candidates: Sequence[GraspCandidate], gripper: ParallelGripper
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Measure what lies between the fingers of each candidate.

    Parameters
    ----------
    cloud
        On which the candidates were found, its completed points included.

    Returns
    -------
    (n, 15) float32
        See :data:`STATISTICS`.
    (n, 80, 100) bool
        Which cells hold a point that was seen, first row at the first surface, closing axis
        turned away from the camera.
    """
    statistics = np.zeros((len(candidates), len(STATISTICS)), np.float32)
    pictures = np.zeros((len(candidates), *PICTURE), bool)
    points = cloud.points[cloud.target]
    normals = cloud.normals[cloud.target]
    completed = cloud.completed[cloud.target]
    for k, candidate in enumerate(candidates):
        pose = candidate.frame_from_gripper
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        near = np.abs(local[:, 1]) < gripper.finger_width / 2 + _SLICE_M
        near &= np.abs(local[:, 0]) < (candidate.opening or gripper.max_opening) / 2
        # Seen from the camera the same grasp of two equal jaws looks the same either way round.
        ray = _view_ray(cloud, pose[:3, 3])
        sign = -1.0 if pose[:3, 0] @ ray < 0 else 1.0
        along = normals[near] @ pose[:3, :3] * (sign, 1.0, 1.0)
        region = local[near] * (sign, 1.0, 1.0)
        statistics[k] = _statistics(
            cloud, region, along, completed[near], candidate, gripper, float(pose[:3, 2] @ ray)
        )
        pictures[k] = _picture(region[~completed[near]])
    return statistics, pictures


def hog(pictures: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return histograms of oriented gradients (n, 3528) of pictures (n, 80, 100).

    Windows of 64 x 64 cells at a stride of 32, unsigned gradients in 9 bins over 8 x 8 cells,
    blocks of 2 x 2 cells normalised, cut at .2 and normalised again.

    >>> hog(np.zeros((1, 80, 100), bool)).shape
    (1, 3528)
    """
    image = pictures.astype(np.float32)
    dx, dy = np.zeros_like(image), np.zeros_like(image)
    dx[:, :, 1:-1] = image[:, :, 2:] - image[:, :, :-2]
    dy[:, 1:-1] = image[:, 2:] - image[:, :-2]
    strength = np.hypot(dx, dy)
    place = np.mod(np.arctan2(dy, dx), np.pi) * (_BINS / np.pi) - 0.5
    lower = np.floor(place)
    share = (place - lower).astype(np.float32)
    found = []
    for left in (0, _WINDOW // 2):
        window = np.s_[:, :_WINDOW, left : left + _WINDOW]
        cells = np.zeros((len(image), _SIDE, _SIDE, _BINS), np.float32)
        for bins, weight in ((lower, 1 - share), (lower + 1, share)):
            index = np.mod(bins[window], _BINS).astype(np.int64)
            part = (strength * weight)[window]
            for b in range(_BINS):
                votes = np.where(index == b, part, 0.0)
                cells[..., b] += votes.reshape(-1, _SIDE, 8, _SIDE, 8).sum(axis=(2, 4))
        blocks = np.concatenate(
            [cells[:, :-1, :-1], cells[:, :-1, 1:], cells[:, 1:, :-1], cells[:, 1:, 1:]], axis=-1
        )
        blocks /= np.linalg.norm(blocks, axis=-1, keepdims=True) + 1e-3
        blocks = np.minimum(blocks, 0.2)
        blocks /= np.linalg.norm(blocks, axis=-1, keepdims=True) + 1e-3
        found.append(blocks.reshape(len(image), -1))
    return np.concatenate(found, axis=1)


def _view_ray(cloud: SurfaceCloud, at: FloatArray) -> FloatArray:
    if len(cloud.viewpoints) == 0:
        return np.zeros(3)
    ray = at - cloud.viewpoints[0]
    return np.asarray(ray / max(float(np.linalg.norm(ray)), 1e-9))


def _statistics(
    cloud: SurfaceCloud,
    region: FloatArray,
    along: FloatArray,
    completed: NDArray[np.bool_],
    candidate: GraspCandidate,
    gripper: ParallelGripper,
    view: float,
) -> FloatArray:
    low, high = gripper.fingertip - gripper.finger_length, gripper.fingertip
    inside = (region[:, 2] > low) & (region[:, 2] < high)
    region, along, completed = region[inside], along[inside], completed[inside]
    count = max(len(region), 1)
    third = candidate.width / 6
    parts = (
        region[:, 0] < -third,
        np.abs(region[:, 0]) <= third,
        region[:, 0] > third,
    )
    # As many points as there would be at the usual distance between them.
    scale = (cloud.voxel / REFERENCE_VOXEL_M) ** 2
    counts = [np.log1p(scale * part.sum()) for part in parts]
    heights = [
        float(region[part, 2].mean() - low) / gripper.finger_length if part.any() else 0.0
        for part in parts
    ]
    table = 0.0
    if cloud.table is not None:
        table = float(candidate.centre @ cloud.table[:3] + cloud.table[3])
    return np.array(
        [
            *counts,
            *heights,
            np.sum(along[:, 0] < -_COS) / count,
            np.sum(along[:, 0] > _COS) / count,
            np.sum(along[:, 2] < -_COS) / count,
            completed.sum() / count,
            candidate.width / gripper.max_opening,
            candidate.depth / gripper.finger_length,
            table / _SCALE_M,
            1.0 - float(np.linalg.norm(along.sum(axis=0))) / count,
            view,
        ]
    )


def _picture(region: FloatArray) -> NDArray[np.bool_]:
    rows, columns = PICTURE
    picture = np.zeros(PICTURE, bool)
    if len(region) == 0:
        return picture
    column = np.floor(region[:, 0] / _CELL_M).astype(np.int64) + columns // 2
    row = np.floor((region[:, 2] - region[:, 2].min()) / _CELL_M).astype(np.int64)
    # A voxel is three cells wide.
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            r, c = row + dr, column + dc
            within = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
            picture[r[within], c[within]] = True
    return picture
