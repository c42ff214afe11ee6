"""Benchmark of segmentation: quality, time, and the size of one object on the wire.

    python bench_segmentation.py tables --seeds 20:34
    python bench_segmentation.py tables --seeds 200:212 --touching
    python bench_segmentation.py kinect --data FOLDER/mosd_learn
    python bench_segmentation.py kinect --data FOLDER/mosd_learn --end bottom
    python bench_segmentation.py primsmall --seeds 100:110  # 1.4 to 7 cm

``tables`` renders what the simulated head camera sees of six to eight products on both sides, with
the light and sensor noise of the seed; ``--touching`` pushes them together in pairs. ``kinect``
reads 45 real scenes (modified OSD). An object is found when one segment agrees with it by F > .75;
objects cut by the image border or of less than 300 px are not asked for. ``--end`` ends the image
at the middle of the objects; *prism* is the share of the objects' points that the prism over the
table holds, *labelled* the share of them that get a label.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from features.codec import encode_frame
from features.geometry import Frame, Intrinsics
from features.segmentation import Scene, SegmentParams, score_labels, segment_scene, warm_up
from simulate.robots.nao import describe_nao
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import sample_objects
from simulate.world.robot_body import RobotBody
from simulate.world.scene import Placement, arrange, lay
from simulate.world.world import World
from tests.benchmarks.perception.tabletop_scenes import KINDS, make_scene

MIN_PIXELS = 300
FEWEST = {"kinect": 150, **dict.fromkeys(KINDS, 60)}
METHODS = {
    "near": SegmentParams.near(),
    "default": SegmentParams(),
    "components": SegmentParams(method="components", tolerance_deg=12),
    "39d": SegmentParams(features="39d"),
    "euclidean": SegmentParams(method="euclidean"),
}


@dataclass(frozen=True)
class View:
    """One noisy frame, the true label of each pixel (0 table, -1 not judged), down."""

    frame: Frame
    truth: np.ndarray
    down: np.ndarray | None


@dataclass
class Row:
    """One line of the table."""

    f: list[float] = field(default_factory=list)
    p75: list[float] = field(default_factory=list)
    found: int = 0
    split: int = 0
    asked: int = 0
    on_table: int = 0
    prism: list[float] = field(default_factory=list)
    labelled: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    size: list[int] = field(default_factory=list)

    def add(self, view: View, params: SegmentParams) -> None:
        """Segment a view and count."""
        points = view.frame.points()
        start = time.process_time()
        scene = segment_scene(points, view.frame.rgb, params, view.down)
        self.ms.append(1e3 * (time.process_time() - start))
        score = score_labels(scene.labels, np.maximum(view.truth, 0), view.truth >= 0)
        known = (view.truth > 0) & (view.frame.depth_m > 0)
        if known.any() and scene.prism is not None:
            self.prism.append(float(scene.prism.mask[known].mean()))
        if known.any():
            self.labelled.append(float((scene.labels[known] > 0).mean()))
        if score is not None:
            self.f.append(score.f)
            self.p75.append(score.p75)
        for thing in scene.objects:
            self.on_table += int(np.median(view.truth.ravel()[thing.indices]) == 0)
        for number in np.unique(view.truth[view.truth > 0]):
            self._count(view, scene, number)

    def _count(self, view: View, scene: Scene, number: int) -> None:
        mine = view.truth == number
        rim = np.concatenate([mine[0], mine[-1], mine[:, 0], mine[:, -1]])
        if np.count_nonzero(mine) < MIN_PIXELS or rim.any():
            return
        self.asked += 1
        visible = mine & (view.frame.depth_m > 0)
        shares = np.bincount(scene.labels[visible])[1:] / np.count_nonzero(visible)
        if not len(shares):
            return
        segment = (scene.labels == 1 + int(shares.argmax())) & (view.truth >= 0)
        overlap = np.count_nonzero(segment & visible)
        agreement = 2 * overlap / (np.count_nonzero(segment) + np.count_nonzero(visible))
        self.found += agreement > 0.75
        self.split += np.count_nonzero(shares > 0.1) > 1
        self.size.append(len(encode_frame(view.frame.crop(segment))))

    def line(self, name: str) -> str:
        """Return the figures in one line."""
        return (
            f"{name:11s} F {np.mean(self.f):.3f}  p75 {np.mean(self.p75):.3f}  "
            f"prism {np.mean(self.prism):.3f}  labelled {np.mean(self.labelled):.3f}  "
            f"found {self.found}/{self.asked}  split {self.split}  "
            f"on bare table {self.on_table}  CPU ms {np.median(self.ms):.0f}  "
            f"bytes/object {np.median(self.size or [0]):.0f} "
            f"(p90 {np.quantile(self.size or [0], 0.9):.0f})"
        )


def push_together(placements: list[Placement]) -> list[Placement]:
    """Return the placements with every second one moved to touch its nearest neighbour."""
    moved = list(placements)
    for i in range(1, len(moved), 2):
        me = moved[i]
        others = [o for o in moved if o is not me and (o.y > 0) == (me.y > 0)]
        if not others:
            continue
        near = min(others, key=lambda o: np.hypot(o.x - me.x, o.y - me.y))
        way = np.array([near.x - me.x, near.y - me.y])
        step = 0.0005 * way / np.linalg.norm(way)
        while _gap(me, near) > 0.003 and np.hypot(near.x - me.x, near.y - me.y) > 0.01:
            me = replace(me, x=me.x + step[0], y=me.y + step[1])
        moved[i] = me
    return moved


def _gap(a: Placement, b: Placement) -> float:
    """Return the gap of two footprints, m; 0 when they overlap."""
    outlines = []
    for p in (a, b):
        x, y, _ = p.spec.extent
        if p.spec.kind in ("can", "ball", "bottle"):
            angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
            outline = 0.5 * x * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        else:
            t = np.linspace(-0.5, 0.5, 21)
            edges = [(t, 0 * t + s) for s in (-0.5, 0.5)] + [(0 * t + s, t) for s in (-0.5, 0.5)]
            outline = np.concatenate([np.stack(e, axis=-1) for e in edges]) * [x, y]
        c, s = np.cos(p.yaw), np.sin(p.yaw)
        outlines.append(outline @ np.array([[c, s], [-s, c]]) + np.array([p.x, p.y]))
    return float(np.linalg.norm(outlines[0][:, None] - outlines[1][None], axis=-1).min())


def rendered(seeds: range, touching: bool) -> Iterator[View]:
    """Yield both sides of each seed's table."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            rng = np.random.default_rng(seed)
            placements = arrange(sample_objects(rng, 6 + seed % 3), rng)
            with World() as world:
                camera, robot = Camera(world.client), RobotBody(world, describe_nao())
                world.add_table()
                for side in ("right", "left"):
                    world.add_place_box(side)
                laid = lay(
                    world, push_together(placements) if touching else placements, Path(folder)
                )
                light = Lighting.sample(rng)
                for side in ("right", "left"):
                    pose = robot.look(side)
                    exact, seen = camera.capture(pose, light)
                    bodies = [one.body for one in laid]
                    truth = np.where(
                        np.isin(seen, bodies), seen, np.where(seen == world.table_body, 0, -1)
                    )
                    down = pose[:3, :3].T @ np.array([0.0, 0.0, -1.0])
                    yield View(SensorNoise().apply(exact, rng), truth, down)


