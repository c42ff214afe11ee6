"""Benchmark of poses of known objects: failures, errors and time.

    python bench_pose.py                     # 8 scenes, true and predicted masks
    python bench_pose.py --scenes 100:130    # more of them
    python bench_pose.py --starts 72         # a faster search
    python bench_pose.py --views 1 2 4 8     # against models that grow
    python bench_pose.py --views 8 --prints  # of things that carry print
    python bench_pose.py --ycb FOLDER        # of YCB objects
    python bench_pose.py --fit               # refit the confidence
    python bench_pose.py --bop FOLDER        # a dataset of the BOP benchmark

Tables of ``tabletop_scenes.py``, kind ``normal``: occluding, mostly strongly concave objects, of
which at least 400 px are visible; identity and model known. A pose is right within 5 mm and 5
degrees, modulo symmetry. Predicted masks are what the segmenter gives, the segment of best overlap
standing for its object; an object that it misses counts as a failure. The peer is multi-start ICP
without free space, merging and collected points; with ``--views`` it is the mesh. Those views are
spread over the sphere around the object, in random order, at half a metre, with the noise of the
same camera; how the camera stood is known with errors of 2 mm and 1 degree, as on a turntable.
Each thing has a model of its own, grown in colour, and keypoints of its views give a pose to begin
with, as in the product; things of one colour have next to none. With ``--prints`` every thing
carries a print that no other has, in the scenes and on the turntable; meshes then know their
colours. With ``--textures`` those of YCB objects know their own.
``--save-plot`` draws how poses get better with every view. AR is the average recall of the BOP
benchmark over VSD, MSSD and MSPD; ``--bop`` measures it on a dataset in that benchmark's layout,
with the true masks of the visible pixels (``--split``, ``--results`` CSV). Intervals are Wilson's
at 95 %.
"""

from __future__ import annotations

import argparse
import pickle
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from features.pose import (
    AxisCheck,
    PoseEstimate,
    PoseModel,
    PoseParams,
    axis_check,
    build_pose_model,
    estimate_pose,
    pose_error,
)
from features.segmentation import SegmentParams, segment_scene
from simulate.study.chart import Line, line_chart
from tests.benchmarks.perception.bop.dataset import BopDataset, BopEstimate, BopModel, write_results
from tests.benchmarks.perception.bop.metrics import BopErrors, average_recall, bop_errors
from tests.benchmarks.perception.pose_models import GrownModels, Models, painted
from tests.benchmarks.perception.tabletop_scenes import TableScene, Thing, make_scene

MIN_PX = 400
CONCAVE = SegmentParams(tolerance_deg=35, bad_sanity=0.10, min_points=60)


@dataclass(frozen=True)
class Trial:
    """One object in one scene."""

    source: str
    overlap: float
    estimate: PoseEstimate | None
    is_right: bool
    add_s_ok: bool
    surface_m: float
    errors: tuple[float, float]
    seconds: float
    bop: BopErrors | None = None
    axis: AxisCheck | None = None


def scenes_of(seeds: range, cache: Path | None, ycb: Path | None = None) -> list[TableScene]:
    """Make the scenes, of YCB objects where their folder is given, or read them from a cache."""
    found, kind = [], "normal" if ycb is None else "ycb"
    for seed in seeds:
        known = None if cache is None else cache / f"{kind}-{seed}.pickle"
        if known is not None and known.is_file():
            found.append(pickle.loads(known.read_bytes()))
            continue
        found.append(make_scene(kind, seed, ycb))
        if known is not None:
            known.parent.mkdir(parents=True, exist_ok=True)
            known.write_bytes(pickle.dumps(found[-1]))
    return found


def predicted(scene: TableScene) -> np.ndarray:
    """Segment a scene."""
    cut = segment_scene(scene.frame.points(), scene.frame.rgb, CONCAVE, scene.down)
    return cut.labels


def best_overlap(labels: np.ndarray, mask: np.ndarray) -> tuple[int, float]:
    """Return the segment that overlaps a mask best, and by how much (IoU)."""
    shares = []
    for number in np.unique(labels[mask & (labels > 0)]).tolist():
        mine = labels == number
        shares.append((float((mine & mask).sum() / (mine | mask).sum()), number))
    overlap, number = max(shares, default=(0.0, 0))
    return number, overlap


