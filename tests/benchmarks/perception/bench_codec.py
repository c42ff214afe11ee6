"""Benchmark of the codec: size and time of frames, crops and clouds, and which frames are sent.

    python tests/benchmarks/perception/bench_codec.py frames --data FOLDER/mosd_learn
    python tests/benchmarks/perception/bench_codec.py changes --scenes 30

``frames`` reads 45 real RGB-D scenes. Ratios are against 16 bytes a point (three float32 and a
packed colour), the peers zstd on those bytes and, where installed, Draco. ``changes`` simulates
tables of six boxes before a Kinect-like camera, changes one thing, and asks whether the second
frame would be sent.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import zstandard
from numpy.typing import NDArray

from features.codec import decode, encode_cloud, encode_frame, encode_octree
from features.geometry import Frame, Intrinsics
from features.scene_change import SceneChangeGate, warm_up
from tests.benchmarks.perception.tabletop_scenes import kinect_noise

KINECT = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
CAMERA = Intrinsics.from_fov(640, 480, 1.2)


@dataclass
class Row:
    """One line: sizes, times and the largest error, over all scenes."""

    ratio: list[float] = field(default_factory=list)
    size: list[int] = field(default_factory=list)
    pack_ms: list[float] = field(default_factory=list)
    open_ms: list[float] = field(default_factory=list)
    error_mm: float = 0.0

    def line(self, name: str) -> str:
        """Return the figures."""
        return (
            f"{name:34s} ratio {np.mean(self.ratio):5.1f} (least {min(self.ratio):5.1f})  "
            f"bytes {np.median(self.size):8.0f} (p90 {np.quantile(self.size, 0.9):8.0f})  CPU ms "
            f"{np.median(self.pack_ms):6.1f} / {np.median(self.open_ms):5.1f}  "
            f"error <= {self.error_mm:.2f} mm"
        )


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return a result and the least CPU time of three calls, ms."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        result = call()
        best = min(best, time.process_time() - start)
    return result, 1e3 * best


def scenes(folder: Path) -> Iterator[tuple[Frame, NDArray[np.int32]]]:
    """Yield the real frames and their labels; 0 and 1 are no object."""
    for number in range(45):
        stem = str(folder / f"learn{number}")
        depth = cv2.imread(f"{stem}_depth.png", cv2.IMREAD_UNCHANGED) / np.float32(1000)
        colour = cv2.imread(f"{stem}_rgb.jpg")[..., ::-1].copy()
        label = cv2.imread(f"{stem}_label.png", cv2.IMREAD_UNCHANGED).astype(np.int32)
        yield Frame(depth.astype(np.float32), KINECT, colour), label // 10


def raw_bytes(points: NDArray[np.float32], colours: NDArray[np.uint8]) -> bytes:
    """Return a cloud as 16 bytes a point."""
    packed = np.zeros((len(points), 16), np.uint8)
    packed[:, :12] = np.ascontiguousarray(points).view(np.uint8).reshape(-1, 12)
    packed[:, 12:15] = colours
    return packed.tobytes()


def frames(folder: Path) -> None:
    """Print sizes and times of the real frames."""
    rows: dict[str, Row] = {}
    rng = np.random.default_rng(0)
    for frame, label in scenes(folder):
        seen = frame.depth_m > 0
        points, colours = frame.points()[seen], frame.rgb[seen]
        raw = raw_bytes(points, colours)
        measure(rows, "frame: PNG depth + JPEG q90", raw, lambda f=frame: encode_frame(f), points)
        for number in np.unique(label[label >= 2]):
            crop = frame.crop((label == number) & seen)
            cut = raw_bytes(crop.points()[crop.depth_m > 0], crop.rgb[crop.depth_m > 0])
            measure(rows, "one object, 12 px of context", cut, lambda f=crop: encode_frame(f), None)
        measure(rows, "cloud, 1 mm, in scan order", raw,
                lambda p=points, c=colours: encode_cloud(p, c), points)  # fmt: skip
        mixed = rng.permutation(len(points))
        measure(rows, "cloud, 1 mm, shuffled then sorted", raw,
                lambda p=points[mixed], c=colours[mixed]: encode_cloud(p, c, keep_order=False),
                None)  # fmt: skip
        for voxel in (0.002, 0.005):
            measure(rows, f"octree, {1e3 * voxel:.0f} mm, with colour", raw,
                    lambda p=points, c=colours, v=voxel: encode_octree(p, c, v), None)  # fmt: skip
        measure(rows, "peer: zstd of the raw bytes", raw,
                lambda r=raw: zstandard.compress(r, 3), None, zstandard.decompress)  # fmt: skip
        if importlib.util.find_spec("DracoPy"):
            import DracoPy

            measure(rows, "peer: Draco, 11 bit, level 1", raw,
                    lambda p=points, c=colours: DracoPy.encode(
                        p, quantization_bits=11, compression_level=1, colors=c), None,
                    DracoPy.decode)  # fmt: skip
    for name, row in rows.items():
        print(row.line(name))
    frame_row, cloud_row = rows["frame: PNG depth + JPEG q90"], rows["cloud, 1 mm, in scan order"]
    peer = rows["peer: zstd of the raw bytes"]
    print(f"frame against the peer: {np.mean(frame_row.ratio) / np.mean(peer.ratio):.1f} times "
          f"smaller; cloud {np.mean(cloud_row.ratio) / np.mean(peer.ratio):.1f} times")  # fmt: skip


def measure(
    rows: dict[str, Row],
    name: str,
    raw: bytes,
    encode: Callable[[], bytes],
    points: NDArray[np.float32] | None,
    opened: Callable[[bytes], Any] = decode,
) -> None:
    """Add one scene to a row; with ``points``, compare what comes back point by point."""
    row = rows.setdefault(name, Row())
    data, pack_ms = timed(encode)
    back, open_ms = timed(lambda: opened(data))
    row.ratio.append(len(raw) / len(data))
    row.size.append(len(data))
    row.pack_ms.append(pack_ms)
    row.open_ms.append(open_ms)
    if points is not None:
        again = back.points().reshape(-1, 3)
        again = again[np.isfinite(again[:, 2])]
        row.error_mm = max(row.error_mm, 1e3 * float(np.abs(again - points).max()))


class Table:
    """Six boxes before a camera whose pose does not change unless asked."""

    def __init__(self, seed: int) -> None:
        from simulate.world.world import World

        self.rng = np.random.default_rng([seed, 77])
        self.world = World()
        client = self.world.client
        self._box([0.5, 0.4, 0.02], [0, 0, -0.02], [0.6, 0.5, 0.4, 1])
        self.boxes = []
        for _ in range(6):
            half = self.rng.uniform(0.02, 0.06, 3)
            at = [*self.rng.uniform(-0.22, 0.22, 2), half[2]]
            box = self._box(half.tolist(), at, [*self.rng.uniform(0.15, 1, 3), 1])
            turn = client.getQuaternionFromEuler([0, 0, self.rng.uniform(0, 3)])
            client.resetBasePositionAndOrientation(box, at, turn)
            self.boxes.append(box)
        azimuth, up = self.rng.uniform(0, 2 * np.pi), np.radians(self.rng.uniform(35, 60))
        away = [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)]
        self.eye = self.rng.uniform(0.75, 1.05) * np.array(away)

    def _box(self, half: list[float], at: list[float], colour: list[float]) -> int:
        client = self.world.client
        solid = client.createCollisionShape(client.GEOM_BOX, halfExtents=half)
        shown = client.createVisualShape(client.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        return int(client.createMultiBody(0, solid, shown, at))

    def frame(self, brightness: float = 1.0) -> Frame:
        """Return a noisy frame."""
        client = self.world.client
        view = client.computeViewMatrix(self.eye.tolist(), [0, 0, 0.03], [0, 0, 1])
        fov = float(np.degrees(2 * np.arctan(CAMERA.height / 2 / CAMERA.fy)))
        projection = client.computeProjectionMatrixFOV(fov, 4 / 3, 0.05, 8.0)
        *_, rgba, buffer, _ = client.getCameraImage(
            CAMERA.width, CAMERA.height, view, projection, shadow=0,
            renderer=client.ER_TINY_RENDERER,
        )  # fmt: skip
        shape = (CAMERA.height, CAMERA.width)
        share = np.asarray(buffer, np.float64).reshape(shape)
        depth = np.where(share < 1, 8.0 * 0.05 / (8.0 - 7.95 * share), 0.0)
        rgb = np.asarray(rgba, np.float64).reshape(*shape, 4)[..., :3] * brightness
        rgb = np.clip(rgb + self.rng.normal(0, 3, rgb.shape), 0, 255).astype(np.uint8)
        return Frame(kinect_noise(depth, CAMERA.fx, self.rng), CAMERA, rgb)

    def move(self, box: int, metres: float = 0.0, turn: float = 0.0) -> None:
        """Slide or turn a box."""
        client = self.world.client
        (x, y, z), q = client.getBasePositionAndOrientation(box)
        angle = self.rng.uniform(0, 2 * np.pi)
        yaw = client.getEulerFromQuaternion(q)[2] + turn
        client.resetBasePositionAndOrientation(
            box,
            [x + metres * np.cos(angle), y + metres * np.sin(angle), z],
            client.getQuaternionFromEuler([0, 0, yaw]),
        )


def changes(count: int) -> None:
    """Print how often each kind of change is sent."""
    sent: dict[str, list[bool]] = {}
    bits: dict[str, list[float]] = {}
    ms: list[float] = []

    def ask(name: str, before: Frame, after: Frame) -> None:
        gate = SceneChangeGate()
        gate.offer(before, 0.0)
        start = time.process_time()
        change = gate.offer(after, 0.1)
        ms.append(1e3 * (time.process_time() - start))
        sent.setdefault(name, []).append(change.send)
        bits.setdefault(name, []).append(change.depth_change)

    warm_up()
    for seed in range(count):
        table = Table(seed)
        with table.world:
            before = table.frame()
            for _ in range(3):
                ask("nothing", before, table.frame())
            ask("5 % brighter", before, table.frame(1.05))
            for metres in (0.002, 0.01):
                eye = table.eye.copy()
                table.eye = eye + metres * np.array([-eye[1], eye[0], 0]) / np.hypot(*eye[:2])
                ask(f"camera {1e3 * metres:.0f} mm aside", before, table.frame())
                table.eye = eye
            box = table.boxes[int(table.rng.integers(6))]
            for metres in (0.01, 0.02, 0.05):
                table.move(box, metres)
                now = table.frame()
                ask(f"a box moved {100 * metres:.0f} cm", before, now)
                before = now
            table.move(box, turn=np.radians(15))
            now = table.frame()
            ask("a box turned 15 deg", before, now)
            before = now
            table.world.client.removeBody(box)
            ask("a box removed", before, table.frame())
    for name, values in sent.items():
        low, mid, high = np.quantile(bits[name], (0, 0.5, 1))
        print(f"{name:22s} sent {100 * np.mean(values):5.1f} % of {len(values):3d}   "
              f"second largest block {mid:.3f} bit ({low:.3f} to {high:.3f})")  # fmt: skip
    print(f"CPU ms a frame: median {np.median(ms):.1f}, p95 {np.quantile(ms, 0.95):.1f}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", nargs="?", default="changes", choices=["frames", "changes"])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--scenes", type=int, default=30)
    asked = parser.parse_args()
    if asked.what == "frames":
        if asked.data is None or not asked.data.is_dir():
            parser.error("frames needs --data, a folder of RGB-D scenes")
        frames(asked.data)
    else:
        changes(asked.scenes)


if __name__ == "__main__":
    main()
