"""Rank the grasps to try: remembered ones and candidates from geometry."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import Arm, Axes, BetaThompson
from grasp.learning.bandit import Trial as Tried
from grasp.learning.calibration import ScoreMap
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import move_planar, wrap_axis
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import PlanarGrasp, propose_planar, rate_all
from rtask.engine.decisions import Option
from rtask.engine.memory.calibration import PLANAR, SPATIAL
from rtask.engine.memory.experience import Weights, gather, without_trials
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, Remembered, Trial

__all__ = ["Scene", "choose", "options"]

_MERGE_M = 0.005
_MERGE_RAD = np.deg2rad(10)


@dataclass(frozen=True)
class Scene:
    """Object and gripper for which a grasp is chosen.

    Parameters
    ----------
    footprint
        Footprint of the object in the robot's frame.
    frame_from_upright : (4, 4) float64, m
        Pose of the object in the robot's frame as it stands now, z up.
    neighbours : (m, 3) or None, m
        Points of neighbouring objects: x, y in the robot's frame, z above the support.
    frame_from_object : (4, 4) or None, m
        Pose of the object in the robot's frame; None if unknown, or if only grasps from above are
        wanted.
    """

    footprint: Footprint
    frame_from_upright: NDArray[np.float64]
    gripper: ParallelGripper
    neighbours: NDArray[np.float64] | None = None
    seed: int = 0
    frame_from_object: NDArray[np.float64] | None = None

    @property
    def size(self) -> tuple[float, float, float]:
        """(length, width, height), m."""
        return self.footprint.length, self.footprint.width, self.footprint.height


def options(
    scene: Scene, memory: Memory, object_iri: str | None, propose: bool, limit: int = 50
) -> list[Option]:
    """Return the grasps to choose from: the remembered ones, then new candidates.

    Parameters
    ----------
    object_iri
        IRI of the object, if it was identified.
    propose
        Whether to add candidates from geometry.
    limit
        Maximum number of candidates.
    """
    own = memory.of(object_iri) if object_iri else []
    found = _from_above(scene, [one for one in own if one.quaternion is None])
    found += _in_space(scene, [one for one in own if one.quaternion is not None])
    if not propose:
        return found
    proposed = propose_planar(
        scene.footprint, scene.gripper, scene.neighbours, scene.seed, max_candidates=limit
    )
    fresh = ~_merged(proposed, [one.grasp for one in found[:200]])
    at = np.array([(grasp.x, grasp.y, grasp.theta) for grasp in proposed]).reshape(-1, 3)
    moved = move_planar(scene.frame_from_upright, at, inverse=True).tolist()
    for k in np.flatnonzero(fresh).tolist():
        (x, y, theta), grasp = moved[k], proposed[k]
        # Rounded as in the graph, so that it has the same weight before and after it is stored.
        x, y, z, theta = (round(v, 6) + 0.0 for v in (x, y, grasp.z, wrap_axis(theta)))
        found.append(Option(f"candidate:{k}", grasp, (x, y, z, theta)))
    return found


def choose(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    confidence: Mapping[str, float],
    policy: Policy,
    now: dt.datetime | None = None,
    maps: Mapping[str, ScoreMap] | None = None,
) -> list[Option]:
    """Return the options in the order in which to try them; empty if none is worthwhile.

    Parameters
    ----------
    confidence
        Confidence that each remembered object is the present one, by IRI.
    maps
        The hand's own, from scores to chances, by kind of score.
    """
    if not candidates:
        return []
    at = np.array([option.in_object for option in candidates])
    weights = Weights(policy, confidence, scene.gripper, scene.size, now or dt.datetime.now(dt.UTC))
    told = without_trials(memory)
    evidence = gather(
        at[:, :3], at[:, 3], told, weights, policy.bandit.bandwidth, _all_axes(candidates, told)
    )
    arms = [
        Arm(
            (float(x), float(y), float(z)), float(theta), _chance(option, maps or {}),
            float(evidence.successes[i]), float(evidence.failures[i]), option.opening,
            _axes(option.remembered),
        )
        for i, (option, (x, y, z, theta)) in enumerate(zip(candidates, at, strict=True))
    ]  # fmt: skip
    trials = [Tried((t.x, t.y, t.z), t.theta, t.held, _axes(t)) for t in memory.trials]
    learner = BetaThompson(policy.bandit, max(scene.size))
    return [
        replace(candidates[c.index], choice=c, sources=evidence.objects[c.index])
        for c in learner.rank(arms, trials, scene.seed)
    ]


def _chance(option: Option, maps: Mapping[str, ScoreMap]) -> float:
    """Return what a score has been worth with this hand."""
    kind = SPATIAL if isinstance(option.grasp, GraspCandidate) else PLANAR
    return maps[kind].chance(option.quality) if kind in maps else option.quality


def _from_above(scene: Scene, known: Sequence[Remembered]) -> list[Option]:
    """Return the grasps from above that fit the object as it stands now."""
    if not known:
        return []
    at = np.array([(one.x, one.y, one.theta) for one in known])
    drafts = [
        PlanarGrasp(x, y, one.z, wrap_axis(theta), 0.0, one.opening, 0.0, "memory", scene.seed)
        for one, (x, y, theta) in zip(
            known, move_planar(scene.frame_from_upright, at).tolist(), strict=True
        )
    ]
    rated = rate_all(scene.footprint, scene.gripper, drafts, scene.neighbours)
    return [
        Option(one.grasp, grasp, (one.x, one.y, one.z, one.theta), one)
        for one, grasp in zip(known, rated, strict=True)
        if grasp is not None and grasp.clearance > 0
    ]


def _in_space(scene: Scene, known: Sequence[Remembered]) -> list[Option]:
    """Return the grasps in space of this kind of gripper that are free as the object lies now."""
    hand, pose = scene.gripper, scene.frame_from_object
    mine = [one for one in known if one.gripper_type == hand.gripper_type]
    if pose is None or not mine:
        return []
    support = float(scene.frame_from_upright[2, 3])
    around = scene.neighbours
    if around is not None:
        around = around + np.array([0.0, 0.0, support])
    poses = np.stack([pose @ one.object_from_gripper for one in mine])
    openings = np.array([min(one.opening, hand.max_opening) for one in mine])
    room = room_around(poses, openings, hand, Surroundings(Support(support, clearance=0.0), around))
    found = []
    for one, placed, opening, clearance, is_free in zip(
        mine, poses, openings.tolist(), room.clearance.tolist(), room.free.tolist(), strict=True
    ):
        width = opening if one.width is None else one.width
        if is_free and hand.fits(width, 0.0):
            scores = {"confidence": one.prior or 0.0, "clearance": clearance}
            grasp = GraspCandidate(placed, width, source="recalled", opening=opening, scores=scores)
            found.append(Option(one.grasp, grasp, (one.x, one.y, one.z, one.theta), one))
    return found


def _axes(known: Remembered | Trial | None) -> Axes | None:
    """Return closing and approach direction of a grasp in space; None for one from above."""
    if known is None or known.quaternion is None:
        return None
    closing, approach = known.object_from_gripper[:3, [0, 2]].T.tolist()
    return tuple(closing), tuple(approach)


def _all_axes(
    candidates: Sequence[Option], told: Sequence[Remembered]
) -> NDArray[np.float64] | None:
    """Return closing and approach directions (n, 2, 3); None if all grasps are from above."""
    known = (*(one.remembered for one in candidates), *told)
    if all(one is None or one.quaternion is None for one in known):
        return None
    flat = [
        ((np.cos(theta), np.sin(theta), 0.0), (0.0, 0.0, -1.0))
        for *_, theta in (one.in_object for one in candidates)
    ]
    return np.array([_axes(one.remembered) or f for one, f in zip(candidates, flat, strict=True)])


def _merged(
    proposed: Sequence[PlanarGrasp], known: Sequence[PlanarGrasp | GraspCandidate]
) -> NDArray[np.bool_]:
    """Return a mask (n,) of the proposed grasps that a known one from above covers."""
    old = [grasp for grasp in known if isinstance(grasp, PlanarGrasp)]
    if not proposed or not old:
        return np.zeros(len(proposed), dtype=bool)
    a, b = (np.array([(g.x, g.y, g.z, g.theta) for g in grasps]) for grasps in (proposed, old))
    off = a[:, None] - b[None]
    near = np.hypot(off[..., 0], off[..., 1]) <= _MERGE_M
    level = np.abs(off[..., 2]) <= _MERGE_M
    along = np.abs((off[..., 3] + np.pi / 2) % np.pi - np.pi / 2) <= _MERGE_RAD
    return np.asarray((near & level & along).any(axis=1))