def run(scenes: list[TableScene], models: Models, params: PoseParams, masks: str) -> list[Trial]:
    """Estimate every pose that is asked for."""
    trials = []
    for scene in scenes:
        visible = scene.frame.depth_m > 0
        labels = np.where(visible, np.maximum(scene.labels, 0), 0).astype(np.int32)
        cut = predicted(scene) if masks == "predicted" else labels
        for thing in scene.things:
            if thing.pixels < MIN_PX:
                continue
            number, overlap = best_overlap(cut, labels == thing.number)
            estimate, seconds = None, 0.0
            model, stored = models.of(thing), models.stored(scene, thing)
            if number:
                begun = models.begun(scene, thing, cut == number)
                start = time.thread_time()
                estimate = estimate_pose(
                    stored, scene.frame, cut, number, params, scene.plane, begun, begun is not None
                )
                seconds = time.thread_time() - start
            trial = _trial(thing, model, overlap, estimate, seconds)
            if estimate is not None:
                seen = replace(scene.frame, mask=cut == number)
                axis = axis_check(stored, seen, estimate.camera_from_object)
                trial = replace(trial, bop=_bop(scene, thing, model, estimate), axis=axis)
            trials.append(trial)
    return trials


def _bop(scene: TableScene, thing: Thing, model: PoseModel, estimate: PoseEstimate) -> BopErrors:
    vertices, faces = thing.load()
    turns = np.repeat(np.eye(4)[None], len(model.symmetries), axis=0)
    turns[:, :3, :3] = model.symmetries
    turns[:, :3, 3] = model.centre - model.symmetries @ model.centre
    return bop_errors(
        estimate.camera_from_object, thing.camera_from_mesh, (vertices, faces), turns,
        scene.frame.intrinsics, scene.frame.depth_m, model.diameter_m,
    )  # fmt: skip


def run_bop(folder: Path, split: str, params: PoseParams, results: Path | None) -> None:
    """Measure a dataset in the layout of the BOP benchmark, with its true masks."""
    dataset = BopDataset(folder)
    models: dict[int, tuple[BopModel, PoseModel]] = {}
    errors: list[BopErrors | None] = []
    estimates: list[BopEstimate] = []
    for scene in dataset.scenes(split):
        for view in dataset.views(scene, split):
            for thing in view.objects:
                if thing.mask is None or thing.mask.sum() < MIN_PX:
                    continue
                if thing.object_id not in models:
                    mesh = dataset.model(thing.object_id)
                    known = build_pose_model(mesh.vertices, mesh.faces)
                    models[thing.object_id] = (mesh, known)
                mesh, known = models[thing.object_id]
                labels = thing.mask.astype(np.int32)
                start = time.thread_time()
                found = estimate_pose(known, view.frame, labels, 1, params)
                seconds = time.thread_time() - start
                if found is None:
                    errors.append(None)
                    continue
                pose = found.camera_from_object
                errors.append(
                    bop_errors(
                        pose, thing.camera_from_object, (mesh.vertices, mesh.faces),
                        mesh.symmetries, view.frame.intrinsics, view.frame.depth_m, mesh.diameter_m,
                    )
                )  # fmt: skip
                where = scene, view.image_id, thing.object_id
                estimates.append(BopEstimate(*where, found.confidence, pose, seconds))
    recall = average_recall(errors)
    print(
        f"{len(errors)} targets: AR {recall.mean:.3f} "
        f"(VSD {recall.vsd:.3f}, MSSD {recall.mssd:.3f}, MSPD {recall.mspd:.3f})"
    )
    if results is not None:
        write_results(results, estimates)


def _trial(
    thing: Thing, model: PoseModel, overlap: float, estimate: PoseEstimate | None, seconds: float
) -> Trial:
    if estimate is None:
        return Trial(thing.source, overlap, None, False, False, np.inf, (np.inf, np.inf), seconds)
    error = pose_error(model, estimate.camera_from_object, thing.camera_from_mesh)
    return Trial(
        thing.source,
        overlap,
        estimate,
        error.is_within(),
        error.add_s_m < 0.005,
        error.surface_m,
        (error.translation_m, float(np.rad2deg(error.rotation_rad))),
        seconds,
    )


