"""Errors of a pose (Kehoe 2014, 4.5), modulo the symmetry of its object."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.pose.model import PoseModel
from features.pose.rotations import angle_between
from features.pose.surface import surface_distance

__all__ = ["PoseError", "pose_error"]


@dataclass(frozen=True)
class PoseError:
    """Error of an estimated pose.

    Parameters
    ----------
    translation_m
        Between the two places of the box's centre.
    rotation_rad, raw_rotation_rad
        Angle modulo symmetry, and plain.
    add_m, add_s_m
        Mean distance of corresponding samples, and of each true one to the nearest estimated.
    surface_m
        Distance beyond which a hundredth of one surface lies from the other; small for any turn
        of an orange, and large for a mug with its handle elsewhere.
    """

    translation_m: float
    rotation_rad: float
    raw_rotation_rad: float
    add_m: float
    add_s_m: float
    surface_m: float

    def is_within(self, metres: float = 0.005, degrees: float = 5.0) -> bool:
        """Tell whether both errors, modulo symmetry, are below a bound."""
        return self.translation_m < metres and self.rotation_rad < math.radians(degrees)


def pose_error(
    model: PoseModel, estimated: NDArray[np.float64], true: NDArray[np.float64]
) -> PoseError:
    """Compare two poses ``camera_from_object`` (4, 4).

    Examples
    --------
    >>> from features.pose.model import build_pose_model
    >>> rng = np.random.default_rng(0)
    >>> ball = rng.normal(size=(4000, 3)); ball /= np.linalg.norm(ball, axis=1)[:, None]
    >>> model = build_pose_model(0.03 * ball, normals=ball)
    >>> turned = np.diag([1.0, -1.0, -1.0, 1.0])
    >>> pose_error(model, turned, np.eye(4)).is_within()
    True
    """
    centres = [pose[:3, :3] @ model.centre + pose[:3, 3] for pose in (estimated, true)]
    raw = angle_between(true[:3, :3], estimated[:3, :3])
    turned = angle_between(true[:3, :3], estimated[:3, :3], model.symmetries)
    if len(model.symmetric_axes) > 1:
        turned = 0.0  # a ball: every turn leaves it as it is
    places = model.samples[::3, :3].astype(np.float64)
    here, there = (
        places @ pose[:3, :3].T + centre
        for pose, centre in zip((estimated, true), centres, strict=True)
    )
    return PoseError(
        float(np.linalg.norm(centres[0] - centres[1])),
        turned,
        raw,
        float(np.linalg.norm(here - there, axis=1).mean()),
        float(cKDTree(here).query(there)[0].mean()),
        surface_distance(model, estimated, true),
    )
