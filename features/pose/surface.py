"""How far apart two poses of one object put its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.pose.model import PoseModel

__all__ = ["SAME_SURFACE_M", "surface_distance"]

SAME_SURFACE_M = 0.004
"""Surfaces this close are one to a hand, and nearly so to a depth camera at arm's length."""
_SHARE = 0.99
"""Of the samples; a handle or a stem is more than a hundredth of a surface, a spike of a scan is
not."""
_EVERY = 3


def surface_distance(
    model: PoseModel, first: NDArray[np.float64], second: NDArray[np.float64]
) -> float:
    """Return the distance in m beyond which hardly any of the surface differs between two poses.

    ADD-S takes the mean, to which a handle on the wrong side adds little; the distance here is that
    of the 99th percentile, so that a mug turned by half is far from itself and an orange is not.

    Parameters
    ----------
    model
        Of the object.
    first, second : (4, 4) float64
        Poses ``camera_from_object``.

    Examples
    --------
    >>> from features.pose.model import build_pose_model
    >>> rng = np.random.default_rng(0)
    >>> ball = rng.normal(size=(4000, 3)); ball /= np.linalg.norm(ball, axis=1)[:, None]
    >>> egg = build_pose_model(0.03 * ball * [1, 1, 1.4], normals=ball)
    >>> quarter_z = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    >>> quarter_x = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    >>> surface_distance(egg, np.eye(4), quarter_z) < SAME_SURFACE_M
    True
    >>> surface_distance(egg, np.eye(4), quarter_x) > SAME_SURFACE_M
    True
    """
    relative = np.linalg.inv(first) @ second
    worst = 0.0
    # Both ways: what sticks out of one of them alone lies far from the other, not the reverse.
    for movement in (relative, np.linalg.inv(relative)):
        turn = movement[:3, :3]
        shift = turn @ model.centre + movement[:3, 3] - model.centre
        places = model.samples[::_EVERY, :3] @ turn.T + shift
        _, nearest = model.tree.query(places)
        off = places - model.samples[nearest, :3]
        # Between samples the surface is nearer than they are; mostly along the normal, then.
        along = np.abs(np.einsum("ni,ni->n", off, model.samples[nearest, 3:]))
        away = 0.7 * along + 0.3 * np.linalg.norm(off, axis=1)
        worst = max(worst, float(np.quantile(away, _SHARE)))
    return worst
