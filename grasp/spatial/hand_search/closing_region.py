"""Features of the part of a cloud that lies between the fingers, and of where the hand stands.

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
from grasp.spatial.hand_search.closing_kernel import sum_between
from grasp.spatial.scoring.features import FEATURES, body_of, with_features

__all__ = ["HOG_LENGTH", "PICTURE", "STATISTICS", "closing_regions", "closing_statistics", "hog"]


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
    "offset",
    "height",
    "approach",
    "alignment",
    "near_left",
    "near_right",
    "clearance",
    "completed",
    "elongation",
    "flatness",
    "size",
)
"""The features of :func:`closing_regions`: logarithms of counts and mean heights of the points in
thirds of the width; shares whose normals oppose the jaws or face the palm; share that was
completed; width, depth and height over the table on the scale of the hand; how much the normals
differ; cosine between approach and view ray; and of :data:`grasp.spatial.scoring.features.FEATURES`
those that take no score: where the grasp is on the object, what is near each contact, how the
object is shaped."""

_FIRST_PLACED = FEATURES.index("offset")
_LEFT, _RIGHT = STATISTICS.index("near_left"), STATISTICS.index("near_right")

_CELL_M = 0.001
_SLICE_M = 0.004
_COS = float(np.cos(np.deg2rad(20.0)))
_SCALE_M = 0.1
_BINS, _SIDE, _WINDOW = 9, 8, 64


def closing_regions(
    cloud: SurfaceCloud, candidates: Sequence[GraspCandidate], gripper: ParallelGripper
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Measure what lies between the fingers of each candidate, and draw it.

    Parameters
    ----------
    cloud
        On which the candidates were found, its completed points included.

    Returns
    -------
    (n, 26) float32
        See :data:`STATISTICS`.
    (n, 80, 100) bool
        Which cells hold a point that was seen, first row at the first surface, closing axis
        turned away from the camera.
    """
    pictures = np.zeros((len(candidates), *PICTURE), bool)
    seen = cloud.points[cloud.target & ~cloud.completed]
    for k, candidate in enumerate(candidates):
        pose = candidate.frame_from_gripper
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        near = np.abs(local[:, 1]) < gripper.finger_width / 2 + _SLICE_M
        near &= np.abs(local[:, 0]) < (candidate.opening or gripper.max_opening) / 2
        pictures[k] = _picture(local[near] * (_turned(cloud, pose), 1.0, 1.0))
    return closing_statistics(cloud, candidates, gripper), pictures


def closing_statistics(
    cloud: SurfaceCloud, candidates: Sequence[GraspCandidate], gripper: ParallelGripper
) -> NDArray[np.float32]:
    """Return the statistics (n, 26) of :func:`closing_regions` without its pictures."""
    if len(candidates) == 0:
        return np.zeros((0, len(STATISTICS)), np.float32)
    low, high = gripper.fingertip - gripper.finger_length, gripper.fingertip
    poses = np.stack([candidate.frame_from_gripper for candidate in candidates])
    signs = np.array([_turned(cloud, pose) for pose in poses])
    widths = np.array([candidate.width for candidate in candidates])
    openings = np.array([candidate.opening or gripper.max_opening for candidate in candidates])
    boxes = np.empty((len(candidates), 5))
    boxes[:, 0], boxes[:, 1] = openings / 2, gripper.finger_width / 2 + _SLICE_M
    boxes[:, 2:4], boxes[:, 4] = (low, high), widths / 6
    of = cloud.target
    sums = sum_between(
        cloud.points[of], cloud.normals[of], cloud.completed[of], poses, signs, boxes, _COS
    )
    count = np.maximum(sums[:, :1], 1.0)
    # As many points as there would be at the usual distance between them.
    scale = (cloud.voxel / REFERENCE_VOXEL_M) ** 2
    parts, heights = sums[:, 1:4], sums[:, 4:7]
    heights = (heights / np.maximum(parts, 1.0) - low) / gripper.finger_length
    table = np.zeros(len(candidates))
    if cloud.table is not None:
        table = (
            np.stack([candidate.centre for candidate in candidates]) @ cloud.table[:3]
            + cloud.table[3]
        )
    rays = np.stack([_view_ray(cloud, pose[:3, 3]) for pose in poses])
    between = np.column_stack(
        [
            np.log1p(scale * parts),
            np.where(parts > 0, heights, 0.0),
            sums[:, 7:11] / count,
            widths / gripper.max_opening,
            np.array([candidate.depth for candidate in candidates]) / gripper.finger_length,
            table / _SCALE_M,
            1.0 - np.linalg.norm(sums[:, 11:], axis=1) / count[:, 0],
            np.einsum("ni,ni->n", poses[:, :3, 2], rays),
        ]
    )
    statistics = np.hstack([between, _placed(cloud, candidates, gripper)])
    turned = signs < 0
    statistics[turned, _LEFT], statistics[turned, _RIGHT] = (
        statistics[turned, _RIGHT],
        statistics[turned, _LEFT],
    )
    return statistics.astype(np.float32)


def _placed(
    cloud: SurfaceCloud, candidates: Sequence[GraspCandidate], gripper: ParallelGripper
) -> FloatArray:
    """Return the features (n, 11) of where each grasp is on the object."""
    body, support = body_of(cloud.points[cloud.target]), cloud.support
    rows = [with_features(candidate, body, gripper, support).features for candidate in candidates]
    return np.array([row[_FIRST_PLACED:] for row in rows if row is not None])


def _turned(cloud: SurfaceCloud, pose: FloatArray) -> float:
    """Return -1 where the closing axis looks at the camera, else 1.

    Seen from the camera the same grasp of two equal jaws looks the same either way round.
    """
    return -1.0 if pose[:3, 0] @ _view_ray(cloud, pose[:3, 3]) < 0 else 1.0


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
    histograms = []
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
        histograms.append(blocks.reshape(len(image), -1))
    return np.concatenate(histograms, axis=1)


def _view_ray(cloud: SurfaceCloud, at: FloatArray) -> FloatArray:
    if len(cloud.viewpoints) == 0:
        return np.zeros(3)
    ray = at - cloud.viewpoints[0]
    return np.asarray(ray / max(float(np.linalg.norm(ray)), 1e-9))


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
