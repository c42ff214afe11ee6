"""Improve the movements of all views of a model together.

A view that joins a model is laid on what is known by then. Views of opposite sides meet nowhere:
until others come between them, only what was told says how they stand to each other, and an error
of one degree at half a metre is nine millimetres. Once others have come, all are therefore moved
until they lie on each other (simultaneous registration, Neugebauer 1997).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from features.modelling.registration import (
    DEPTH_NOISE_M,
    INDEPENDENT_POINTS,
    drift,
    prior_weights,
    turned_and_shifted,
)
from features.modelling.scans import Scan

__all__ = ["settled"]

_POINTS = 300
_CUTS_M = np.geomspace(0.008, 0.004, 3)
_REACH = 2.5
_MIN_MET = 15
_MIN_FACING = 0.5

Pose = NDArray[np.float64]


def settled(scans: Sequence[Scan], poses: Sequence[Pose]) -> list[Pose]:
    """Return the most probable movements, given how the scans lie on each other and what was told.

    The first movement gives the object's frame and stays. Point-to-plane ICP over all pairs of
    scans, the allowed distance falling; what the points leave open, the prior of each scan decides
    (see :mod:`features.modelling.registration`).

    Parameters
    ----------
    scans
        Of one object.
    poses
        ``object_from_camera`` (4, 4) of each, m.
    """
    moved = [np.asarray(pose, np.float64) for pose in poses]
    rng = np.random.default_rng(0)
    few = [np.sort(rng.permutation(len(scan))[:_POINTS]) for scan in scans]
    priors = [prior_weights(scan.is_measured) for scan in scans]
    for cut in _CUTS_M.tolist():
        left = np.zeros((len(scans), 6, len(scans), 6))
        right = np.zeros((len(scans), 6))
        for a, scan in enumerate(scans):
            here = scan.moved(moved[a])[few[a]]
            for b, other in enumerate(scans):
                if a != b:
                    _lay(left, right, (a, b), here, other, moved[b], cut, scans)
            left[a, :, a] += np.diag(priors[a])
            right[a] += priors[a] * drift(moved[a], scan.prior_pose, scan.pivot)
        # The first scan is left out of the system: without one that stays, all could move together.
        size = 6 * (len(scans) - 1)
        steps = np.linalg.solve(left[1:, :, 1:].reshape(size, size), -right[1:].ravel())
        for k, step in enumerate(steps.astype(np.float64).reshape(-1, 6), start=1):
            moved[k] = turned_and_shifted(moved[k], step, scans[k].pivot)
    return moved


def _lay(
    left: NDArray[np.float64],
    right: NDArray[np.float64],
    pair: tuple[int, int],
    here: NDArray[np.float64],
    other: Scan,
    pose: Pose,
    cut: float,
    scans: Sequence[Scan],
) -> None:
    """Add to the normal equations that points of the first scan of a pair lie on the second."""
    back = np.linalg.inv(pose)
    seen = here[:, :3] @ back[:3, :3].T + back[:3, 3]
    away, rows = other.tree.query(seen, distance_upper_bound=_REACH * cut)
    met = np.flatnonzero(np.isfinite(away))
    # Scans of opposite sides meet at a rim only, whose few pairs would turn them at will.
    if len(met) < _MIN_MET:
        return
    there = other.rows[rows[met]].astype(np.float64)
    normals, places = there[:, 3:] @ pose[:3, :3].T, here[met, :3]
    facing = np.einsum("ni,ni->n", here[met, 3:], normals)
    # Each pair is met twice, once from either side.
    trust = INDEPENDENT_POINTS / len(here) / DEPTH_NOISE_M**2 / 2
    weight = trust * np.where(facing > _MIN_FACING, facing, 0) / (1 + (away[met] / cut) ** 2) ** 2
    gap = places - (there[:, :3] @ pose[:3, :3].T + pose[:3, 3])
    across = np.einsum("ni,ni->n", gap, normals)
    levers = [
        sign * np.hstack([np.cross(places - scans[k].pivot, normals), normals])
        for k, sign in zip(pair, (1.0, -1.0), strict=True)
    ]
    for k, lever in zip(pair, levers, strict=True):
        weighted = (lever * weight[:, None]).T
        right[k] += weighted @ across
        for j, beside in zip(pair, levers, strict=True):
            left[k, :, j] += weighted @ beside
