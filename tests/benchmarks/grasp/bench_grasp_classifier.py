"""Benchmark of grasp candidates on one noisy depth view: how often the first are right.

    python bench_grasp_classifier.py                    # small run, own shapes
    python bench_grasp_classifier.py --shapes 60 --tests 12 --ycb 2
    python bench_grasp_classifier.py --gripper nao --ycb 2
    python bench_grasp_classifier.py --views VIEWS.npz  # `simulate grasp-views`

A filter is trained on single views of generated shapes (seven families) and tried on shapes with
other seeds and, when it is there, on all of YCB (Calli et al. 2015; 78 meshes, `--ycb` views of
each), none of which it has met. A candidate is right when both jaws meet the whole mesh within
their friction cones and the gripper gets there free of object and table. An object counts as
graspable when sampling on its mesh, or any of the variants, finds a right grasp. The first five
differ from each other by more than 1 cm or 15 degrees.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.hand_search.classifier import GraspClassifier, GraspSamples, train
from grasp.spatial.hand_search.hand_search import propose_on
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.mesh_files import read_mesh
from grasp.spatial.scoring.select import diverse
from simulate.study.grasp_samples import collect_samples, shapes
from simulate.study.grasp_views import TABLE, View, correct, depth_view, sample_camera
from simulate.world.noise import SensorNoise

VARIANTS = ("geometry", "two views", "completion", "both", "boosting", "svm")
FIRST_TEST_SEED = 100_000


def ycb(views: int) -> Iterator[tuple[Mesh, int]]:
    """Yield meshes as they lie in their files, lowest point on the table, and view numbers."""
    folder = Path(os.environ.get("RTASK_SHARED_DATA", "shared/data")) / "ycb"
    if views and not folder.is_dir():
        print("skipped: ycb not found (78 meshes); set RTASK_SHARED_DATA to its parent")
        return
    for path in sorted(folder.glob("*/textured.obj")) if views else []:
        mesh = read_mesh(path)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        pose = np.eye(4)
        pose[:3, 3] = -(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]
        for view in range(views):
            yield mesh.moved(pose), view


def auc(score: np.ndarray, right: np.ndarray) -> float:
    """Return the area under the curve of hits over false alarms; ties count half."""
    _, inverse, counts = np.unique(score, return_inverse=True, return_counts=True)
    rank = np.cumsum(counts) - (counts - 1) / 2
    good = right.sum()
    wrong = len(right) - good
    return float((rank[inverse][right].sum() - good * (good + 1) / 2) / max(good * wrong, 1))


def calibration_error(probability: np.ndarray, right: np.ndarray, bins: int = 10) -> float:
    """Return the expected calibration error over equal bins (Guo et al. 2017)."""
    place = np.minimum((probability * bins).astype(int), bins - 1)
    return float(
        sum(
            abs(probability[place == b].mean() - right[place == b].mean()) * (place == b).mean()
            for b in range(bins)
            if (place == b).any()
        )
    )


def outcomes(
    mesh: Mesh,
    number: int,
    view: int,
    gripper: ParallelGripper,
    models: dict[str, GraspClassifier],
) -> tuple[bool, dict[str, np.ndarray]]:
    """Return whether the mesh is graspable, and which of the first five are right by variant."""
    rng = np.random.default_rng([7, number, view])
    seen = depth_view(mesh, sample_camera(rng), SensorNoise(), int(rng.integers(1 << 31)))
    plain = prepare_cloud(seen.points, table=TABLE, viewpoints=seen.viewpoint[None])
    whole = complete_by_symmetry(plain)
    fused = _from_two_sides(mesh, seen, rng)
    clouds = {"geometry": plain, "two views": fused, "both": complete_by_symmetry(fused)}
    found = {}
    for variant in ("geometry", "two views", "completion", "both", *models):
        proposals = propose_on(clouds.get(variant, whole), gripper, classifier=models.get(variant))
        found[variant] = correct(_first_five(list(proposals), gripper), mesh, gripper)
    known = propose_on_mesh(mesh, gripper, Surroundings(Support()))
    possible = bool(correct(list(known), mesh, gripper).any())
    return possible or any(right.any() for right in found.values()), found


def _from_two_sides(mesh: Mesh, seen: View, rng: np.random.Generator) -> SurfaceCloud:
    """Return the cloud of a second look from a quarter turn further, fused with the first."""
    x, y, z = seen.viewpoint
    other = depth_view(mesh, np.array([-y, x, z]), SensorNoise(), int(rng.integers(1 << 31)))
    return prepare_cloud(
        np.concatenate([seen.points, other.points]),
        table=TABLE,
        viewpoints=np.stack([seen.viewpoint, other.viewpoint]),
    )


def _first_five(candidates: list, gripper: ParallelGripper) -> list:
    # Whichever way round unequal jaws close, the judge decides the same.
    return diverse(candidates, replace(gripper, symmetric=True), most=5)


def table(name: str, results: list[tuple[bool, dict[str, np.ndarray]]]) -> None:
    possible = [found for graspable, found in results if graspable]
    print(f"\n{name}: {len(results)} views, graspable {len(possible)}")
    for variant in VARIANTS:
        if not possible or variant not in possible[0]:
            continue
        hits = np.array([found[variant].any() for found in possible])
        tops = np.array([found[variant][:1].any() for found in possible])
        every = np.concatenate([found[variant] for found in possible])
        error = 196 * np.sqrt(hits.mean() * (1 - hits.mean()) / len(hits))
        print(
            f"  {variant:<11} one of five right {100 * hits.mean():5.1f} % (+- {error:.1f}), "
            f"first right {100 * tops.mean():5.1f} %, precision of the five "
            f"{100 * every.mean():5.1f} %"
        )


def calibrate(samples: GraspSamples) -> None:
    """Print how often candidates were right by their geometric rank."""
    hand = np.isfinite(samples.geometry)
    for name, chosen in (("full", hand & ~samples.one_sided), ("half", hand & samples.one_sided)):
        edges = np.quantile(samples.geometry[chosen], np.linspace(0, 1, 9))
        for low, high in pairwise(edges):
            within = chosen & (samples.geometry >= low) & (samples.geometry <= high)
            print(f"  {name} {low:.2f} .. {high:.2f}: {samples.right[within].mean():.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--gripper", default="panda", help="nao, panda, jaw:STROKE")
    parser.add_argument("--shapes", type=int, default=8, help="of each family, to learn from")
    parser.add_argument("--tests", type=int, default=3, help="of each family, to test on")
    parser.add_argument("--ycb", type=int, default=0, help="views of each YCB mesh")
    parser.add_argument("--every", type=int, default=1, help="take every n-th YCB mesh")
    parser.add_argument("--views", type=Path, help="samples to learn from instead")
    parser.add_argument("--calibrate", action="store_true", help="print shares by geometric rank")
    parser.add_argument("--svm", action="store_true", help="also the linear machine")
    options = parser.parse_args()
    gripper = gripper_named(options.gripper)
    start = time.perf_counter()
    samples = (
        GraspSamples.load(options.views)
        if options.views
        else collect_samples(shapes(options.shapes), gripper)
    )
    print(
        f"{len(samples)} candidates on {len(np.unique(samples.objects))} objects, "
        f"{100 * samples.right.mean():.1f} % right, {time.perf_counter() - start:.0f} s"
    )
    if options.calibrate:
        calibrate(samples)
        return
    unseen = collect_samples(shapes(options.tests, FIRST_TEST_SEED), gripper)
    kinds = ("boosting", "svm") if options.svm else ("boosting",)
    models = {kind: train(samples, kind) for kind in kinds}
    hand = np.isfinite(unseen.geometry)
    print(
        f"on {len(unseen)} candidates of unseen shapes, {hand.sum()} of them hands, of which AUC "
        f"geometry {auc(unseen.geometry[hand], unseen.right[hand]):.3f}"
    )
    for kind, model in models.items():
        raw = model.score(unseen.statistics, unseen.pictures)
        p = model.probability(unseen.statistics, unseen.pictures)
        print(
            f"  {kind}: AUC {auc(raw, unseen.right):.3f}, calibration error "
            f"{calibration_error(p, unseen.right):.3f}"
        )
    own = [
        outcomes(mesh, number, 0, gripper, models)
        for number, mesh in enumerate(shapes(options.tests, FIRST_TEST_SEED))
    ]
    table("unseen shapes", own)
    known = [
        outcomes(mesh, number, view, gripper, models)
        for number, (mesh, view) in enumerate(ycb(options.ycb))
        if (number // max(options.ycb, 1)) % options.every == 0
    ]
    if known:
        table("YCB", known)
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
