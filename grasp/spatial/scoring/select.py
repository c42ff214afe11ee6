"""Selection of candidates: ranking, threshold, diversity.

The confidence counts first. It is an estimate from a hundred perturbations: candidates above its
95 % bound of the best cannot be told apart by it, so among them the others decide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper

__all__ = ["diverse", "rank", "select_grasp"]


def rank(candidates: Sequence[GraspCandidate]) -> list[GraspCandidate]:
    """Return the candidates, best first.

    By confidence; where it does not tell them apart by the classifier's probability, rounded to
    .05, then by epsilon, then by clearance, then in the given order.
    """
    confidence = np.array([c.scores.get("confidence", 0.0) for c in candidates])
    order = np.argsort(-confidence, kind="stable").tolist()
    ranked: list[GraspCandidate] = []
    while order:
        best = candidates[order[0]]
        least = best.scores.get("lower_95", confidence[order[0]])
        group = [i for i in order if confidence[i] >= least]
        ranked += [candidates[i] for i in sorted(group, key=lambda i: (_finer(candidates[i]), i))]
        order = order[len(group) :]
    return ranked


def _finer(candidate: GraspCandidate) -> tuple[float, float, float]:
    scores = candidate.scores
    return (
        -round(scores.get("classifier", 0.0) / 0.05),
        -scores.get("epsilon", 0.0),
        -scores.get("clearance", 0.0),
    )


def diverse(
    candidates: Sequence[GraspCandidate],
    gripper: ParallelGripper,
    distance: float = 0.01,
    angle: float = np.deg2rad(15.0),
    most: int = 50,
) -> list[GraspCandidate]:
    """Return at most ``most`` candidates without those that repeat a better one.

    Parameters
    ----------
    candidates
        Best first.
    distance, angle
        m and rad: nearer than both to a better one is a repetition. A gripper with equal jaws is
        the same after half a turn about its approach.
    """
    kept: list[GraspCandidate] = []
    for candidate in candidates:
        if not any(_alike(candidate, other, gripper, distance, angle) for other in kept):
            kept.append(candidate)
        if len(kept) == most:
            break
    return kept


def _alike(
    a: GraspCandidate, b: GraspCandidate, gripper: ParallelGripper, distance: float, angle: float
) -> bool:
    if np.linalg.norm(a.centre - b.centre) > distance:
        return False
    between = a.frame_from_gripper[:3, :3].T @ b.frame_from_gripper[:3, :3]
    traces = [np.trace(between)]
    if gripper.symmetric:
        traces.append(between[2, 2] - between[0, 0] - between[1, 1])
    return bool(np.arccos(np.clip((max(traces) - 1) / 2, -1.0, 1.0)) <= angle)


def select_grasp(
    candidates: Sequence[GraspCandidate], min_confidence: float = 0.3
) -> GraspCandidate | None:
    """Return the best candidate, or None when none is confident enough (Kehoe 2014, 4.3).

    Parameters
    ----------
    min_confidence
        c_G: below it a robot had better not try.
    """
    ranked = rank(candidates)
    if not ranked or ranked[0].scores.get("confidence", 0.0) < min_confidence:
        return None
    return ranked[0]
