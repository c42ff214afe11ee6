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
from grasp.learning.population import Population
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
from rtask.engine.decisions import LOWERED, Option
from rtask.engine.memory.calibration import PLANAR, SPATIAL
from rtask.engine.memory.experience import Evidence, Weights, gather, without_trials, won_by
from rtask.engine.memory.hidden import hidden_causes_of, hidden_shares, tries_from_above
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
    own = [remembered for remembered in own if remembered.contact_kind == hand.contact_kind]
    options = _from_above(
        scene, [remembered for remembered in own if remembered.quaternion is None]
    )
    options += _in_space(
        scene, [remembered for remembered in own if remembered.quaternion is not None]
    )
    if not propose:
        return options
    if not isinstance(hand, ParallelGripper):
        return options + _planned(scene, [remembered.grasp for remembered in options], limit)
    proposed = propose_planar(
        scene.footprint, hand, scene.neighbours, scene.seed, max_candidates=limit
    )
    # A candidate beside a known grasp would be the same arm twice, one of them without its history.
    fresh = ~_merged(proposed, [remembered.grasp for remembered in options[:200]])
    at = np.array([(grasp.x, grasp.y, grasp.theta) for grasp in proposed]).reshape(-1, 3)
    moved = move_planar(scene.frame_from_upright, at, inverse=True).tolist()
    for k in np.flatnonzero(fresh).tolist():
        (x, y, theta), grasp = moved[k], proposed[k]
        # Rounded as in the graph, so that it has the same weight before and after it is stored.
        x, y, z, theta = (round(v, 6) + 0.0 for v in (x, y, grasp.z, wrap_axis(theta)))
        options.append(Option(f"candidate:{k}", grasp, (x, y, z, theta)))
    return options


