"""Antipodal grasps on partial clouds (ten Pas and Platt 2015; Gatto 2016, 3.3.3).

How much of the surface between the fingers of a hand that is free opposes them decides whether it
is a grasp. One view shows one side only: the other is completed by symmetry, or taken from a
second view.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import Room, Surroundings, room_around
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.antipodal import antipodal_label, support_needed
from grasp.spatial.hand_search.classifier import GraspClassifier
from grasp.spatial.hand_search.hands import Hands, SearchOptions, find_hands

__all__ = ["propose_from_cloud", "propose_on"]


_CHECKED = 3

# How often candidates of a geometric rank were right on single noisy views of generated shapes,
# by whether both jaws are opposed or one (`bench_grasp_classifier.py --calibrate`).
_RANKS = (0.0, 0.1, 0.3, 0.4, 0.5, 0.6)
_RIGHT = {"full": (0.05, 0.3, 0.6, 0.8, 0.92, 0.97), "half": (0.01, 0.1, 0.4, 0.5, 0.5, 0.5)}


def propose_from_cloud(
    points: FloatArray,
    gripper: ParallelGripper,
    *,
    table: FloatArray | None = None,
    viewpoints: FloatArray | None = None,
    obstacles: FloatArray | None = None,
    samples: int = 200,
    seed: int = 0,
    options: SearchOptions | None = None,
    complete: bool = True,
    classifier: GraspClassifier | None = None,
    max_candidates: int = 100,
) -> Proposals:
    """Propose grasps of what a cloud shows, best first.

    Parameters
    ----------
    points : (n, 3), m
        One object, or a table with what stands on it; rows that are not finite are left out.
    gripper
        With its fingers, palm and stroke.
    table : (4,) or None
        Plane under the objects, n . p + d = 0 with n upwards: points near it are not grasped, and
        no hand goes below it.
    viewpoints : (k, 3) or None, m
        Where cameras were. Hands come from the side that some camera sees. None = seen from all
        around.
    obstacles : (m, 3) or None, m
        Points of what else stands there.
    samples
        Points at which a hand is tried.
    seed
        Of the draw: the same input and seed give the same candidates.
    complete
        Guess the hidden side of the object, which ``points`` then show alone but for the table;
        takes a table and a viewpoint, and is left out without them.
    classifier
        Orders candidates by its probability, kept as ``scores["classifier"]``; None = geometry.
    max_candidates
        How many at most.

    Returns
    -------
    Candidates in the frame of ``points`` with label ``full`` or ``half``; when there are none, with
    a ``reason``. ``scores["confidence"]`` is the classifier's probability or, without one, how
    often candidates of the same geometric rank were right on simulated views; lower where the
    far side was not seen.

    Raises
    ------
    ValueError
        When an array has the wrong shape or a number is out of range; never for what points say.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> ball = rng.normal(size=(4000, 3)); ball /= np.linalg.norm(ball, axis=1)[:, None]
    >>> hand = ParallelGripper("hand", "jaw", 0.0, 0.08)
    >>> found = propose_from_cloud(0.025 * ball, hand, samples=20)
    >>> found[0].antipodal, round(found[0].width, 2)
    ('full', 0.05)
    >>> propose_from_cloud(0.06 * ball, hand, samples=20).reason
    'every side of what is seen is wider than the stroke of 80 mm'
    """
    if samples < 1 or max_candidates < 1:
        raise ValueError(
            f"samples and max_candidates must be at least 1, got {samples}, {max_candidates}"
        )
    options = options or SearchOptions()
    cloud = prepare_cloud(
        points,
        table=table,
        viewpoints=viewpoints,
        obstacles=obstacles,
        voxel=options.voxel,
        normal_radius=options.normal_radius,
        silhouette_deg=options.silhouette_deg,
    )
    if complete:
        cloud = complete_by_symmetry(cloud)
    return propose_on(cloud, gripper, samples, seed, options, classifier, max_candidates)


def propose_on(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    samples: int = 200,
    seed: int = 0,
    options: SearchOptions | None = None,
    classifier: GraspClassifier | None = None,
    max_candidates: int = 100,
) -> Proposals:
    """Propose grasps on a cloud that is ready; see :func:`propose_from_cloud`."""
    options = options or SearchOptions()
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    hands = find_hands(cloud, gripper, samples, seed, options)
    if len(hands) == 0:
        reason = _wider(cloud, gripper) or "no room for the open fingers on both sides of anything"
        return Proposals(reason=reason, notes=cloud.notes, counts={"hands": 0})
    needed = support_needed(options.support, cloud.voxel)
    width = hands.column("width")
    fits = (width >= gripper.min_opening) & (width <= gripper.max_opening - 2 * options.room)
    weaker = np.minimum(hands.column("left"), hands.column("right"))
    stronger = np.maximum(hands.column("left"), hands.column("right"))
    counts = Counter(
        hands=len(hands),
        wide=int((~fits).sum()),
        full=int((fits & (weaker > needed)).sum()),
        half=int((fits & (weaker <= needed) & (stronger > needed)).sum()),
    )
    chosen = np.flatnonzero(fits & (stronger > needed))
    if len(chosen) == 0:
        reason = _wider(cloud, gripper) or (
            "no surface between the fingers opposes a jaw"
            if fits.any()
            else "what lies between the fingers does not fit the gripper's stroke"
        )
        return Proposals(reason=reason, notes=cloud.notes, counts=dict(counts))
    score = _plausibility(cloud, gripper, hands, needed)
    order = chosen[np.argsort(-score[chosen], kind="stable")][: _CHECKED * max_candidates]
    room = _room(cloud, gripper, hands, order)
    counts["touching"] = int((~room.free).sum())
    if not room.free.any():
        reason = "the gripper would touch what stands around on its way"
        return Proposals(reason=reason, notes=cloud.notes, counts=dict(counts))
    candidates = [
        candidate
        for i, clearance in zip(order[room.free], room.clearance[room.free], strict=True)
        for candidate in _candidates(
            cloud,
            gripper,
            hands,
            int(i),
            needed,
            {"geometry": float(score[i]), "clearance": float(clearance)},
        )
    ]
    if classifier is not None:
        candidates = _judged(cloud, gripper, candidates, classifier)
    return Proposals(tuple(candidates[:max_candidates]), "", cloud.notes, dict(counts))


def _judged(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    candidates: list[GraspCandidate],
    classifier: GraspClassifier,
) -> list[GraspCandidate]:
    """Return candidates with the classifier's probability, best first."""
    judged = [
        replace(
            candidate, scores={**candidate.scores, "confidence": candidate.scores["classifier"]}
        )
        for candidate in classifier.judged(cloud, candidates, gripper)
    ]
    # Calibration makes ties; geometry breaks them.
    return sorted(judged, key=lambda c: (-c.scores["classifier"], -c.scores["geometry"]))


