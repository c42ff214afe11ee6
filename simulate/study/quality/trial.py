"""One object of the comparison: the picks of several rules, carried out under the same draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_mesh
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.scoring.confidence import Load, score_grasps
from grasp.spatial.scoring.select import rank_by_confidence
from simulate.study.quality.bench import Bench, Draw, draws, laid_out
from simulate.study.quality.made_hands import made_hand, studied_hand
from simulate.study.quality.objects import GraspObject, fits, generated, heaviest
from simulate.study.quality.public_models import public_model, ycb_models
from simulate.study.quality.sampler import sampled_grasp
from simulate.study.quality.varied_objects import varied
from simulate.world.seeds import mix_seed, stream

__all__ = ["HANDS", "RULES", "quality_trial"]

HANDS = ("panda", "nao")
"""Hands of the comparison, in turn: 20 N and 2 N."""

RULES = ("planned", "confidence", "sampler")
"""First grasp of a plan; of the same planner ranked by s_G alone, without the central pairs; of the
trivial sampler."""

_PLAN, _LOAD = 41, 77
_HEAVY_SHARE, _HEAVY = 1 / 3, (0.05, 0.9)


def quality_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Carry out each rule's pick for one object; return the shares that held as JSON data."""
    seed = int(settings["seed"])
    hand, item = _hand_and_object(settings, number)
    gripper = studied_hand(hand)
    with laid_out(item, str(settings["preset"])) as bench:
        choice = mix_seed(seed, _PLAN, number)
        plan = plan_on_mesh(
            bench.mesh, gripper, bench.around, SpatialOptions(mass=bench.item.mass, seed=choice)
        )
        picks = _picks(bench, plan, gripper, choice, bool(settings.get("alone", False)))
        # Alone, the sampler says only whether what has no plan could be grasped at all.
        graspable = bool(picks) or _sampled(bench, gripper, choice) is not None
        size = float(bench.mesh.extent.max())
        trials = draws(seed, number, int(settings["trials"]), size)
        outcomes: dict[str, dict[str, Any]] = {}
        for rule, (pick, promised) in picks.items():
            same = next((r for r in outcomes if _is_same(picks[r][0], pick)), None)
            if same is not None:
                done = {k: outcomes[same][k] for k in ("held", "carried")}
            else:
                done = _tried(bench, pick, gripper, trials)
            outcomes[rule] = {**done, "promised": promised}
        ranked = [
            {**{k: round(float(candidate.scores[k]), 4)
                for k in ("lift", "carry", "load", "taper")},
             **_tried(bench, candidate, gripper, trials[:1] if settings.get("made") else trials)}
            for candidate in _others(plan, settings, number)
        ]  # fmt: skip
    return {
        "hand": hand,
        "object": item.name,
        "mass": round(item.mass, 4),
        "graspable": graspable,
        "rules": outcomes,
        "ranked": ranked,
        "says": f"{hand} {item.name}: "
        + ", ".join(f"{rule} {sum(o['carried'])}" for rule, o in outcomes.items()),
    }