def choose(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    confidence: Mapping[str, float],
    policy: Policy,
    now: dt.datetime | None = None,
    maps: Mapping[str, ScoreMap] | None = None,
    population: Population | None = None,
) -> list[Option]:
    """Return the options in the order in which to try them; empty if none is worthwhile.

    Parameters
    ----------
    confidence
        Confidence that each remembered object is the present one, by IRI.
    maps
        The hand's own, from scores to chances, by kind of score.
    population
        All objects that were tried, from which the prior of hidden causes is learned.
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
    with_evidence = _relevant(without_trials(memory), confidence)
    evidence = gather(
        at[:, :3],
        at[:, 3],
        with_evidence,
        weights,
        policy.bandit.bandwidth,
        _all_axes(candidates, with_evidence),
    )
    tried = tries_from_above(memory, with_evidence, weights, population)
    hidden = hidden_shares(candidates, scene.gripper, tried)
    causes = hidden_causes_of(candidates, scene.gripper, tried, hidden < LOWERED)
    return [
        replace(
            candidates[c.index], choice=c, sources=evidence.objects[c.index], cause=causes[c.index]
        )
        for c in _rank(
            candidates, scene, memory, policy, evidence, maps or {}, hidden,
            won_by(with_evidence, weights),
        )
    ]  # fmt: skip


def _of_kind(memory: Memory, kind: ContactKind) -> Memory:
    """Return what is remembered of grasps by contacts of one kind: others say nothing about it."""
    # Trials carry no kind of their own, so that both go by the grasp.
    others = {grasp.grasp for grasp in memory.grasps if grasp.contact_kind != kind}
    if not others:
        return memory
    return replace(
        memory,
        grasps=tuple(grasp for grasp in memory.grasps if grasp.grasp not in others),
        trials=tuple(grasp for grasp in memory.trials if grasp.grasp not in others),
    )


def _relevant(
    evidence: Sequence[Remembered], confidence: Mapping[str, float]
) -> Sequence[Remembered]:
    """Return what counts as evidence: once the object itself was held, its class says no more.

    Things that look alike may differ in what no camera sees.
    """
    has_own = any(
        tally.held and confidence.get(remembered.object, 0.0) >= _SURELY_IT
        for remembered in evidence
        if not remembered.of_class
        for tally in remembered.tallies
    )
    return (
        [remembered for remembered in evidence if not remembered.of_class] if has_own else evidence
    )


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
    hidden = hidden_shares(candidates, scene.gripper, tries_from_above(memory, (), weights))
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
    won: Mapping[str, float] | None = None,
) -> list[Choice]:
    """Return the learner's order, given the graph's evidence on each option, and own successes."""
    own = won or {}
    arms = [
        Arm(
            (x, y, z), theta, _chance(option, maps),
            float(evidence.successes[i]), float(evidence.failures[i]), option.opening,
            _axes(option), float(hidden[i]), own.get(option.id, 0.0),
        )
        for i, option in enumerate(candidates)
        for x, y, z, theta in [option.in_object]
    ]  # fmt: skip
    trials = [Tried((t.x, t.y, t.z), t.theta, t.held, _axes(t)) for t in memory.trials]
    return BetaThompson(policy.bandit, max(scene.size)).rank(arms, trials, scene.seed)


def _opening(remembered: Remembered, hand: EndEffector) -> float:
    """Return how far a hand opens for a remembered grasp: as its own kind did, or its contacts'
    distance and some room, m.
    """
    if remembered.gripper_type == hand.gripper_type or remembered.width is None:
        return min(remembered.opening, hand.max_opening)
    return min(remembered.width + 2 * _SPARE_M, hand.max_opening)


def _chance(option: Option, maps: Mapping[str, ScoreMap]) -> float:
    """Return what a score has been worth with this hand."""
    kind = SPATIAL if isinstance(option.grasp, GraspCandidate) else PLANAR
    return maps[kind].chance(option.quality) if kind in maps else option.quality


def _from_above(scene: Scene, remembered: Sequence[Remembered]) -> list[Option]:
    """Return the grasps from above that fit the object as it stands now.

    Between neighbours a hand opens no wider than it needs to.
    """
    if not (remembered and isinstance(scene.gripper, ParallelGripper)):
        return []
    wide = [_opening(recalled, scene.gripper) for recalled in remembered]
    tried = [wide]
    # Opened as it was, or only as far as the object is wide: between neighbours the narrower one
    # may be free.
    if scene.neighbours is not None:
        narrow = [
            w if recalled.width is None else min(w, recalled.width + 2 * _SPARE_M)
            for recalled, w in zip(remembered, wide, strict=True)
        ]
        tried.append(narrow)
    options_found = []
    for recalled, *fits in zip(
        remembered, *(_rated(scene, remembered, w) for w in tried), strict=True
    ):
        free = [grasp for grasp in fits if grasp is not None and grasp.clearance > 0]
        if free:
            options_found.append(
                Option(
                    recalled.grasp,
                    free[0],
                    (recalled.x, recalled.y, recalled.z, recalled.theta),
                    recalled,
                )
            )
    return options_found


def _rated(
    scene: Scene, remembered: Sequence[Remembered], openings: Sequence[float]
) -> list[PlanarGrasp | None]:
    """Return remembered grasps from above as they are now, None where the jaws cannot close."""
    assert isinstance(scene.gripper, ParallelGripper)
    at = np.array([(grasp.x, grasp.y, grasp.theta) for grasp in remembered])
    drafts = [
        PlanarGrasp(x, y, grasp.z, wrap_axis(theta), 0.0, opening, 0.0, "memory", scene.seed)
        for grasp, opening, (x, y, theta) in zip(
            remembered, openings, move_planar(scene.frame_from_upright, at).tolist(), strict=True
        )
    ]
    return rate_all(scene.footprint, scene.gripper, drafts, scene.neighbours)


def _in_space(scene: Scene, remembered: Sequence[Remembered]) -> list[Option]:
    """Return the grasps in space that this gripper can take as the object lies now.

    A pose is that of the point midway between the contacts, with the closing direction and the
    approach as axes, so that it says the same of every gripper.
    """
    hand, pose = scene.gripper, scene.frame_from_object
    remembered = [recalled for recalled in remembered if _suits(recalled, hand)]
    if pose is None or not remembered:
        return []
    support = float(scene.frame_from_upright[2, 3])
    around = scene.neighbours
    if around is not None:
        # Neighbours are measured from their support, poses from the origin of the scene's frame.
        around = around + np.array([0.0, 0.0, support])
    poses = np.stack([pose @ recalled.object_from_gripper for recalled in remembered])
    openings = np.array([_opening(recalled, hand) for recalled in remembered])
    room = room_around(poses, openings, hand, Surroundings(Support(support, clearance=0.0), around))
    options = []
    for recalled, placed, opening, clearance, is_free in zip(
        remembered,
        poses,
        openings.tolist(),
        room.clearance.tolist(),
        room.free.tolist(),
        strict=True,
    ):
        width = opening if recalled.width is None else recalled.width
        is_steep = tilt(placed @ _UPSIDE_DOWN) <= scene.max_tilt
        if is_free and hand.fits(width, 0.0) and is_steep:
            # What geometry thought of it; what its attempts say comes with the evidence and must
            # not be counted twice.
            scores = {"confidence": recalled.prior or 0.0, "clearance": clearance}
            grasp = GraspCandidate(placed, width, source="recalled", opening=opening, scores=scores)
            contacts = recalled.contacts
            if contacts is not None:
                contacts = contacts.within(recalled.object_from_gripper)
            options.append(
                Option(
                    recalled.grasp,
                    grasp,
                    (recalled.x, recalled.y, recalled.z, recalled.theta),
                    recalled,
                    quaternion=recalled.quaternion,
                    contacts=contacts,
                )
            )
    return options


def _suits(remembered: Remembered, hand: EndEffector) -> bool:
    """Tell whether contacts are ones of a hand: a lip seals where one at least as large did."""
    contacts = remembered.contacts
    if contacts is None or contacts.seal_radius is None:
        return True
    return hand.finger_width / 2 <= _LARGER * contacts.seal_radius


def _planned(
    scene: Scene, earlier: Sequence[PlanarGrasp | GraspCandidate], limit: int
) -> list[Option]:
    """Return the newly planned grasps that no known one covers."""
    pose = scene.frame_from_object
    object_from_frame = np.linalg.inv(scene.frame_from_upright if pose is None else pose)
    options: list[Option] = []
    for k, planned in enumerate(scene.planned[:limit]):
        placed = planned.frame_from_gripper
        if tilt(placed @ _UPSIDE_DOWN) > scene.max_tilt:
            continue
        if any(
            isinstance(old, GraspCandidate)
            and np.linalg.norm(old.centre - planned.centre) <= _MERGE_M
            and float(old.approach @ planned.approach) >= np.cos(_MERGE_RAD)
            for old in earlier
        ):
            continue
        in_object = object_from_frame @ placed
        (x, y, z), (qx, qy, qz, qw) = (part.tolist() for part in pose_from_matrix(in_object))
        contacts = contacts_of(planned, scene.gripper)
        options.append(
            Option(
                f"candidate:{k}",
                planned,
                (x, y, z, closing_yaw(in_object)),
                quaternion=(qx, qy, qz, qw),
                contacts=None if contacts is None else contacts.within(placed),
            )
        )
    return options


def _axes(option: Remembered | Trial | Option | None) -> Axes | None:
    """Return closing and approach direction of a grasp in space; None for one from above.

    Cups and three fingers are alike about their approach, so that it is both for them.
    """
    if option is None or option.quaternion is None:
        return None
    if isinstance(option, Option):
        pose = matrix_from_pose(np.array(option.in_object[:3]), np.array(option.quaternion))
    else:
        pose = option.object_from_gripper
    closing, approach = pose[:3, [0, 2]].T.tolist()
    is_round = isinstance(option, Option | Remembered) and option.contacts is not None
    return tuple(approach if is_round else closing), tuple(approach)


def _all_axes(
    candidates: Sequence[Option], evidence: Sequence[Remembered]
) -> NDArray[np.float64] | None:
    """Return closing and approach directions (n, 2, 3); None if all grasps are from above."""
    if not any(
        [option.quaternion for option in candidates] + [option.quaternion for option in evidence]
    ):
        return None
    flat = [
        ((np.cos(theta), np.sin(theta), 0.0), (0.0, 0.0, -1.0))
        for *_, theta in (option.in_object for option in candidates)
    ]
    return np.array([_axes(option) or f for option, f in zip(candidates, flat, strict=True)])


def _merged(
    proposed: Sequence[PlanarGrasp], earlier: Sequence[PlanarGrasp | GraspCandidate]
) -> NDArray[np.bool_]:
    """Return a mask (n,) of the proposed grasps that a known one from above covers."""
    old = [grasp for grasp in earlier if isinstance(grasp, PlanarGrasp)]
    if not proposed or not old:
        return np.zeros(len(proposed), dtype=bool)
    a, b = (np.array([(g.x, g.y, g.z, g.theta) for g in grasps]) for grasps in (proposed, old))
    off = a[:, None] - b[None]
    near = np.hypot(off[..., 0], off[..., 1]) <= _MERGE_M
    level = np.abs(off[..., 2]) <= _MERGE_M
    # Modulo half a turn, since jaws that are turned by it close alike.
    along = np.abs((off[..., 3] + np.pi / 2) % np.pi - np.pi / 2) <= _MERGE_RAD
    return np.asarray((near & level & along).any(axis=1))
