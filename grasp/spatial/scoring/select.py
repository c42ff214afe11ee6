"""Selection of candidates: ranking, threshold, diversity.

How likely a grasp lifts and carries the object counts first, where that was computed, else the
confidence in its closing. Both are estimates, and the best of many has its place by its errors as
well: what is nearly as good cannot be told apart by them, so plainer things decide, as the distance
from the centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import EndEffector

__all__ = ["diverse", "hedged", "rank", "rank_by_confidence", "rank_by_holding", "select_grasp"]

_EQUAL = 1e-7
_APART_M, _APART_RAD = 0.01, float(np.deg2rad(15.0))
_NEARLY, _TILTED, _LEANING, _FULL_PATCH = 0.05, 0.2, 0.1, 0.4
_LEVER_STEP_M, _EPSILON_STEP = 0.005, 1e-6
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
    return rank_by_confidence(candidates, up)


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
    lever = _steps([c.scores["lever"] for c in candidates], _LEVER_STEP_M)
    steep = _steepness(candidates, up)
    order = np.argsort(-value, kind="stable")
    ranked: list[GraspCandidate] = []
    while len(order):
        near = value[order] >= value[order[0]] - _NEARLY * abs(value[order[0]])
        group = np.sort(order[near])
        ranked += [candidates[i] for i in group[np.lexsort((-steep[group], lever[group]))]]
        order = order[~near]
    return ranked


def rank_by_confidence(
    candidates: Sequence[GraspCandidate], up: FloatArray | None = None
) -> list[GraspCandidate]:
    """Return the candidates, best first by the confidence in their closing.

    By confidence; where it does not tell them apart by epsilon, in steps above its rounding. Equal
    ones go by confidence after all, then the one with the shorter lever, in steps of 5 mm, the one
    that approaches more steeply, the one with more clearance, and the one given first. Where a
    filter has judged all of them, by confidence times its probability: one tells how far a grasp
    bears errors of the pose, if the object is what it is thought to be, the other whether it is.

    Parameters
    ----------
    up : (3,) or None
        Unit vector against gravity in the candidates' frame; None = no approach is steep.
    """
    confidence = np.nan_to_num([c.scores.get("confidence", 0.0) for c in candidates])
    if candidates and all("classifier" in c.scores for c in candidates):
        sure = np.round(confidence * [c.scores["classifier"] for c in candidates], 9)
        return [candidates[i] for i in np.argsort(-sure, kind="stable")]
    clearance = np.round([c.scores.get("clearance", 0.0) for c in candidates], 6)
    lever = _steps([c.scores.get("lever", 0.0) for c in candidates], _LEVER_STEP_M)
    epsilon = _steps([c.scores.get("epsilon", 0.0) for c in candidates], _EPSILON_STEP)
    sure = np.round(confidence, 9)
    finer = (-clearance, -_steepness(candidates, up), lever, -sure, -epsilon)
    order = np.argsort(-sure, kind="stable")
    ranked: list[GraspCandidate] = []
    while len(order):
        near = sure[order] >= candidates[order[0]].scores.get("lower_95", sure[order[0]])
        near[0] = True
        group = np.sort(order[near])
        ranked += [candidates[i] for i in group[np.lexsort([key[group] for key in finer])]]
        order = order[~near]
    return ranked


def _steps(values: Sequence[float], step: float) -> FloatArray:
    """Return values (n,) as whole steps; halves, which shapes by numbers bring, go down."""
    return np.round(np.array(values, dtype=np.float64) / step - _EQUAL)


def _steepness(candidates: Sequence[GraspCandidate], up: FloatArray | None) -> FloatArray:
    """Return how steeply each approaches from above (n,), 1 = vertically; 0 without a vertical."""
    if up is None:
        return np.zeros(len(candidates))
    return np.round([-float(c.approach @ up) for c in candidates], 6)


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
    chosen: list[GraspCandidate] = []
    taken = _Taken.for_most(len(candidates), gripper.symmetric, distance, angle)
    for candidate in candidates:
        if taken.adds(candidate):
            chosen.append(candidate)
        if len(chosen) == most:
            break
    return chosen


def hedged(
    guessed: Sequence[GraspCandidate],
    seen: Sequence[GraspCandidate],
    gripper: EndEffector,
    most: int = 50,
) -> list[GraspCandidate]:
    """Return two rankings as one: three of the first, two of the second, and so on.

    Grasps planned on a guess of what cannot be seen share its error, so that the best five of them
    may be five variants of one wrong guess. Those planned on what is seen alone do not share it.
    For the same reason a grasp that is an earlier one, turned by half a turn about its approach,
    stands behind all others, even where the jaws differ: both close on the same two places.

    Parameters
    ----------
    guessed, seen
        Best first.
    most
        How many at most, without those that repeat an earlier one.
    """
    queues = [list(guessed), list(seen)]
    size = len(guessed) + len(seen)
    order: list[GraspCandidate] = []
    turned: list[GraspCandidate] = []
    places = _Taken.for_most(size, True, _APART_M, _APART_RAD)
    taken = _Taken.for_most(size, gripper.symmetric, _APART_M, _APART_RAD)
    while any(queues):
        for queue, share in zip(queues, (_GUESSED, _SEEN), strict=True):
            count = len(order)
            while queue and len(order) < count + share:
                candidate = queue.pop(0)
                if places.adds(candidate):
                    taken.adds(candidate)
                    order.append(candidate)
                else:
                    turned.append(candidate)
    return [*order, *(candidate for candidate in turned if taken.adds(candidate))][:most]


@dataclass
class _Taken:
    """Grasps that were taken: another is only added when it repeats none of them.

    Parameters
    ----------
    centres, rotations : (n, 3), (n, 3, 3)
        Of which the first ``count`` are taken.
    symmetric
        Whether half a turn about the approach makes no difference.
    distance, angle
        m and rad: nearer than both is a repetition.
    """

    centres: FloatArray
    rotations: FloatArray
    symmetric: bool
    distance: float
    angle: float
    count: int = 0

    @classmethod
    def for_most(cls, most: int, symmetric: bool, distance: float, angle: float) -> _Taken:
        """Return room for ``most`` grasps, none of them taken."""
        room = np.empty((most, 3)), np.empty((most, 3, 3))
        return cls(*room, symmetric, distance, angle)

    def adds(self, candidate: GraspCandidate) -> bool:
        """Take a grasp unless it repeats one that was taken; tell whether it was."""
        rotation, n = candidate.frame_from_gripper[:3, :3], self.count
        away = self.centres[:n] - candidate.centre
        # Facets may be exactly as far apart as the limits, whatever a frame's rounding makes of it.
        near = np.einsum("ij,ij->i", away, away) <= (self.distance + _EQUAL) ** 2
        if near.any():
            along = np.einsum("nij,ij->nj", self.rotations[:n][near], rotation)
            trace = along.sum(axis=1)
            if self.symmetric:
                trace = np.maximum(trace, along[:, 2] - along[:, 0] - along[:, 1])
            if np.any(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0)) <= self.angle + _EQUAL):
                return False
        self.centres[n], self.rotations[n] = candidate.centre, rotation
        self.count += 1
        return True


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