def kinect(folder: Path) -> Iterator[View]:
    """Yield the real scenes; segments of one object count each for itself."""
    camera = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
    for number in range(45):
        stem = str(folder / f"learn{number}")
        depth = cv2.imread(f"{stem}_depth.png", cv2.IMREAD_UNCHANGED) / np.float32(1000)
        label = cv2.imread(f"{stem}_label.png", cv2.IMREAD_UNCHANGED).astype(np.int32)
        colour = cv2.imread(f"{stem}_rgb.jpg")[..., ::-1].copy()
        truth = np.where(label >= 20, label, np.where(label > 0, 0, -1))
        yield View(Frame(depth, camera, colour), truth, None)


def dropped(kind: str, seeds: range) -> Iterator[View]:
    """Yield tables on which things were dropped, before a Kinect-like camera."""
    for seed in seeds:
        scene = make_scene(kind, seed)
        yield View(scene.frame, scene.labels, scene.down)


def ended(view: View, end: str) -> View:
    """Return the part of a view up to the middle of its objects, where the image ends."""
    row, column = (int(np.median(at)) for at in np.nonzero(view.truth > 0))
    height, width = view.truth.shape
    top, bottom = (row if end == "top" else 0), (row if end == "bottom" else height)
    left, right = (column if end == "left" else 0), (column if end == "right" else width)
    kept = np.s_[top:bottom, left:right]
    lens = view.frame.intrinsics
    camera = replace(
        lens, width=right - left, height=bottom - top, cx=lens.cx - left, cy=lens.cy - top
    )
    frame = Frame(view.frame.depth_m[kept].copy(), camera, view.frame.rgb[kept].copy())
    return View(frame, view.truth[kept].copy(), view.down)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "data_set", nargs="?", default="tables", choices=["tables", "kinect", *KINDS[:4]]
    )
    parser.add_argument("--seeds", default="20:34")
    parser.add_argument("--touching", action="store_true")
    parser.add_argument("--data", type=Path)
    parser.add_argument("--end", choices=["right", "left", "top", "bottom"])
    parser.add_argument("--every", default="::1", help="slice of the views, such as 1::2")
    asked = parser.parse_args()
    warm_up()
    if asked.data_set == "kinect":
        views = list(kinect(asked.data))
    elif asked.data_set in KINDS:
        first, last = map(int, asked.seeds.split(":"))
        views = list(dropped(asked.data_set, range(first, last)))
    else:
        first, last = map(int, asked.seeds.split(":"))
        views = list(rendered(range(first, last), asked.touching))
    views = views[slice(*(int(n) if n else None for n in asked.every.split(":")))]
    if asked.end:
        views = [ended(view, asked.end) for view in views]
    print(f"{len(views)} frames")
    for name, params in METHODS.items():
        row = Row()
        for view in views:
            few = FEWEST.get(asked.data_set, params.min_points)
            row.add(view, replace(params, min_points=few))
        print(row.line(name), flush=True)


if __name__ == "__main__":
    main()
