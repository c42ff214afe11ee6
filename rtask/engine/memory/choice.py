"""Rank the grasps to try: remembered ones and candidates from geometry."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import Arm, Axes, BetaThompson, Choice
from grasp.learning.bandit import Trial as Tried
from grasp.learning.calibration import ScoreMap
from grasp.learning.causes import hidden_share
from grasp.spatial.candidate import GraspCandidate, contacts_of
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import (
    closing_yaw,
    matrix_from_pose,
    move_planar,
    pose_from_matrix,
    tilt,
    wrap_axis,
)
from grasp.spatial.gripper import ContactKind, EndEffector, ParallelGripper
from grasp.spatial.planar import PlanarGrasp, propose_planar, rate_all
from rtask.engine.decisions import Option
from rtask.engine.memory.calibration import PLANAR, SPATIAL
from rtask.engine.memory.experience import Evidence, Weights, gather, without_trials
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, Remembered, Trial

__all__ = ["Scene", "choose", "options", "unaided"]

_MERGE_M = 0.005
_MERGE_RAD = np.deg2rad(10)
_SURELY_IT = 0.5
"""Confidence in an identity from which a success of that object is one of the present object."""
_UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
_LARGER = 1.1
"""By which a lip may be larger than one that sealed at a place."""
_SPARE_M = 0.008
"""Room on either side of an object when another hand opens for it."""


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
    forces
        Largest closing force, N, by type of gripper, where it is known.
    is_fast
        Whether the robot is simulated with the coarse physics preset.
    planned
        New grasps of a hand that is no jaws, in the robot's frame.
    max_tilt
        Largest angle between the vertical and the approach of a grasp in space, rad.
    """

    footprint: Footprint
    frame_from_upright: NDArray[np.float64]
    gripper: EndEffector
    neighbours: NDArray[np.float64] | None = None
    seed: int = 0
    frame_from_object: NDArray[np.float64] | None = None
    forces: Mapping[str, float] = field(default_factory=dict)
    is_fast: bool = False
    planned: tuple[GraspCandidate, ...] = ()
    max_tilt: float = np.pi

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
    hand = scene.gripper
    own = memory.of(object_iri) if object_iri else []
    own = [one for one in own if one.contact_kind == hand.contact_kind]
    found = _from_above(scene, [one for one in own if one.quaternion is None])
    found += _in_space(scene, [one for one in own if one.quaternion is not None])
    if not propose:
        return found
    if not isinstance(hand, ParallelGripper):
        return found + _planned(scene, [one.grasp for one in found], limit)
    proposed = propose_planar(
        scene.footprint, hand, scene.neighbours, scene.seed, max_candidates=limit
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
    weights = Weights(
        policy,
        confidence,
        scene.gripper,
        scene.size,
        now or dt.datetime.now(dt.UTC),
        scene.forces,
        scene.is_fast,
    )
    memory = _of_kind(memory, scene.gripper.contact_kind)
    told = _relevant(without_trials(memory), confidence)
    evidence = gather(
        at[:, :3], at[:, 3], told, weights, policy.bandit.bandwidth, _all_axes(candidates, told)
    )
    hidden = _hidden(candidates, scene, memory, told, weights)
    return [
        replace(candidates[c.index], choice=c, sources=evidence.objects[c.index])
        for c in _rank(candidates, scene, memory, policy, evidence, maps or {}, hidden)
    ]


def _of_kind(memory: Memory, kind: ContactKind) -> Memory:
    """Return what is remembered of grasps by contacts of one kind: others say nothing about it."""
    others = {one.grasp for one in memory.grasps if one.contact_kind != kind}
    if not others:
        return memory
    return replace(
        memory,
        grasps=tuple(one for one in memory.grasps if one.grasp not in others),
        trials=tuple(one for one in memory.trials if one.grasp not in others),
    )


def _relevant(told: Sequence[Remembered], confidence: Mapping[str, float]) -> Sequence[Remembered]:
    """Return what counts as evidence: once the object itself was held, its class says no more.

    Things that look alike may differ in what no camera sees.
    """
    known = any(
        tally.held and confidence.get(one.object, 0.0) >= _SURELY_IT
        for one in told
        if not one.of_class
        for tally in one.tallies
    )
    return [one for one in told if not one.of_class] if known else told


def unaided(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    policy: Policy,
    maps: Mapping[str, ScoreMap] | None = None,
) -> Option | None:
    """Return the option that :func:`choose` would put first if the graph knew of no outcomes."""
    n = len(candidates)
    nothing = Evidence(np.zeros(n), np.zeros(n), ((),) * n)
    weights = Weights(policy, {}, scene.gripper, scene.size, dt.datetime.now(dt.UTC))
    hidden = _hidden(candidates, scene, memory, (), weights)
    order = _rank(candidates, scene, memory, policy, nothing, maps or {}, hidden)
    return replace(candidates[order[0].index], choice=order[0]) if order else None


def _rank(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    policy: Policy,
    evidence: Evidence,
    maps: Mapping[str, ScoreMap],
    hidden: NDArray[np.float64],
) -> list[Choice]:
    """Return the learner's order, given the graph's evidence on each option."""
    arms = [
        Arm(
            (x, y, z), theta, _chance(option, maps),
            float(evidence.successes[i]), float(evidence.failures[i]), option.opening,
            _axes(option), float(hidden[i]),
        )
        for i, option in enumerate(candidates)
        for x, y, z, theta in [option.in_object]
    ]  # fmt: skip
    trials = [Tried((t.x, t.y, t.z), t.theta, t.held, _axes(t)) for t in memory.trials]
    return BetaThompson(policy.bandit, max(scene.size)).rank(arms, trials, scene.seed)


def _hidden(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    told: Sequence[Remembered],
    weights: Weights,
) -> NDArray[np.float64]:
    """Return what attempts at the object itself leave of each option's quality, (n,).

    Both are grasps from above; a grasp in space is another way to hold the object.
    """
    hidden = np.ones(len(candidates))
    above = [k for k, option in enumerate(candidates) if isinstance(option.grasp, PlanarGrasp)]
    if not (weights.policy.causes and above):
        return hidden
    seen = [(one.x, float(one.held), 1.0) for one in memory.trials if one.quaternion is None]
    seen += [
        (one.x, float(tally.held), tally.count * weights.trust(one, tally))
        for one in told
        if not one.of_class and one.quaternion is None
        for tally in one.tallies
    ]
    x, held, weight = np.array(sorted(seen)).reshape(-1, 3).T
    length = scene.size[0]
    places = np.array([candidates[k].in_object[0] for k in above]) / length
    half_finger = scene.gripper.finger_width / 2 / length
    hidden[above] = hidden_share(places, half_finger, x / length, held, weight)
    return hidden


def _opening(one: Remembered, hand: EndEffector) -> float:
    """Return how far a hand opens for a remembered grasp: as its own kind did, or its contacts'
    distance and some room, m.
    """
    if one.gripper_type == hand.gripper_type or one.width is None:
        return min(one.opening, hand.max_opening)
    return min(one.width + 2 * _SPARE_M, hand.max_opening)


def _chance(option: Option, maps: Mapping[str, ScoreMap]) -> float:
    """Return what a score has been worth with this hand."""
    kind = SPATIAL if isinstance(option.grasp, GraspCandidate) else PLANAR
    return maps[kind].chance(option.quality) if kind in maps else option.quality


def _from_above(scene: Scene, known: Sequence[Remembered]) -> list[Option]:
    """Return the grasps from above that fit the object as it stands now.

    Between neighbours a hand opens no wider than it needs to.
    """
    if not (known and isinstance(scene.gripper, ParallelGripper)):
        return []
    wide = [_opening(one, scene.gripper) for one in known]
    tried = [wide]
    if scene.neighbours is not None:
        narrow = [
            w if one.width is None else min(w, one.width + 2 * _SPARE_M)
            for one, w in zip(known, wide, strict=True)
        ]
        tried.append(narrow)
    found = []
    for one, *fits in zip(known, *(_rated(scene, known, w) for w in tried), strict=True):
        free = [grasp for grasp in fits if grasp is not None and grasp.clearance > 0]
        if free:
            found.append(Option(one.grasp, free[0], (one.x, one.y, one.z, one.theta), one))
    return found


def _rated(
    scene: Scene, known: Sequence[Remembered], openings: Sequence[float]
) -> list[PlanarGrasp | None]:
    """Return remembered grasps from above as they are now, None where the jaws cannot close."""
    assert isinstance(scene.gripper, ParallelGripper)
    at = np.array([(one.x, one.y, one.theta) for one in known])
    drafts = [
        PlanarGrasp(x, y, one.z, wrap_axis(theta), 0.0, opening, 0.0, "memory", scene.seed)
        for one, opening, (x, y, theta) in zip(
            known, openings, move_planar(scene.frame_from_upright, at).tolist(), strict=True
        )
    ]
    return rate_all(scene.footprint, scene.gripper, drafts, scene.neighbours)


def _in_space(scene: Scene, known: Sequence[Remembered]) -> list[Option]:
    """Return the grasps in space that this gripper can take as the object lies now.

    A pose is that of the point midway between the contacts, with the closing direction and the
    approach as axes, so that it says the same of every gripper.
    """
    hand, pose = scene.gripper, scene.frame_from_object
    known = [one for one in known if _suits(one, hand)]
    if pose is None or not known:
        return []
    support = float(scene.frame_from_upright[2, 3])
    around = scene.neighbours
    if around is not None:
        around = around + np.array([0.0, 0.0, support])
    poses = np.stack([pose @ one.object_from_gripper for one in known])
    openings = np.array([_opening(one, hand) for one in known])
    room = room_around(poses, openings, hand, Surroundings(Support(support, clearance=0.0), around))
    found = []
    for one, placed, opening, clearance, is_free in zip(
        known, poses, openings.tolist(), room.clearance.tolist(), room.free.tolist(), strict=True
    ):
        width = opening if one.width is None else one.width
        is_steep = tilt(placed @ _UPSIDE_DOWN) <= scene.max_tilt
        if is_free and hand.fits(width, 0.0) and is_steep:
            scores = {"confidence": one.prior or 0.0, "clearance": clearance}
            grasp = GraspCandidate(placed, width, source="recalled", opening=opening, scores=scores)
            contacts = one.contacts
            if contacts is not None:
                contacts = contacts.within(one.object_from_gripper)
            found.append(
                Option(
                    one.grasp,
                    grasp,
                    (one.x, one.y, one.z, one.theta),
                    one,
                    quaternion=one.quaternion,
                    contacts=contacts,
                )
            )
    return found


def _suits(one: Remembered, hand: EndEffector) -> bool:
    """Tell whether contacts are ones of a hand: a lip seals where one at least as large did."""
    contacts = one.contacts
    if contacts is None or contacts.seal_radius is None:
        return True
    return hand.finger_width / 2 <= _LARGER * contacts.seal_radius


def _planned(
    scene: Scene, known: Sequence[PlanarGrasp | GraspCandidate], limit: int
) -> list[Option]:
    """Return the newly planned grasps that no known one covers."""
    pose = scene.frame_from_object
    object_from_frame = np.linalg.inv(scene.frame_from_upright if pose is None else pose)
    found: list[Option] = []
    for k, one in enumerate(scene.planned[:limit]):
        placed = one.frame_from_gripper
        if tilt(placed @ _UPSIDE_DOWN) > scene.max_tilt:
            continue
        if any(
            isinstance(old, GraspCandidate)
            and np.linalg.norm(old.centre - one.centre) <= _MERGE_M
            and float(old.approach @ one.approach) >= np.cos(_MERGE_RAD)
            for old in known
        ):
            continue
        in_object = object_from_frame @ placed
        (x, y, z), (qx, qy, qz, qw) = (part.tolist() for part in pose_from_matrix(in_object))
        contacts = contacts_of(one, scene.gripper)
        found.append(
            Option(
                f"candidate:{k}",
                one,
                (x, y, z, closing_yaw(in_object)),
                quaternion=(qx, qy, qz, qw),
                contacts=None if contacts is None else contacts.within(placed),
            )
        )
    return found


def _axes(known: Remembered | Trial | Option | None) -> Axes | None:
    """Return closing and approach direction of a grasp in space; None for one from above.

    Cups and three fingers are alike about their approach, so that it is both for them.
    """
    if known is None or known.quaternion is None:
        return None
    if isinstance(known, Option):
        pose = matrix_from_pose(np.array(known.in_object[:3]), np.array(known.quaternion))
    else:
        pose = known.object_from_gripper
    closing, approach = pose[:3, [0, 2]].T.tolist()
    is_round = isinstance(known, Option | Remembered) and known.contacts is not None
    return tuple(approach if is_round else closing), tuple(approach)


def _all_axes(
    candidates: Sequence[Option], told: Sequence[Remembered]
) -> NDArray[np.float64] | None:
    """Return closing and approach directions (n, 2, 3); None if all grasps are from above."""
    if not any([one.quaternion for one in candidates] + [one.quaternion for one in told]):
        return None
    flat = [
        ((np.cos(theta), np.sin(theta), 0.0), (0.0, 0.0, -1.0))
        for *_, theta in (one.in_object for one in candidates)
    ]
    return np.array([_axes(one) or f for one, f in zip(candidates, flat, strict=True)])


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
