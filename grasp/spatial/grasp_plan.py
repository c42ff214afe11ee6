"""Planning of grasps in space: candidates, their confidence and epsilon, diverse ones first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import compare_symmetries, complete_by_symmetry
from grasp.spatial.clouds.ground import find_support
from grasp.spatial.clouds.shape_samples import ShapeSamples, sample_shapes
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.shipped import Filter, chosen_filter
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.confidence import Load, PoseNoise, Quality, Weighting, score_grasps
from grasp.spatial.scoring.features import body_of, with_features
from grasp.spatial.scoring.holding import with_holding
from grasp.spatial.scoring.object_load import ObjectLoad
from grasp.spatial.scoring.promises import Promises
from grasp.spatial.scoring.select import diverse, hedged, rank
from grasp.spatial.scoring.shape_chance import with_shape_chance

__all__ = ["SpatialOptions", "plan_given", "plan_on_cloud", "plan_on_mesh", "warm_up"]


_BODY_POINTS = 1500
_HALF = 0.5
_MAX_PAIRS = 60


@dataclass(frozen=True)
class SpatialOptions:
    """Options of planning grasps in space.

    Parameters
    ----------
    noise
        Of the object's pose relative to the gripper.
    samples
        Perturbed poses for each candidate.
    quality, weighting
        See :func:`grasp.spatial.scoring.confidence.confidences`.
    mass
        Of the object, kg, where it is known: its weight must be held too. Grasps of a mesh of
        unknown mass are ordered as if it were as heavy as wood.
    tries
        Points drawn on a mesh, or a tenth as many hands tried on a cloud.
    reachable
        Tells early whether a robot can bring its gripper to a pose (4, 4); None = all.
    most
        Candidates in the result.
    seed
        Of every draw.
    hedge
        Whether grasps of what is seen alone follow those of a completed cloud, in turns; without
        them a plan on one view takes less time and trusts the guess.
    pairs
        Whether opposed contacts on the surface of a cloud are looked for besides hands that fit it.
    find_support
        Whether a table that was left in a cloud is taken for its support where none is given.
    promises
        What is promised of a hand, grown from its outcomes; None = that of a hand without any.
    shapes
        Samples of the shape that a cloud seen from some sides may have, over which its grasps are
        ranked, e.g. 24; 0 = ranked on one guess of it. Not for meshes, nor where a filter ranks.
    """

    noise: PoseNoise = field(default_factory=PoseNoise)
    samples: int = 100
    quality: Quality = "closure"
    weighting: Weighting = "plain"
    mass: float | None = None
    tries: int = 2000
    reachable: Callable[[FloatArray], bool] | None = None
    most: int = 50
    seed: int = 0
    hedge: bool = True
    pairs: bool = True
    find_support: bool = True
    promises: Promises | None = None
    shapes: int = 0

    def __post_init__(self) -> None:
        if self.mass is not None and not 0 < self.mass < np.inf:
            raise ValueError(f"mass: expected a finite number above 0, got {self.mass}")
        for name in ("samples", "tries", "most"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")
        if self.shapes < 0:
            raise ValueError(f"shapes: expected 0 or more samples, got {self.shapes}")


def plan_on_mesh(
    mesh: Mesh,
    gripper: ParallelGripper,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
) -> Proposals:
    """Plan grasps of a mesh.

    Parameters
    ----------
    mesh
        Of the object; the result is in its frame.
    surroundings
        Support and neighbours in that frame; None = the object floats alone.

    Returns
    -------
    Proposals
        Ranked, with scores and features; without candidates it says why.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> on_table = Surroundings(Support(-0.05))
    >>> best = plan_on_mesh(box_mesh((0.04, 0.12, 0.1)), panda_hand(), on_table)[0]
    >>> round(best.width, 2), best.scores["lift_chance"] > 0.8
    (0.04, True)
    """
    options = options or SpatialOptions()
    around = surroundings or Surroundings()
    proposals = propose_on_mesh(
        mesh, gripper, around, tries=options.tries, noise=options.noise, seed=options.seed
    )
    if not proposals:
        return proposals
    load = ObjectLoad.of(mesh, options.mass, around.support)
    proposals = replace(proposals, notes=(*proposals.notes, *load.notes))
    points, _ = mesh.sample(_BODY_POINTS, np.random.default_rng(options.seed))
    return _ranked(
        proposals, mesh, points, gripper, around.support, options, around.sweep, load.mass
    )


def plan_given(
    candidates: Sequence[GraspCandidate],
    mesh: Mesh,
    gripper: ParallelGripper,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
) -> Proposals:
    """Rank given grasps of a mesh, as from another planner or a data set, like planned ones.

    Parameters
    ----------
    candidates
        In the mesh's frame, with contacts; see :func:`grasp.spatial.interchange.with_contacts`.
    """
    options = options or SpatialOptions()
    around = surroundings or Surroundings()
    if len(mesh.faces) == 0:
        return Proposals(reason="the mesh has no face", notes=mesh.notes)
    if not candidates:
        return Proposals(reason="no given grasp closes on the object")
    poses = np.stack([c.frame_from_gripper for c in candidates])
    openings = np.array([c.opening or gripper.max_opening for c in candidates])
    room = room_around(poses, openings, gripper, around, mesh)
    counts = {"free": int(room.free.sum()), **room.hits()}
    free = [
        replace(candidate, scores={**candidate.scores, "clearance": float(away)})
        for candidate, is_free, away in zip(candidates, room.free, room.clearance, strict=True)
        if is_free
    ]
    if not free:
        reason = "the gripper would touch something on its way to every given grasp"
        return Proposals(reason=reason, counts=counts)
    mass = ObjectLoad.of(mesh, options.mass, around.support).mass
    points, _ = mesh.sample(_BODY_POINTS, np.random.default_rng(options.seed))
    proposals = Proposals(tuple(free), counts=counts)
    return _ranked(proposals, mesh, points, gripper, around.support, options, around.sweep, mass)


def plan_on_cloud(
    points: FloatArray,
    gripper: ParallelGripper,
    support: Support | None = None,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
    classifier: Filter = None,
) -> Proposals:
    """Plan grasps of what a cloud shows, its hidden side completed where that is possible.

    Parameters
    ----------
    points : (n, 3), m
        Of one object.
    support
        In the frame of the points; None = none, unless the cloud shows one: a note says so.
    viewpoints : (k, 3) or None, m
        Where cameras were; None = seen from all around.
    classifier
        Filter of this gripper's candidates, whose probability counts in the order; ``shipped`` =
        the one that comes with the package for the gripper; None = none.

    Notes
    -----
    The confidence is that of small squares around the points, seen and completed. A grasp of which
    one side alone is known (label ``half``) counts half. Where a hidden side was completed, three
    grasps of the completed cloud are followed by two of what is seen alone, and so on: the guess
    may be wrong. Without a filter the best hand that fits comes first, pairs of contacts from the
    second place on; a filter tells by itself which pairs come before hands. With
    :attr:`SpatialOptions.shapes` all are ranked together by how likely they lift and carry what the
    object may be (:mod:`grasp.spatial.scoring.shape_chance`).
    Grasps that differ from a better one by half a turn about the approach come last.
    """
    from grasp.spatial.hand_search.hand_search import propose_on
    from grasp.spatial.hand_search.surface_pairs import propose_pairs

    options = options or SpatialOptions()
    shown = find_support(points) if support is None and options.find_support else None
    support = support if shown is None else shown.support
    notes = () if shown is None else (shown.note,)
    table = None if support is None else support.plane
    seen = prepare_cloud(points, table=table, viewpoints=viewpoints)
    # Compared once: completion and sampled shapes both start from them.
    guesses = compare_symmetries(seen)
    whole = complete_by_symmetry(seen, guesses)
    judge = chosen_filter(classifier, gripper)
    up = None if support is None else support.up

    def plan(cloud: SurfaceCloud) -> tuple[Proposals, Proposals]:
        surface = cloud.surface()
        body = cloud.points[cloud.target]
        hands = propose_on(
            cloud, gripper, max(options.tries // 10, 1), options.seed, classifier=judge
        )
        pairs = Proposals()
        if options.pairs and not cloud.reason:
            pairs = propose_pairs(
                cloud, surface, gripper, support, options.noise, options.tries, options.seed
            )
            shortlist = pairs.candidates[:_MAX_PAIRS]
            if judge is not None:
                shortlist = tuple(judge.judged(cloud, shortlist, gripper))
            pairs = replace(pairs, candidates=shortlist)
        ranked = [
            _ranked(proposals, surface, body, gripper, support, options) if proposals else proposals
            for proposals in (hands, pairs)
        ]
        return ranked[0], ranked[1]

    hands, pairs = plan(whole)
    # Without a filter scores of hands and of pairs are not comparable: the best hand stays first.
    ahead = 1 if judge is None else 0
    guessed = [*hands.candidates[:ahead], *rank([*hands.candidates[ahead:], *pairs], up)]
    safe: list[GraspCandidate] = []
    # Only where something was guessed: else both plans would be the same.
    if options.hedge and whole.completed.any():
        seen_hands, seen_pairs = plan(seen)
        safe = rank([*seen_hands, *seen_pairs], up)
    shapes = None
    if options.shapes and judge is None:
        shapes = sample_shapes(seen, points, options.shapes, options.seed, guesses)
    if shapes is not None:
        guessed = rank(_over_shapes([*guessed, *safe], shapes, gripper, options), up)
        safe = []
    elif options.shapes:
        why = (
            "a filter ranks the grasps" if judge is not None else "needs a support and a viewpoint"
        )
        notes = (*notes, f"no shapes were sampled: {why}")
    both = hedged(guessed, safe, gripper, options.most)
    counts = {**hands.counts, **({"pairs": pairs.counts["pairs"]} if pairs else {})}
    reason = "" if both else hands.reason
    notes = (*notes, *hands.notes)
    return replace(hands, candidates=tuple(both), counts=counts, reason=reason, notes=notes)


def _over_shapes(
    candidates: Sequence[GraspCandidate],
    shapes: ShapeSamples,
    gripper: ParallelGripper,
    options: SpatialOptions,
) -> list[GraspCandidate]:
    return with_shape_chance(
        candidates, shapes, gripper, options.mass, options.noise, seed=options.seed,
        promises=options.promises,
    )  # fmt: skip


def warm_up() -> None:
    """Compile the kernels; they are kept on disk."""
    from grasp.spatial.gripper import panda_hand
    from grasp.spatial.meshes.shapes import box_mesh

    box, few = box_mesh((0.04, 0.06, 0.08)), SpatialOptions(samples=2, tries=50)
    points, _ = box.sample(2000, np.random.default_rng(0))
    around = Surroundings(Support(-0.04), points + 1.0)
    plan_on_mesh(box, panda_hand(), around, few)
    camera = np.array([[0.4, 0.0, 0.4]])
    plan_on_cloud(points, panda_hand(), Support(-0.04), camera, replace(few, shapes=2))


def _ranked(
    proposals: Proposals,
    surface: Mesh,
    points: FloatArray,
    gripper: ParallelGripper,
    support: Support | None,
    options: SpatialOptions,
    sweep: float | None = None,
    mass: float | None = None,
) -> Proposals:
    """Return the proposals scored and ranked: by holding where a mass is given.

    Clouds show one side well and guess the other: their patches say too little about holding.
    """
    within = list(proposals)
    if options.reachable is not None:
        within = [c for c in proposals if options.reachable(c.frame_from_gripper)]
    if not within:
        return replace(proposals, candidates=(), reason="every candidate is out of reach")
    load = None
    if options.mass is not None:
        load = Load(options.mass, (0.0, 0.0, 1.0) if support is None else support.normal)
    scored = score_grasps(
        within, surface, gripper, options.noise, samples=options.samples,
        quality=options.quality, weighting=options.weighting, sweep=sweep, load=load,
        seed=options.seed,
    )  # fmt: skip
    scored = [_honest(c) for c in scored]
    if mass is not None and options.quality == "closure":
        scored = with_holding(
            scored, surface, gripper, mass, options.noise, samples=options.samples,
            seed=options.seed, promises=options.promises,
        )  # fmt: skip
    up = None if support is None else support.up
    chosen = diverse(rank(scored, up), gripper, most=options.most)
    body = body_of(points)
    return replace(
        proposals, candidates=tuple(with_features(c, body, gripper, support) for c in chosen)
    )


def _honest(candidate: GraspCandidate) -> GraspCandidate:
    """Return the candidate with less confidence where half of it was not seen."""
    if candidate.antipodal != "half":
        return candidate
    scores = dict(candidate.scores)
    for name in ("confidence", "lower_95"):
        scores[name] = _HALF * scores.get(name, 0.0)
    return replace(candidate, scores=scores)
