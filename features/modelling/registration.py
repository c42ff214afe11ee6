"""Registration of a view with the model of its object.

Points slide along a smooth surface, and a view of a round thing turns freely on its model: what the
data leave open, the movement as it was told decides (a Gaussian prior on it, Thrun et al. 2005, 3).
Without it the errors of views add up to several degrees; with it they stay those of the telling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from features.geometry import Frame, finite_depth
from features.modelling.fusion import smoothed
from features.pose.visibility import check_free_space

__all__ = [
    "DEPTH_NOISE_M",
    "INDEPENDENT_POINTS",
    "Registration",
    "Surface",
    "drift",
    "prior_weights",
    "registered",
    "turned_and_shifted",
]

_MAX_SAMPLES, _MAX_LAID = 3000, 1500
_CUTS_M = np.geomspace(0.008, 0.003, 10)
_MIN_FACING = 0.5
_ESTIMATED = 1 / np.array([np.deg2rad(2.0)] * 3 + [0.010] * 3) ** 2
_MEASURED = 1 / np.array([np.deg2rad(1.5)] * 3 + [0.003] * 3) ** 2
"""Prior weights: of an estimate, about the object's middle; of a measurement, about the camera."""
DEPTH_NOISE_M, INDEPENDENT_POINTS = 0.002, 200
"""How many of a view's points err independently: neighbours share their error."""
_OVERLAP_M, _MIN_OVERLAP = 0.004, 0.35
_MAX_DRIFT_M, _MAX_DRIFT_RAD = 0.015, np.deg2rad(12.0)
_MAX_DEVIATION = 4.7
"""Of a measured movement, in standard deviations: one right measurement in a thousand is beyond."""
_MAX_VIOLATION, _MIN_JUDGED = 0.12, 0.25


@dataclass(frozen=True, eq=False)
class Registration:
    """Result of registering a view with the model.

    Parameters
    ----------
    object_from_camera : (4, 4) float64, m
    how
        ``first``, ``given``, ``keypoints`` or ``shape``.
    overlap
        Share of the view's points that lay on the model already.
    violation
        Share of the model's visible side that the view contradicts.
    """

    object_from_camera: NDArray[np.float64]
    how: str
    overlap: float
    violation: float = 0.0


class Surface:
    """Target of the registration: the smoothed cloud (n, 6), at most 3,000 of its points."""

    def __init__(self, cloud: NDArray[np.float32], weights: NDArray[np.float32]) -> None:
        rows = smoothed(cloud, weights, _MAX_SAMPLES)
        self.places, self.normals = rows[:, :3], rows[:, 3:]
        self.tree = cKDTree(self.places)
        self.centre = (self.places.min(axis=0) + self.places.max(axis=0)) / 2
        nearest = self.tree.query(self.places[::5], k=2)[0][:, 1]
        # Of points strewn at random, the nearest is half the square root of the area of each away.
        self.spacing_m = float(2 * nearest.mean())


def registered(
    surface: Surface,
    frame: Frame,
    oriented: NDArray[np.float64],
    object_from_camera: NDArray[np.float64],
    how: str,
    is_measured: bool = False,
) -> Registration | None:
    """Improve a movement, and refuse it when it drifts off or view and model contradict.

    Parameters
    ----------
    frame
        Depth outside its mask says where the object is not.
    oriented : (n, 6) float64
        The view's places (m, camera) and normals.
    object_from_camera : (4, 4) float64
        As it is known so far.
    how
        From where.
    is_measured
        It holds within about 1.5 degrees and 3 mm whatever the view shows: it need not show
        anything known, and what hides known surface is taken for a side not seen before.
    """
    rng = np.random.default_rng(0)
    # A fixed draw: the same view must be registered alike when a model is made again.
    few = oriented[np.sort(rng.permutation(len(oriented))[:_MAX_LAID])]
    prior_pose = np.asarray(object_from_camera, np.float64)
    # What is uncertain of a measurement is the camera, of an estimate the object.
    pivot = prior_pose[:3, 3] if is_measured else surface.centre
    pose = _laid_on(surface, few, prior_pose, pivot, prior_weights(is_measured))
    away, _ = surface.tree.query(few[:, :3] @ pose[:3, :3].T + pose[:3, 3])
    overlap = float((away < _OVERLAP_M + surface.spacing_m).mean())
    if _is_far_off(drift(pose, prior_pose, pivot), is_measured):
        return None
    if overlap < _MIN_OVERLAP and not is_measured:
        return None
    violation = _violation(surface, frame, pose, not is_measured)
    return None if violation > _MAX_VIOLATION else Registration(pose, how, overlap, violation)