def _share(of: np.ndarray) -> float:
    return float(of.mean()) if len(of) else float("nan")


def wilson(held: int, of: int) -> str:
    """Return a share with its 95 % interval (Wilson 1927)."""
    if not of:
        return "none"
    share, z = held / of, 1.96
    middle = (share + z * z / (2 * of)) / (1 + z * z / of)
    reach = z / (1 + z * z / of) * np.sqrt(share * (1 - share) / of + z * z / (4 * of * of))
    return f"{share:.3f} [{max(middle - reach, 0.0):.3f}, {min(middle + reach, 1.0):.3f}]"


def report(title: str, trials: list[Trial], threshold: float) -> None:
    """Print one line."""
    right = np.array([t.is_right for t in trials])
    took = 1e3 * np.array([t.seconds for t in trials if t.estimate is not None])
    accepted = np.array([bool(t.estimate and t.estimate.confidence >= threshold) for t in trials])
    errors = np.array([t.errors for t in trials])[right]
    recall = average_recall([t.bop for t in trials])
    print(
        f"{title:32s} failure {wilson(int((~right).sum()), len(right))} of {len(right)}, "
        f"AR {recall.mean:.3f} "
        f"(VSD {recall.vsd:.3f} MSSD {recall.mssd:.3f} MSPD {recall.mspd:.3f}), "
        f"ADD-S {np.mean([t.add_s_ok for t in trials]):.3f}, median error "
        f"{1e3 * np.median(errors[:, 0]):.1f} mm {np.median(errors[:, 1]):.1f} deg, "
        f"accepted {accepted.mean():.2f}, of these right "
        f"{wilson(int(right[accepted].sum()), int(accepted.sum()))}, "
        f"CPU ms median {np.median(took):.0f} p95 {np.percentile(took, 95):.0f}",
        flush=True,
    )
    fits = right | np.array([t.surface_m < 0.005 for t in trials])
    print(
        f"{'':32s} wrong by 5 mm and 5 degrees, and more than 5 mm of surface "
        f"{wilson(int((~fits).sum()), len(fits))}, of the accepted fit "
        f"{wilson(int(fits[accepted].sum()), int(accepted.sum()))}"
    )
    judged = np.array([t.axis is not None for t in trials])
    refused = np.array([t.axis is not None and not t.axis.passes for t in trials])
    print(
        f"{'':32s} axis check (Kehoe 2014, 4.6) rejects of the right "
        f"{wilson(int((refused & right).sum()), int((judged & right).sum()))}, of the wrong "
        f"{wilson(int((refused & ~right).sum()), int((judged & ~right).sum()))}"
    )


def draw(curves: dict[str, dict[int, list[Trial]]], known: dict[int, float], path: Path) -> None:
    """Draw what gets better with every view, with 95 % intervals (Wilson 1927)."""
    lines = []
    for masks, by_count in curves.items():
        share = np.array([np.mean([t.is_right for t in seen]) for seen in by_count.values()])
        n = np.array([len(seen) for seen in by_count.values()])
        middle = (share + 1.92 / n) / (1 + 3.84 / n)
        reach = 1.96 / (1 + 3.84 / n) * np.sqrt(share * (1 - share) / n + 0.96 / n**2)
        name = f"poses right, {masks} masks"
        low, high = (middle - reach).tolist(), (middle + reach).tolist()
        lines.append(Line(name, list(by_count), share.tolist(), low, high))
    lines.append(Line("surface known", list(known), list(known.values())))
    line_chart(path, "An object's model after so many views", "views", "share", lines)


