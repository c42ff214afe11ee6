"""Features of a candidate for learners: fourteen dimensionless numbers in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support
from grasp.spatial.gripper import ParallelGripper

__all__ = ["FEATURES", "Body", "body_of", "with_features"]


FEATURES = (
    "confidence", "epsilon", "width", "offset", "height", "approach", "alignment",
    "support_left", "support_right", "clearance", "completed", "elongation", "flatness", "size",
)  # fmt: skip
"""Names of the features.

width and size over the stroke; offset: |centre - centroid| / size; height: of the centre over the
centroid, signed, over the object's; approach: angle to straight down / pi; alignment: closing axis
to the longest axis / (pi / 2); support: log(1 + points near a jaw) / 5; clearance / 2 cm, at most
1; elongation and flatness: 1 - middle and 1 - least extent over the longest.
"""

_NEAR_M = 0.01
_CLEAR_M = 0.02


@dataclass(frozen=True, eq=False)
class Body:
    """The size of an object.

    Parameters
    ----------
    centroid : (3,), m
    axes : (3, 3)
        Principal axes as columns, the longest first.
    lengths : (3,), m
        Extents along them.
    points : (n, 3), m
        Of the surface.
    """

    centroid: FloatArray
    axes: FloatArray
    lengths: FloatArray
    points: FloatArray

    @cached_property
    def _heights(self) -> dict[tuple[float, ...], float]:
        return {}

    def height(self, up: FloatArray) -> float:
        """Return the extent along ``up`` (3,), m; kept for the next candidate."""
        key = tuple(up.tolist())
        if key not in self._heights:
            self._heights[key] = float(np.ptp(self.points @ up))
        return self._heights[key]

    @cached_property
    def tree(self) -> cKDTree:
        """Of the points, for those near a jaw."""
        return cKDTree(self.points)


def body_of(points: FloatArray) -> Body:
    """Return the size of what a cloud (n, 3), m, or the samples of a mesh show."""
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ValueError(f"points have shape (n >= 1, 3), got {points.shape}")
    centroid = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - centroid).T @ (points - centroid))
    axes = axes[:, ::-1]
    return Body(centroid, axes, np.ptp((points - centroid) @ axes, axis=0), points)


def with_features(
    candidate: GraspCandidate,
    body: Body,
    gripper: ParallelGripper,
    support: Support | None = None,
) -> GraspCandidate:
    """Return the candidate with its features (14,).

    Parameters
    ----------
    support
        Says where up is; None = z of the candidate's frame.
    """
    up = np.array([0.0, 0.0, 1.0]) if support is None else support.up
    size = max(float(body.lengths.max()), 1e-6)
    height = max(body.height(up), 1e-6)
    offset = candidate.centre - body.centroid
    down = np.clip(-candidate.approach @ up, -1.0, 1.0)
    along = np.clip(abs(candidate.closing @ body.axes[:, 0]), 0.0, 1.0)
    left = right = 0
    if candidate.contacts is not None:
        near = body.tree.query_ball_point(candidate.contacts[:2], _NEAR_M, return_length=True)
        left, right = int(near[0]), int(near[1])
    longest, middle, least = np.maximum(body.lengths, 1e-6)
    features = np.array(
        [
            candidate.scores.get("confidence", 0.0),
            candidate.scores.get("epsilon", 0.0),
            candidate.width / gripper.max_opening,
            np.linalg.norm(offset) / size,
            offset @ up / height,
            np.arccos(down) / np.pi,
            np.arccos(along) / (np.pi / 2),
            np.log1p(left) / 5,
            np.log1p(right) / 5,
            min(candidate.scores.get("clearance", 0.0) / _CLEAR_M, 1.0),
            float(candidate.completed),
            1 - middle / longest,
            1 - least / longest,
            size / gripper.max_opening,
        ]
    )
    return replace(candidate, features=features)
