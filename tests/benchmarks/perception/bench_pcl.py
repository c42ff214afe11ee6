"""Segmentation beside the Point Cloud Library's LCCP: the same cropped clouds, in turns.

    sudo apt-get install libpcl-dev g++
    python tests/benchmarks/perception/bench_pcl.py kinect --data FOLDER/mosd_learn
    python tests/benchmarks/perception/bench_pcl.py primsmall --seeds 100:110

Both sides get the points above the table that this project's plane and prism leave, and give one
label a point; segments below the fewest points of a data set are dropped. Times are seconds of one
processor from cloud to labels, the least of three rounds in which both sides take turns; reading
files is not counted. ``full`` rows give the library the whole cloud, as its example does.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from features.segmentation import SegmentParams, score_labels, segment_cloud, segment_scene, warm_up
from features.segmentation.segment import number_by_size
from tests.benchmarks.perception.bench_segmentation import FEWEST, View, dropped, kinect
from tests.benchmarks.perception.tabletop_scenes import KINDS

SOURCE = Path(__file__).with_name("pcl_lccp.cpp")
ROUNDS = 3
PCL = {  # voxel, seed, colour, spatial, normal, concavity, smoothness, sanity, transform
    "PCL crop, its defaults": "0.0075 0.03 0 1 4 10 0.1 0 1",
    "PCL crop, tuned": "0.005 0.02 0 1 4 12 0.1 1 0",
}
PCL_FULL = {"PCL full cloud, with sanity": "0.0075 0.03 0 1 4 10 0.1 1 1"}
OURS = {
    "ours crop, components (LCCP)": SegmentParams(method="components", tolerance_deg=12),
    "ours crop, default": SegmentParams(join_standing=False),
    "ours crop, near": replace(SegmentParams.near(), join_standing=False),
}
OURS_FULL = {"ours full cloud, default": SegmentParams()}


@dataclass
class Row:
    """Quality and time of one method."""

    f: list[float] = field(default_factory=list)
    p75: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)


class Library:
    """A running driver with one setting."""

    def __init__(self, program: Path, setting: str) -> None:
        self._process = subprocess.Popen(
            [program, *setting.split()], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def segment(self, cloud: Path) -> tuple[NDArray[np.uint32], float]:
        """Return the labels of a cloud file and the processor's time, ms."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(cloud, file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise SystemExit("the driver died")
        return np.fromfile(f"{cloud}.labels", np.uint32), 1e3 * float(answer)

    def close(self) -> None:
        """Let the driver end."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10)


def build(folder: Path) -> Path:
    """Compile the driver, or say what is missing and stop."""
    known = shutil.which("pkg-config") and shutil.which("g++")
    asked = ["pkg-config", "--cflags", "--libs", "pcl_segmentation"]
    flags = subprocess.run(asked, capture_output=True, text=True) if known else None
    if flags is None or flags.returncode:
        print("skipped: the Point Cloud Library is absent (sudo apt-get install libpcl-dev g++)")
        raise SystemExit(0)
    program = folder / "pcl_lccp"
    subprocess.run(["g++", "-O2", "-w", SOURCE, "-o", program, *flags.stdout.split()], check=True)
    return program


def store(path: Path, points: NDArray[np.float32], colours: NDArray[np.uint8]) -> Path:
    """Write a cloud as 16 bytes a point."""
    packed = np.zeros((len(points), 16), np.uint8)
    packed[:, :12] = np.ascontiguousarray(points, np.float32).view(np.uint8).reshape(-1, 12)
    packed[:, 12:15] = colours
    packed.tofile(path)
    return path


@dataclass(frozen=True)
class Case:
    """The points of a view that both sides segment, and where they lie in the image.

    ``above`` (n,) tells which of them stand on the table; nothing else is an object.
    """

    view: View
    pixels: NDArray[np.int64]
    above: NDArray[np.bool_]
    file: Path

    def score(self, row: Row, labels: NDArray[np.integer], fewest: int) -> None:
        """Compare labels (n,) of the points with the truth."""
        whole = np.zeros(self.view.truth.size, np.int32)
        standing = np.where(self.above, labels, 0).astype(np.int32)
        whole[self.pixels] = number_by_size(standing, fewest)[0]
        truth = self.view.truth
        score = score_labels(whole.reshape(truth.shape), np.maximum(truth, 0), truth >= 0)
        if score is not None:
            row.f.append(score.f)
            row.p75.append(score.p75)


def cases(views: Sequence[View], folder: Path, full: bool) -> list[Case]:
    """Write the clouds."""
    made = []
    for k, view in enumerate(views):
        points = view.frame.points()
        keep = np.isfinite(points[..., 2])
        scene = segment_scene(points, view.frame.rgb, None, view.down)
        if scene.prism is None:
            continue
        if not full:
            keep &= scene.prism.mask
        pixels = np.flatnonzero(keep)
        above = scene.prism.mask.ravel()[pixels]
        flat, colours = points.reshape(-1, 3), view.frame.rgb.reshape(-1, 3)
        file = store(folder / f"{'full' if full else 'crop'}{k}", flat[pixels], colours[pixels])
        made.append(Case(view, pixels, above, file))
    return made


def compare(
    program: Path, made: Sequence[Case], theirs: dict[str, str], ours: dict[str, SegmentParams],
    fewest: int, full: bool,
) -> dict[str, Row]:  # fmt: skip
    """Run every method on every case in turns."""
    rows = {name: Row() for name in (*theirs, *ours)}
    drivers = {name: Library(program, setting) for name, setting in theirs.items()}
    for case in made:
        points = case.view.frame.points()
        flat = points.reshape(-1, 3)[case.pixels]
        colours = case.view.frame.rgb.reshape(-1, 3)[case.pixels]
        best = dict.fromkeys(rows, np.inf)
        labels: dict[str, NDArray[np.integer]] = {}
        for _ in range(ROUNDS):
            for name, driver in drivers.items():
                labels[name], ms = driver.segment(case.file)
                best[name] = min(best[name], ms)
            for name, params in ours.items():
                few = replace(params, min_points=fewest)
                start = time.process_time()
                if full:
                    scene = segment_scene(points, case.view.frame.rgb, few, case.view.down)
                    labels[name] = scene.labels.ravel()[case.pixels]
                else:
                    labels[name] = segment_cloud(flat, colours, None, few).labels
                best[name] = min(best[name], 1e3 * (time.process_time() - start))
        for name, row in rows.items():
            row.ms.append(best[name])
            case.score(row, labels[name], fewest)
    for driver in drivers.values():
        driver.close()
    return rows


def main() -> None:
    """Print both sides."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data_set", nargs="?", default="primsmall", choices=["kinect", *KINDS[:4]])
    parser.add_argument("--seeds", default="100:106")
    parser.add_argument("--data", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build(folder)
        warm_up()
        if asked.data_set == "kinect":
            views = list(kinect(asked.data))
        else:
            first, last = map(int, asked.seeds.split(":"))
            views = list(dropped(asked.data_set, range(first, last)))
        fewest = FEWEST[asked.data_set]
        rows = compare(program, cases(views, folder, False), PCL, OURS, fewest, False)
        whole = compare(program, cases(views, folder, True), PCL_FULL, OURS_FULL, fewest, True)
    print(f"{len(views)} frames of {asked.data_set}, segments of at least {fewest} points")
    for label, row in (rows | whole).items():
        print(f"{label:30s} F {np.mean(row.f):.3f}  p75 {np.mean(row.p75):.3f}  "
              f"CPU ms {np.median(row.ms):6.1f}")  # fmt: skip
    for peer, table, mine in (("PCL crop, tuned", rows, OURS),
                              ("PCL full cloud, with sanity", whole, OURS_FULL)):  # fmt: skip
        for name in mine:
            ratio = np.median(np.array(table[peer].ms) / np.array(table[name].ms))
            print(f"{peer} takes {ratio:.1f} times as long as {name}")


if __name__ == "__main__":
    main()
