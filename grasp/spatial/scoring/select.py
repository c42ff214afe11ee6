"""Selection of candidates: ranking, threshold, diversity.

How likely a grasp lifts and carries the object counts first, where that was computed, else the
confidence in its closing. Both are estimates, and the best of many has its place by its errors as
well: what is nearly as good cannot be told apart by them, so plainer things decide, as the distance
from the centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import EndEffector

__all__ = ["diverse", "hedged", "rank", "rank_by_confidence", "rank_by_holding", "select_grasp"]

_EQUAL = 1e-7
_APART_M, _APART_RAD = 0.01, float(np.deg2rad(15.0))
_NEARLY, _TILTED, _LEANING, _FULL_PATCH = 0.05, 0.2, 0.1, 0.4
_LEVER_STEP_M = 0.005
_GUESSED, _SEEN = 3, 2


def rank(
    candidates: Sequence[GraspCandidate], up: FloatArray | None = None
) -> list[GraspCandidate]:
    """Return the candidates, best first: by holding where all have been scored for it.

    Parameters
    ----------
    up : (3,) or None
        Unit vector against gravity in the candidates' frame.
    """
    if candidates and all({"lift", "carry", "lever"} <= set(c.scores) for c in candidates):
        return rank_by_holding(candidates, up)
    return rank_by_confidence(candidates)


def rank_by_holding(
    candidates: Sequence[GraspCandidate], up: FloatArray | None = None
) -> list[GraspCandidate]:
    """Return the candidates, best first by the mean of ``lift`` and ``carry``.

    With a vertical, an approach from the side counts a fifth less than one from above: a tilted
    hand is nearer to the support, which the scores do not see. Pads that meet the object with less
    than two fifths of their area count for less in proportion, and a tenth of the friction that the
    pads use up by leaning against each other is taken off: small patches and tapers fail more often
    in physics than the scores say.

    Of those within 5 % of the best the one with the shorter lever, in steps of 5 mm, comes first,
    then the one that approaches more steeply, then the one given first. One whose scores are not
    numbers comes last.
    """
    # Rounded, so that rigid motions change nothing.
    value = np.array([(c.scores["lift"] + c.scores["carry"]) / 2 for c in candidates])
    if up is not None:
        value = value * [1 - _TILTED * (1 + float(c.approach @ up)) for c in candidates]
    value = value * [min(c.scores.get("patch", 1.0) / _FULL_PATCH, 1.0) for c in candidates]
    value = value - [_LEANING * c.scores.get("taper", 0.0) for c in candidates]
    value = np.nan_to_num(np.round(value, 9), nan=-np.inf)
    lever = np.round([c.scores["lever"] / _LEVER_STEP_M - _EQUAL for c in candidates])
    steep = np.zeros(len(candidates))
    if up is not None:
        steep = np.round([-float(c.approach @ up) for c in candidates], 6)
    order = np.argsort(-value, kind="stable")
    ranked: list[GraspCandidate] = []
    while len(order):
        near = value[order] >= value[order[0]] - _NEARLY * abs(value[order[0]])
        group = np.sort(order[near])
        ranked += [candidates[i] for i in group[np.lexsort((-steep[group], lever[group]))]]
        order = order[~near]
    return ranked


def rank_by_confidence(candidates: Sequence[GraspCandidate]) -> list[GraspCandidate]:
    """Return the candidates, best first by the confidence in their closing.

    By confidence; where it does not tell them apart by epsilon, then by clearance, then in the
    given order. Where a filter has judged all of them, by confidence times its probability: one
    tells how far a grasp bears errors of the pose, if the object is what it is thought to be, the
    other whether it is.
    """
    confidence = np.nan_to_num([c.scores.get("confidence", 0.0) for c in candidates])
    if candidates and all("classifier" in c.scores for c in candidates):
        sure = np.round(confidence * [c.scores["classifier"] for c in candidates], 9)
        return [candidates[i] for i in np.argsort(-sure, kind="stable")]
    order = np.argsort(-confidence, kind="stable").tolist()
    ranked: list[GraspCandidate] = []
    while order:
        best = candidates[order[0]]
        least = best.scores.get("lower_95", confidence[order[0]])
        group = [i for i in order if confidence[i] >= least]
        ranked += [candidates[i] for i in sorted(group, key=lambda i: (_finer(candidates[i]), i))]
        order = order[len(group) :]
    return ranked


def _finer(candidate: GraspCandidate) -> tuple[float, float]:
    scores = candidate.scores
    return -scores.get("epsilon", 0.0), -scores.get("clearance", 0.0)


def diverse(
    candidates: Sequence[GraspCandidate],
    gripper: EndEffector,
    distance: float = _APART_M,
    angle: float = _APART_RAD,
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


def hedged(
    guessed: Sequence[GraspCandidate],
    seen: Sequence[GraspCandidate],
    gripper: EndEffector,
    most: int = 50,
) -> list[GraspCandidate]:
    """Return two rankings as one: three of the first, two of the second, and so on.

    Grasps planned on a guess of what cannot be seen share its error, so that the best five of them
    may be five variants of one wrong guess. Those planned on what is seen alone do not share it.

    Parameters
    ----------
    guessed, seen
        Best first.
    most
        How many at most, without those that repeat an earlier one.
    """
    queues = [list(guessed), list(seen)]
    order: list[GraspCandidate] = []
    while any(queues):
        for queue, share in zip(queues, (_GUESSED, _SEEN), strict=True):
            taken = 0
            while queue and taken < share:
                one = queue.pop(0)
                if not any(_alike(one, other, gripper, _APART_M, _APART_RAD) for other in order):
                    order.append(one)
                    taken += 1
    return order[:most]


def _alike(
    a: GraspCandidate, b: GraspCandidate, gripper: EndEffector, distance: float, angle: float
) -> bool:
    # Facets may be exactly as far apart as the limits, whatever a frame's rounding makes of it.
    if np.linalg.norm(a.centre - b.centre) > distance + _EQUAL:
        return False
    between = a.frame_from_gripper[:3, :3].T @ b.frame_from_gripper[:3, :3]
    traces = [np.trace(between)]
    if gripper.symmetric:
        traces.append(between[2, 2] - between[0, 0] - between[1, 1])
    return bool(np.arccos(np.clip((max(traces) - 1) / 2, -1.0, 1.0)) <= angle + _EQUAL)


def select_grasp(
    candidates: Sequence[GraspCandidate], min_confidence: float = 0.3
) -> GraspCandidate | None:
    """Return the best that is confident enough, or None when none is (Kehoe 2014, 4.3).

    Parameters
    ----------
    min_confidence
        c_G: below it a robot had better not try.
    """
    sure = [c for c in candidates if c.scores.get("confidence", 0.0) >= min_confidence]
    return next(iter(rank(sure)), None)