def _is_far_off(away: NDArray[np.float64], is_measured: bool) -> bool:
    """Tell whether a movement (6,), turn and shift, leads too far from what was told.

    A measurement is off about its camera: a turn of one degree there, which is nothing unusual,
    shifts an object half a metre away by nine millimetres.
    """
    if is_measured:
        return float(np.sqrt(prior_weights(is_measured) @ away**2)) > _MAX_DEVIATION
    turned, moved = np.linalg.norm(away.reshape(2, 3), axis=1)
    return bool(moved > _MAX_DRIFT_M or turned > _MAX_DRIFT_RAD)


def _laid_on(
    surface: Surface,
    few: NDArray[np.float64],
    prior_pose: NDArray[np.float64],
    pivot: NDArray[np.float64],
    prior: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the most probable movement (4, 4), given the points and what was told.

    Point-to-plane ICP, the allowed distance falling; a step turns about the pivot and shifts it,
    and ``prior`` (6,) weighs turns and shifts away from what was told.
    """
    pose = prior_pose
    # Weighed as 1,500 independent points, a view would outweigh any prior.
    trust = INDEPENDENT_POINTS / len(few) / DEPTH_NOISE_M**2
    for cut in _CUTS_M.tolist():
        places = few[:, :3] @ pose[:3, :3].T + pose[:3, 3]
        away, rows = surface.tree.query(places)
        normals = surface.normals[rows]
        facing = np.einsum("ni,ni->n", few[:, 3:] @ pose[:3, :3].T, normals)
        weight = trust * np.where(facing > _MIN_FACING, facing, 0) / (1 + (away / cut) ** 2) ** 2
        across = np.einsum("ni,ni->n", places - surface.places[rows], normals)
        lever = np.hstack([np.cross(places - pivot, normals), normals])
        weighted = (lever * weight[:, None]).T
        step = np.linalg.solve(
            weighted @ lever + np.diag(prior),
            -weighted @ across - prior * drift(pose, prior_pose, pivot),
        )
        pose = turned_and_shifted(pose, step, pivot)
    return pose


def prior_weights(is_measured: bool) -> NDArray[np.float64]:
    """Return the weights (6,) of turns and shifts away from a movement as it was told."""
    return _MEASURED if is_measured else _ESTIMATED


def turned_and_shifted(
    pose: NDArray[np.float64], step: NDArray[np.float64], pivot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a movement after a turn about a pivot and a shift, a step of (6,)."""
    change = np.eye(4)
    change[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
    change[:3, 3] = pivot + step[3:] - change[:3, :3] @ pivot
    return change @ pose


def drift(
    pose: NDArray[np.float64], prior_pose: NDArray[np.float64], pivot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return turn (rotation vector) and shift of the pivot from one movement to the other, (6,)."""
    change = pose @ np.linalg.inv(prior_pose)
    turn = Rotation.from_matrix(change[:3, :3]).as_rotvec()
    return np.concatenate([turn, change[:3, :3] @ pivot + change[:3, 3] - pivot])


def _violation(
    surface: Surface, frame: Frame, object_from_camera: NDArray[np.float64], counts_hidden: bool
) -> float:
    """Return the share of the model's visible side that a view contradicts.

    It looked through it or, where ``counts_hidden``, the object's own surface lies in front. Of a
    shell seen from behind only a ragged rim shows, which says little: the share is one of a
    quarter of the surface at least.
    """
    pose = np.linalg.inv(object_from_camera)
    lens = frame.intrinsics
    own = frame.object_mask() & (frame.depth_m > 0) & counts_hidden
    sight = check_free_space(
        np.hstack([surface.places - surface.centre, surface.normals]).astype(np.float32),
        np.ascontiguousarray(pose[None, :3, :3]),
        (pose[:3, :3] @ surface.centre + pose[:3, 3])[None],
        finite_depth(frame.depth_m),
        own,
        (lens.fx, lens.fy, lens.cx - frame.x0, lens.cy - frame.y0),
        surface.spacing_m,
    )
    judged = max(float(sight.agreeing[0] + sight.violating[0]), _MIN_JUDGED * len(surface.places))
    return float(sight.violating[0]) / judged