def _hand_and_object(settings: Mapping[str, Any], number: int) -> tuple[str, GraspObject]:
    """Return the name of the hand of a trial, and its object."""
    made = int(settings.get("made", 0))
    if not made:
        hand = HANDS[number % len(HANDS)]
        return hand, _object_of_trial(settings, number // len(HANDS), gripper_named(hand))
    seed = int(settings["seed"])
    gripper = made_hand(seed, number % made)
    if settings.get("varied"):
        return gripper.name, varied(seed, number, gripper)
    item = generated(seed, number, gripper)
    share, _ = _load_of_trial(seed, number)
    if share is not None:
        item = replace(item, mass=share * heaviest(gripper))
    return gripper.name, item


def _load_of_trial(seed: int, number: int) -> tuple[float | None, np.random.Generator]:
    """Return the weight over what friction bears of every third object, and what draws on.

    It goes beyond what is common, so that the tail is in the fit.
    """
    rng = stream(seed, _LOAD, number)
    is_heavy = rng.random() < _HEAVY_SHARE
    return float(np.exp(rng.uniform(*np.log(_HEAVY)))) if is_heavy else None, rng


def _object_of_trial(
    settings: Mapping[str, Any], index: int, gripper: ParallelGripper
) -> GraspObject:
    """Return an object: generated and YCB models in turn, then whichever are left.

    With a folder of other public models, none but these.
    """
    if settings.get("public"):
        return public_model(Path(settings["public"]), int(settings["seed"]), index, gripper)
    models = _models(str(settings["ycb"]), gripper) if settings["ycb"] else ()
    mine, theirs = divmod(index, 2)
    if theirs and mine < len(models):
        return models[mine]
    maker = varied if settings.get("varied") else generated
    return maker(int(settings["seed"]), index, gripper)


@lru_cache(maxsize=len(HANDS))
def _models(folder: str, gripper: ParallelGripper) -> tuple[GraspObject, ...]:
    """Return every second model that a hand can hold; the others served to make the rule."""
    models = ycb_models(Path(folder))[1::2]
    return tuple(model for model in models if fits(model, gripper))


def _tried(
    bench: Bench, pick: GraspCandidate, gripper: ParallelGripper, trials: Sequence[Draw]
) -> dict[str, list[bool]]:
    """Carry out a grasp under each draw; return what was lifted and what was carried."""
    held = bench.try_out(pick, gripper, trials)
    return {
        "held": [trial.held for trial in held],
        "carried": [bool(trial.carried) for trial in held],
    }


def _others(plan: Proposals, settings: Mapping[str, Any], number: int) -> list[GraspCandidate]:
    """Return further grasps of a plan: one below its first for a fit, else as many as asked."""
    if not settings.get("made"):
        return _spread(plan, int(settings.get("ranked", 0)))
    ranked = list(plan)
    if len(ranked) < 2:
        return []
    _, rng = _load_of_trial(int(settings["seed"]), number)
    return [ranked[int(rng.integers(1, len(ranked)))]]


def _spread(plan: Proposals, count: int) -> list[GraspCandidate]:
    """Return so many grasps of a plan, evenly from its best to its worst."""
    ranked = list(plan)
    places = np.linspace(0, len(ranked) - 1, min(count, len(ranked))).round().astype(int)
    return [ranked[k] for k in places]


def _picks(
    bench: Bench, plan: Proposals, gripper: ParallelGripper, seed: int, alone: bool
) -> dict[str, tuple[GraspCandidate, dict[str, float]]]:
    """Return each rule's grasp in the object's frame, and what was promised of it.

    With ``alone`` the planned grasp only.
    """
    picks: dict[str, GraspCandidate | None] = {"planned": next(iter(plan), None)}
    if not alone:
        picks["confidence"] = _by_confidence(bench, gripper, seed)
        picks["sampler"] = _sampled(bench, gripper, seed)
    return {
        rule: (pick, {k: round(float(v), 4) for k, v in pick.scores.items()})
        for rule, pick in picks.items()
        if pick is not None
    }


def _by_confidence(bench: Bench, gripper: ParallelGripper, seed: int) -> GraspCandidate | None:
    around = bench.around
    proposals = propose_on_mesh(bench.mesh, gripper, around, central=0, seed=seed)
    assert around.support is not None
    load = Load(bench.item.mass, around.support.normal)
    scored = score_grasps(
        list(proposals), bench.mesh, gripper, sweep=around.sweep, load=load, seed=seed
    )
    return next(iter(rank_by_confidence(scored)), None)


def _sampled(bench: Bench, gripper: ParallelGripper, seed: int) -> GraspCandidate | None:
    world_from_object = bench.world_from_object
    rotation, origin = world_from_object[:3, :3], world_from_object[:3, 3]
    standing = bench.mesh.vertices @ rotation.T + origin
    com = rotation @ bench.mesh.com + origin
    sampled = sampled_grasp(standing, bench.mesh.faces, com, gripper, 0.0, seed)
    if sampled is None:
        return None
    pose = np.linalg.inv(world_from_object) @ sampled.frame_from_gripper
    return replace(sampled, frame_from_gripper=pose)


def _is_same(a: GraspCandidate, b: GraspCandidate) -> bool:
    return bool(np.array_equal(a.frame_from_gripper, b.frame_from_gripper)) and (
        a.opening == b.opening
    )
