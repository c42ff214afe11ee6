"""Matches between two views, one by one: for pictures, and for joining views into one model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import AlignmentParams, align_views, mutual_matches
from features.recognition.rigid import fit_rigid
from features.recognition.verify import VerifyParams, fit_affine
from features.recognition.views.view import ViewFeatures

__all__ = ["PairMatches", "counted_matches", "match_views"]

_STRICT = AlignmentParams(distance_cap=65536)


@dataclass(frozen=True, eq=False)
class PairMatches:
    """Matched keypoints of two views.

    Parameters
    ----------
    first, second : (n,) intp
        Rows of each view's keypoints.
    agreed : (n,) bool
        Those that follow one movement.
    first_from_second : (4, 4) float64 or None, m
        The movement in space of the second camera's frame into the first's, where both have depth.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    agreed: NDArray[np.bool_]
    first_from_second: NDArray[np.float64] | None


def match_views(
    first: ViewFeatures, second: ViewFeatures, params: VerifyParams | None = None
) -> PairMatches:
    """Match two views by Lowe's rule in both directions, and verify the matches.

    Examples
    --------
    >>> from features.recognition.views.view import describe_view
    >>> rng = np.random.default_rng(0)
    >>> spots = (rng.random((12, 12)).repeat(10, axis=0).repeat(10, axis=1) * 255).astype(np.uint8)
    >>> view = describe_view(spots, np.ones(spots.shape, bool))
    >>> bool(match_views(view, view).agreed.sum() >= 4)
    True
    """
    rows, columns = mutual_matches(first.descriptors, second.descriptors, _STRICT)
    fit = fit_affine(first.keypoints[rows], second.keypoints[columns], first.side_px, params)
    if fit is None:
        return PairMatches(rows, columns, np.zeros(len(rows), bool), None)
    agreed, movement = fit.inliers, None
    solid = np.isfinite(first.points3d[rows]).all(axis=1)
    solid &= np.isfinite(second.points3d[columns]).all(axis=1)
    chosen = np.flatnonzero(agreed & solid)
    rigid = fit_rigid(
        first.points3d[rows[chosen]], second.points3d[columns[chosen]], first.size_m, params
    )
    if rigid is not None:
        movement = rigid.query_from_view
    return PairMatches(rows, columns, agreed, movement)


def counted_matches(query: ViewFeatures, view: ViewFeatures) -> PairMatches:
    """Return the matches of a query with a stored view; those that agree are the ones counted.

    The same as recognition finds: ``agreed`` counts :attr:`Match.inliers`.
    """
    rows, columns = mutual_matches(query.descriptors, view.descriptors)
    alignment = align_views(query, view, query.side_px)
    counted = np.empty(0, np.intp) if alignment is None else alignment.query_rows
    return PairMatches(rows, columns, np.isin(rows, counted), None)