def _room(
    cloud: SurfaceCloud, gripper: ParallelGripper, hands: Hands, chosen: NDArray[np.int64]
) -> Room:
    """Return what the whole gripper would touch on a straight approach, completed points too."""
    return room_around(
        hands.poses[chosen],
        hands.column("opening")[chosen],
        gripper,
        Surroundings(cloud.support, cloud.obstacles),
        cloud=cloud.points[cloud.target],
    )


def _wider(cloud: SurfaceCloud, gripper: ParallelGripper) -> str:
    """Return that no side of the object fits between the jaws, or ""."""
    sides = np.ptp(cloud.points[cloud.target] @ cloud.axes.T, axis=0)
    if sides.min() <= gripper.max_opening:
        return ""
    stroke = f"{1e3 * gripper.max_opening:.3g} mm"
    return f"every side of what is seen is wider than the stroke of {stroke}"


def _plausibility(
    cloud: SurfaceCloud, gripper: ParallelGripper, hands: Hands, needed: float
) -> FloatArray:
    """Return what speaks for each hand by geometry alone (m,), 0..1: an order, no probability."""
    left, right = hands.column("left"), hands.column("right")
    weaker, stronger = np.minimum(left, right), np.maximum(left, right)
    seen = np.minimum(hands.column("left_seen"), hands.column("right_seen")) > needed
    label = np.where(weaker > needed, np.where(seen, 1.0, 0.8), 0.4)
    support = 1.0 - np.exp(-np.where(weaker > needed, weaker, stronger) / (4 * needed))
    between = np.maximum(hands.column("between"), 1.0)
    opposing = np.minimum((left + right) / between, 1.0)
    offset = hands.poses[:, :3, 3] - cloud.centroid
    closing = hands.poses[:, :3, 0]
    across = offset - np.einsum("ij,ij->i", offset, closing)[:, None] * closing
    size = np.linalg.norm(np.ptp(cloud.points[cloud.target] @ cloud.axes.T, axis=0)) / 2
    arm = np.clip(np.linalg.norm(across, axis=1) / max(float(size), 1e-6), 0.0, 1.0)
    spare = np.clip((gripper.max_opening - hands.column("width")) / 0.02, 0.0, 1.0)
    return np.asarray(
        label * (0.3 + 0.7 * support) * (0.5 + 0.5 * opposing) * (1 - 0.5 * arm)
        * (0.6 + 0.4 * spare)
    )  # fmt: skip


def _candidates(
    cloud: SurfaceCloud,
    gripper: ParallelGripper,
    hands: Hands,
    i: int,
    needed: float,
    scores: Mapping[str, float],
) -> list[GraspCandidate]:
    """Return hand ``i`` as a candidate, and turned by half a turn where the jaws differ."""
    row = hands.row(i)
    pose = hands.poses[i]
    label = antipodal_label(row["left"], row["right"], needed)
    seen = antipodal_label(row["left_seen"], row["right_seen"], needed)
    middle = pose[:3, 3] - (row["bite"] - gripper.fingertip) * pose[:3, 2]
    contacts = np.stack(
        [
            middle + sign * row["width"] / 2 * pose[:3, 0]
            + row[f"{side}_y"] * pose[:3, 2] - row[f"{side}_z"] * pose[:3, 1]
            for sign, side in ((-1, "left"), (1, "right"))
        ]
    )  # fmt: skip
    shares = _RIGHT["full" if label == "full" else "half"]
    scores = {**scores, "confidence": float(np.interp(scores["geometry"], _RANKS, shares))}
    candidate = GraspCandidate(
        pose,
        row["width"],
        depth=row["bite"] - row["surface_y"],
        contacts=contacts,
        normals=np.stack([-pose[:3, 0], pose[:3, 0]]),
        source="cloud",
        antipodal=label,
        completed=label != seen,
        opening=row["opening"],
        scores={**scores, "support_left": row["left"], "support_right": row["right"]},
    )
    if gripper.symmetric:
        return [candidate]
    turned = pose.copy()
    turned[:3, :2] *= -1
    other = replace(
        candidate,
        frame_from_gripper=turned,
        contacts=contacts[::-1].copy(),
        normals=np.stack([-turned[:3, 0], turned[:3, 0]]),
        scores={**scores, "support_left": row["right"], "support_right": row["left"]},
    )
    return [candidate, other]
