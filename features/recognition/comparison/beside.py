"""Another stored thing in the same picture, beside the one that comes first.

Where nobody says where the object is, two things side by side are one query, of which recognition
names one. The print of the other agrees as well, but in another part of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import Alignment
from features.recognition.index.snapshot import StoredView
from features.recognition.views.view import ViewFeatures

__all__ = ["BesideParams", "place_beside"]


@dataclass(frozen=True)
class BesideParams:
    """Constants of what counts as another thing.

    Parameters
    ----------
    min_places
        Different places of the other thing whose votes survive the ratio rule: print that it shares
        with the first gives none.
    min_matches
        Matches with a view of either that agree on one map.
    max_shared
        Share of either's matches that may lie where the other's stored view is seen.
    """

    min_places: int = 4
    min_matches: int = 12
    max_shared: float = 0.1


def place_beside(
    query: ViewFeatures,
    first: tuple[Alignment, StoredView],
    other: tuple[Alignment, StoredView],
    params: BesideParams | None = None,
) -> str:
    """Return where another thing is seen, from the first one; empty if in the same place.

    Parameters
    ----------
    first, other
        A stored view of each, and how it lies over the query.

    Returns
    -------
    str
        "to the left", "to the right", "above" or "below".
    """
    params = params or BesideParams()
    if len(other[0]) < params.min_matches:
        return ""
    here, there = (query.keypoints[alignment.query_rows, :2] for alignment, _ in (first, other))
    # Siblings agree in print of their own, too: what they cover tells them from a neighbour.
    for places, (alignment, view) in ((there, first), (here, other)):
        outline = _outline(alignment, view)
        if outline is None or _share_inside(places, outline) > params.max_shared:
            return ""
    right, down = np.median(there, axis=0) - np.median(here, axis=0)
    if abs(right) >= abs(down):
        return "to the right" if right > 0 else "to the left"
    return "below" if down > 0 else "above"


def _outline(alignment: Alignment, view: StoredView) -> NDArray[np.float32] | None:
    """Return the hull (n, 1, 2), px, of a view's keypoints in the query; None past the horizon."""
    hull = cv2.convexHull(np.ascontiguousarray(view.keypoints[:, :2], np.float32)).reshape(-1, 2)
    flat = np.column_stack([hull, np.ones(len(hull))]) @ alignment.query_from_view.T
    if flat[:, 2].min() <= 0.1 * np.median(flat[:, 2]):
        return None
    mapped = (flat[:, :2] / flat[:, 2:]).astype(np.float32)
    return np.asarray(cv2.convexHull(mapped.reshape(-1, 1, 2)), np.float32)


def _share_inside(places: NDArray[np.float32], outline: NDArray[np.float32]) -> float:
    inside = [
        cv2.pointPolygonTest(outline, (float(x), float(y)), False) >= 0 for x, y in places.tolist()
    ]
    return float(np.mean(inside))