def refit(trials: list[Trial]) -> None:
    """Print logistic weights of fit and violation, fitted by Newton's method."""
    rows = [(t.estimate.fit, t.estimate.violation, 1.0) for t in trials if t.estimate]
    right = np.array([t.is_right for t in trials if t.estimate], float)
    x, w = np.array(rows), np.zeros(3)
    for _ in range(50):
        p = 1 / (1 + np.exp(-x @ w))
        step = x.T @ (right - p) - 0.05 * w * (1, 1, 0)
        w += np.linalg.solve(
            (x * (p * (1 - p))[:, None]).T @ x + 0.05 * np.diag([1, 1, 1e-6]), step
        )
    p = 1 / (1 + np.exp(-x @ w))
    brier = np.mean((p - right) ** 2)
    print(f"fit {w[0]:.2f} violation {w[1]:.2f} offset {w[2]:.2f}; Brier {brier:.3f}")


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", default="100:108", help="seeds, first:last")
    parser.add_argument("--starts", type=int, default=PoseParams().starts)
    parser.add_argument("--masks", choices=("true", "predicted", "both"), default="both")
    parser.add_argument("--views", type=int, nargs="*", default=[], help="numbers of stored views")
    parser.add_argument("--prints", action="store_true", help="every thing carries print")
    parser.add_argument("--textures", action="store_true", help="meshes know their texture")
    parser.add_argument("--ycb", type=Path, help="folder of the YCB models: scenes of these")
    parser.add_argument("--cache", type=Path, help="keep the scenes here")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--failures", action="store_true", help="list them")
    parser.add_argument("--save-plot", type=Path, help="PNG, with --views")
    parser.add_argument("--no-peer", action="store_true")
    parser.add_argument("--bop", type=Path, help="a dataset in the layout of the BOP benchmark")
    parser.add_argument("--split", default="test", help="of the dataset")
    parser.add_argument("--results", type=Path, help="CSV for the benchmark's server, with --bop")
    args = parser.parse_args()
    if args.bop is not None:
        try:
            run_bop(args.bop, args.split, PoseParams(starts=args.starts), args.results)
        except (OSError, ValueError) as error:
            parser.error(str(error))
        return
    first, last = map(int, args.scenes.split(":"))
    scenes = scenes_of(range(first, last), args.cache, args.ycb)
    models = Models(args.prints, args.textures)
    if args.prints:
        scenes = [painted(scene) for scene in scenes]
    params = PoseParams(starts=args.starts, more_starts=max(args.starts // 2, 1))
    run(scenes[:1], models, params, "true")  # compile
    bare = replace(params, merge=False, recollected=0, penalty=0.0, max_violation=1.0)
    everything = []
    grown = GrownModels(args.views, args.prints) if args.views else None
    curves: dict[str, dict[int, list[Trial]]] = {}
    for masks in ("true", "predicted") if args.masks == "both" else (args.masks,):
        trials = run(scenes, models, params, masks)
        everything += trials
        report(f"{masks} masks", trials, params.confidence.threshold)
        for count in args.views:
            assert grown is not None
            grown.count = count
            seen = run(scenes, grown, params, masks)
            curves.setdefault(masks, {})[count] = seen
            report(f"{masks} masks, {count} views", seen, params.confidence.threshold)
            everything += seen
            trials += seen
        if not args.no_peer and not args.views:
            report(f"{masks} masks, ICP alone", run(scenes, models, bare, masks), 2.0)
        if args.failures:
            for t in trials:
                if not t.is_right:
                    e = t.estimate
                    print(
                        f"   {t.source[-20:]:20s} IoU {t.overlap:.2f} error {t.errors[0]:.4f} "
                        f"{t.errors[1]:.0f} conf {e.confidence if e else 0:.2f} "
                        f"fit {e.fit if e else 0:.2f} vio {e.violation if e else 0:.2f} "
                        f"amb {e.ambiguous if e else 0} free {e.is_turn_free if e else 0} "
                        f"surface {1e3 * t.surface_m:.1f} mm"
                    )
    if grown is not None:
        known = {count: float(np.mean(shares)) for count, shares in grown.known.items()}
        shares = ", ".join(f"{share:.2f} after {count}" for count, share in known.items())
        print(f"of the views {np.mean(grown.joined):.3f} joined; surface known: {shares}")
        if args.save_plot:
            draw(curves, known, args.save_plot)
    if args.fit:
        refit(everything)


if __name__ == "__main__":
    main()
