"""Alignment of two views by their own keypoints, whatever else is stored.

The votes of the index depend on rivals: a descriptor that many products share votes for none. As
evidence a match must mean the same in any store, so the views that were voted for are matched
again, one against one, by Lowe's rule inside the view (Lowe 2004, 7.1) in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.index.nearest import nearest_both_ways
from features.recognition.verify import AffineFit, VerifyParams, fit_affine

__all__ = ["Alignment", "AlignmentParams", "Keypoints", "align_views", "mutual_matches"]


class Keypoints(Protocol):
    """The part of a view that alignment needs: places (n, 4) and descriptors (n, 128)."""

    @property
    def keypoints(self) -> NDArray[np.float32]:
        """x, y, diameter in px, angle in degrees."""

    @property
    def descriptors(self) -> UInt8Array:
        """RootSIFT."""


@dataclass(frozen=True)
class AlignmentParams:
    """Constants of the alignment.

    Parameters
    ----------
    distance_cap
        Squared distance of RootSIFT beyond which nothing matches: (0.6 * 512)**2.
    ratio
        Lowe's ratio, on squared distances, inside the view.
    min_inliers
        Fewer matches that agree are no evidence.
    affine_tolerance, draw_tolerance, tolerance
        Of the longer side of the object: of the matches near the affine map from which a
        homography is drawn, of its random draws, and of its final inliers.
    fallback_tolerance
        Of the affine map where no homography holds.
    min_homography_matches
        Fewer matches fit any homography.
    min_agreeing
        Share of the affine map's inliers that the homography has to keep.
    max_perspective
        Ratio of the projective denominators at the inliers: more is no view of a flat print.
    """

    distance_cap: int = 94372
    ratio: float = 0.72
    min_inliers: int = 6
    affine_tolerance: float = 0.12
    draw_tolerance: float = 0.0145
    tolerance: float = 0.02
    fallback_tolerance: float = 0.03
    min_homography_matches: int = 8
    min_agreeing: float = 0.6
    max_perspective: float = 2.5


@dataclass(frozen=True, eq=False)
class Alignment:
    """A map of a stored view's image into the query's, and the matches that agree with it.

    Parameters
    ----------
    query_from_view : (3, 3) float64, px
    query_rows, view_rows : (n,) intp
        Keypoints of the two views that agree.
    error
        Root mean square residual, of the longer side of the object in the query.
    """

    query_from_view: NDArray[np.float64]
    query_rows: NDArray[np.intp]
    view_rows: NDArray[np.intp]
    error: float

    def __len__(self) -> int:
        """Return the number of matches that agree."""
        return len(self.query_rows)


def align_views(
    query: Keypoints, view: Keypoints, side_px: float, params: AlignmentParams | None = None
) -> Alignment | None:
    """Find the map of a stored view's image into the query's.

    Parameters
    ----------
    query, view
        Keypoints and descriptors of the two.
    side_px
        Longer side of the object in the query image.

    Returns
    -------
    Alignment or None
        None when fewer than ``min_inliers`` matches agree on one map. A mirror image is never
        proposed: the turn and the size of a keypoint fix a similarity, which has no reflection.
    """
    params = params or AlignmentParams()
    rows, columns = mutual_matches(query.descriptors, view.descriptors, params)
    if len(rows) < params.min_inliers:
        return None
    here, there = query.keypoints[rows], view.keypoints[columns]
    affine = fit_affine(here, there, side_px, VerifyParams())
    if affine is None:
        return None
    matrix = np.vstack([affine.query_from_view, [[0.0, 0.0, 1.0]]])
    agreed = affine.inliers
    agreed = agreed & (_residuals(matrix, here, there) < params.fallback_tolerance * side_px)
    mapping = _homography(here, there, side_px, affine, params)
    if mapping is not None:
        matrix, agreed = mapping
    if np.count_nonzero(agreed) < params.min_inliers:
        return None
    residual = _residuals(matrix, here[agreed], there[agreed])
    error = float(np.sqrt(np.mean(residual**2))) / side_px
    return Alignment(matrix, rows[agreed], columns[agreed], error)


def mutual_matches(
    query: UInt8Array, view: UInt8Array, params: AlignmentParams | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of mutual nearest neighbours that pass cap and ratio."""
    params = params or AlignmentParams()
    nothing = np.empty(0, np.intp)
    if len(query) < 2 or len(view) < 2:
        return nothing, nothing
    best, best_back, nearest, second = nearest_both_ways(query, view)
    rows = np.flatnonzero(nearest < params.distance_cap)
    rows = rows[best_back[best[rows]] == rows]
    rows = rows[nearest[rows] < params.ratio * second[rows]]
    return rows, best[rows]


def _homography(
    here: NDArray[np.float32],
    there: NDArray[np.float32],
    side_px: float,
    affine: AffineFit,
    params: AlignmentParams,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
    """Return the homography near the affine map and its inliers; None where none is sound."""
    guess = np.vstack([affine.query_from_view, [[0.0, 0.0, 1.0]]])
    near = np.flatnonzero(_residuals(guess, here, there) < params.affine_tolerance * side_px)
    if len(near) < params.min_homography_matches:
        return None
    # OpenCV's draws start from the same state in every call: the same matches, the same map.
    matrix, _ = cv2.findHomography(
        there[near, None, :2], here[near, None, :2], cv2.USAC_MAGSAC,
        params.draw_tolerance * side_px, maxIters=300, confidence=0.99,
    )  # fmt: skip
    if matrix is None or not np.isfinite(matrix).all() or abs(matrix[2, 2]) < 1e-12:
        return None
    matrix = np.asarray(matrix, np.float64) / matrix[2, 2]
    agreed = np.zeros(len(here), bool)
    agreed[near] = _residuals(matrix, here[near], there[near]) < params.tolerance * side_px
    if np.count_nonzero(agreed) < params.min_agreeing * np.count_nonzero(affine.inliers):
        return None
    denominators = there[agreed, :2] @ matrix[2, :2] + 1.0
    if len(denominators) == 0 or denominators.min() <= 0:
        return None
    if np.linalg.det(matrix) <= 0:
        return None
    if denominators.max() >= params.max_perspective * denominators.min():
        return None
    return matrix, agreed


def _residuals(
    matrix: NDArray[np.float64], here: NDArray[np.float32], there: NDArray[np.float32]
) -> NDArray[np.float64]:
    moved = there[:, :2].astype(np.float64) @ matrix[:2, :2].T + matrix[:2, 2]
    moved = (
        moved
        / np.where(
            np.abs(weight := there[:, :2] @ matrix[2, :2] + matrix[2, 2]) < 1e-9, 1e-9, weight
        )[:, None]
    )
    distances: NDArray[np.float64] = np.linalg.norm(moved - here[:, :2], axis=1)
    return distances
