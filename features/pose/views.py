"""The pose of an object without a model: one stored view stands for it.

Matched keypoints carry the stored view into the new one (Kehoe 2014, 4.3); laying its points on
those of the new view makes the movement exact, and free space says whether it can be true.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import Frame, finite_depth
from features.pose.confidence import PoseConfidence
from features.pose.result import PoseEstimate
from features.pose.rotations import rotation_about
from features.pose.search import ScenePoints, scene_points
from features.pose.visibility import Sight, check_free_space

__all__ = ["estimate_pose_from_views"]

_MIN_POINTS = 30
_MAX_POINTS = 1200
_CUTS_M = np.geomspace(0.008, 0.003, 10)
_SIGMA_M = 0.003
_EXPLAINED_M = 0.008
_MAX_TURN_RAD = 0.2


@dataclass(frozen=True, eq=False)
class _Cloud:
    """Points with normals, and what is nearest."""

    points: ScenePoints
    tree: cKDTree


def estimate_pose_from_views(
    stored: Frame,
    seen: Frame,
    seen_from_stored: NDArray[np.float64],
) -> PoseEstimate | None:
    """Improve the movement between two views of one object, and say how sure it is.

    What rests on one view is as sure as :attr:`PoseConfidence.max_from_view` at most.

    Parameters
    ----------
    stored, seen
        Both with depth; their masks say which pixels are the object.
    seen_from_stored : (4, 4) float64, m
        Of the stored camera's frame in the new one's, as matched keypoints gave it; good within
        about 8 mm. The views should not differ by more than 40 degrees.

    Returns
    -------
    PoseEstimate or None
        ``camera_from_object`` is the improved ``seen_from_stored``: the stored camera's frame is
        the object's. None when one of the views has fewer than 30 points.
    """
    constants = PoseConfidence()
    there, here = _cloud(stored), _cloud(seen)
    if there is None or here is None:
        return None
    movement = _laid_on(there, here.points, np.asarray(seen_from_stored, np.float64))
    away, across, facing = _met(there, here.points, movement)
    # Only what the stored view saw can be on it: the rest of the new view neither helps nor harms.
    shared = away < 2 * _EXPLAINED_M
    distance = 0.7 * np.abs(across) + 0.3 * away
    score = np.exp(-(distance**2) / (2 * _SIGMA_M**2)) * (0.3 + 0.7 * np.maximum(facing, 0))
    fit = float(score[shared].mean()) if shared.any() else 0.0
    sight = _sight(there.points, seen, movement)
    explained = float((away < _EXPLAINED_M).mean())
    sure = min(constants.of(fit, float(sight.violation[0]), explained), constants.max_from_view)
    return PoseEstimate(
        camera_from_object=movement,
        confidence=sure,
        accepted=sure >= constants.threshold,
        fit=fit,
        violation=float(sight.violation[0]),
        coverage=float(sight.coverage[0]),
        explained=explained,
        alternatives=(),
        ambiguous=False,
        symmetric_axes=np.empty((0, 3)),
        segments_used=(1,),
    )


def _cloud(frame: Frame) -> _Cloud | None:
    points = scene_points(
        frame.points()[frame.object_mask()], _MAX_POINTS, np.inf, np.random.default_rng(0)
    )
    return None if len(points) < _MIN_POINTS else _Cloud(points, cKDTree(points.places))


def _met(
    there: _Cloud, here: ScenePoints, movement: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Return distance, distance along the normal, and likeness of normals, each (n,).

    Of each new point to the nearest stored one, in the stored camera's frame.
    """
    back = np.linalg.inv(movement)
    places = here.places @ back[:3, :3].T + back[:3, 3]
    normals = here.normals @ back[:3, :3].T
    away, rows = there.tree.query(places)
    error = places - there.points.places[rows]
    across = np.einsum("ni,ni->n", error, there.points.normals[rows])
    facing = np.einsum("ni,ni->n", normals, there.points.normals[rows])
    return away, across, facing


def _laid_on(
    there: _Cloud, here: ScenePoints, movement: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the movement improved by point-to-plane ICP, the allowed distance falling."""
    for cut in _CUTS_M.tolist():
        back = np.linalg.inv(movement)
        places = here.places @ back[:3, :3].T + back[:3, 3]
        away, rows = there.tree.query(places)
        normals = there.points.normals[rows]
        turned = here.normals @ back[:3, :3].T
        weight = (1 + (away / cut) ** 2) ** -2.0
        weight *= np.maximum(np.einsum("ni,ni->n", turned, normals), 0.05)
        residual = np.einsum("ni,ni->n", places - there.points.places[rows], normals)
        lever = np.hstack([np.cross(places, normals), normals])
        left = (lever * weight[:, None]).T @ lever
        left += 1e-6 * np.trace(left) * np.eye(6)
        step = np.linalg.solve(left, -(lever * weight[:, None]).T @ residual)
        angle = min(float(np.linalg.norm(step[:3])), _MAX_TURN_RAD)
        change = np.eye(4)
        if angle > 1e-12:
            change[:3, :3] = rotation_about(step[:3] / np.linalg.norm(step[:3]), angle)
        change[:3, 3] = step[3:]
        movement = np.linalg.inv(change @ back)
    return movement


def _sight(there: ScenePoints, seen: Frame, movement: NDArray[np.float64]) -> Sight:
    nearest = cKDTree(there.places).query(there.places, k=2)[0][:, 1]
    middle = there.places.mean(axis=0)
    lens = seen.intrinsics
    return check_free_space(
        np.hstack([there.places - middle, there.normals]).astype(np.float32),
        movement[None, :3, :3].copy(),
        (movement[:3, :3] @ middle + movement[:3, 3])[None],
        finite_depth(seen.depth_m),
        seen.object_mask() & (seen.depth_m > 0),
        (lens.fx, lens.fy, lens.cx - seen.x0, lens.cy - seen.y0),
        float(2 * nearest.mean()),
    )
