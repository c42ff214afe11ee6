"""One object of the comparison: the picks of several rules, carried out under the same draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_mesh
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.scoring.confidence import Load, score_grasps
from grasp.spatial.scoring.select import rank_by_confidence
from simulate.study.quality.bench import Bench, draws, laid_out
from simulate.study.quality.objects import GraspObject, fits, generated, ycb_models
from simulate.study.quality.sampler import sampled_grasp
from simulate.world.seeds import mix_seed

__all__ = ["HANDS", "RULES", "quality_trial"]

HANDS = ("panda", "nao")
"""Hands of the comparison, in turn: 20 N and 2 N."""

RULES = ("planned", "confidence", "sampler")
"""First grasp of a plan; of the same planner ranked by s_G alone, without the central pairs; of the
trivial sampler."""

_PLAN = 41


def quality_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Carry out each rule's pick for one object; return the shares that held as JSON data."""
    seed, hand = int(settings["seed"]), HANDS[number % len(HANDS)]
    gripper, index = gripper_named(hand), number // len(HANDS)
    thing = _thing(settings, index, gripper)
    with laid_out(thing, str(settings["preset"])) as bench:
        picks = _picks(bench, gripper, mix_seed(seed, _PLAN, number))
        size = float(bench.mesh.extent.max())
        trials = draws(seed, number, int(settings["trials"]), size)
        outcomes: dict[str, dict[str, Any]] = {}
        for rule, (pick, promised) in picks.items():
            same = next((r for r in outcomes if _is_same(picks[r][0], pick)), None)
            if same is not None:
                done = {k: outcomes[same][k] for k in ("held", "carried")}
            else:
                held = bench.try_out(pick, gripper, trials)
                done = {
                    "held": [one.held for one in held],
                    "carried": [bool(one.carried) for one in held],
                }
            outcomes[rule] = {**done, "promised": promised}
    return {
        "hand": hand,
        "object": thing.name,
        "mass": round(thing.mass, 4),
        "rules": outcomes,
        "says": f"{hand} {thing.name}: "
        + ", ".join(f"{rule} {sum(o['carried'])}" for rule, o in outcomes.items()),
    }


def _thing(settings: Mapping[str, Any], index: int, gripper: ParallelGripper) -> GraspObject:
    """Return an object: generated and YCB models in turn, then whichever are left."""
    models = _models(str(settings["ycb"]), gripper) if settings["ycb"] else ()
    mine, theirs = divmod(index, 2)
    if theirs and mine < len(models):
        return models[mine]
    return generated(int(settings["seed"]), index, gripper)


@lru_cache(maxsize=len(HANDS))
def _models(folder: str, gripper: ParallelGripper) -> tuple[GraspObject, ...]:
    """Return every second model that a hand can hold; the others served to make the rule."""
    models = ycb_models(Path(folder))[1::2]
    return tuple(one for one in models if fits(one, gripper))


def _picks(
    bench: Bench, gripper: ParallelGripper, seed: int
) -> dict[str, tuple[GraspCandidate, dict[str, float]]]:
    """Return each rule's grasp in the object's frame, and what was promised of it."""
    found: dict[str, GraspCandidate | None] = {
        "planned": _planned(bench, gripper, seed),
        "confidence": _by_confidence(bench, gripper, seed),
        "sampler": _sampled(bench, gripper, seed),
    }
    return {
        rule: (one, {k: round(float(v), 4) for k, v in one.scores.items()})
        for rule, one in found.items()
        if one is not None
    }


def _planned(bench: Bench, gripper: ParallelGripper, seed: int) -> GraspCandidate | None:
    options = SpatialOptions(mass=bench.thing.mass, seed=seed)
    return next(iter(plan_on_mesh(bench.mesh, gripper, bench.around, options)), None)


def _by_confidence(bench: Bench, gripper: ParallelGripper, seed: int) -> GraspCandidate | None:
    around = bench.around
    found = propose_on_mesh(bench.mesh, gripper, around, central=0, seed=seed)
    assert around.support is not None
    load = Load(bench.thing.mass, around.support.normal)
    scored = score_grasps(
        list(found), bench.mesh, gripper, sweep=around.sweep, load=load, seed=seed
    )
    return next(iter(rank_by_confidence(scored)), None)


def _sampled(bench: Bench, gripper: ParallelGripper, seed: int) -> GraspCandidate | None:
    world_from_object = bench.world_from_object
    rotation, origin = world_from_object[:3, :3], world_from_object[:3, 3]
    standing = bench.mesh.vertices @ rotation.T + origin
    com = rotation @ bench.mesh.com + origin
    found = sampled_grasp(standing, bench.mesh.faces, com, gripper, 0.0, seed)
    if found is None:
        return None
    pose = np.linalg.inv(world_from_object) @ found.frame_from_gripper
    return replace(found, frame_from_gripper=pose)


def _is_same(a: GraspCandidate, b: GraspCandidate) -> bool:
    return bool(np.array_equal(a.frame_from_gripper, b.frame_from_gripper)) and (
        a.opening == b.opening
    )
