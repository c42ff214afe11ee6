"""Scores of a grasp under errors of the pose, the same for every kind of hand but jaws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.push.quality import lower_bound
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.scoring.confidence import PoseNoise

__all__ = ["Judged", "scored_under_errors"]

_SLOPE, _MOST = 4, 1e3

Judged = tuple[NDArray[np.bool_], Mapping[str, FloatArray]]
"""Which poses (n,) close or seal, and by score what its load asks of each, (n,): the hand holds
below 1."""


def scored_under_errors(
    candidate: GraspCandidate,
    noise: PoseNoise,
    samples: int,
    seed: int,
    judge: Callable[[FloatArray], Judged],
) -> GraspCandidate:
    """Return a candidate with its confidence, its 95 % bound, and the chance to bear each load.

    A pose that closes bears a load with the chance 1 / (1 + a^4), a = what is asked of it;
    ``holding`` is the mean over the loads.

    Parameters
    ----------
    noise, samples, seed
        Errors of the pose, the same for all candidates.
    judge
        Of poses (n, 4, 4), ``object_from_gripper``.
    """
    errors = noise.transforms(samples, seed)
    pose = candidate.frame_from_gripper
    good, loads = judge(pose @ errors if noise.covariance is None else errors @ pose)
    scores = {
        "confidence": float(good.mean()),
        "lower_95": float(lower_bound(np.array([good.sum()]), np.array([len(good)]))[0]),
    }
    for name, asked in loads.items():
        scores[name] = float(np.where(good, 1 / (1 + np.minimum(asked, _MOST) ** _SLOPE), 0).mean())
    scores["holding"] = float(np.mean([scores[name] for name in loads]))
    return replace(candidate, scores={**candidate.scores, **scores})
