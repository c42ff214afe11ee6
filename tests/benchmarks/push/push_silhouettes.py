"""Number of perturbations that finds a good grasp of real silhouettes, beside none at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from grasp.push import PushTest, Tolerance, analyse, as_part, sample_grasps
from grasp.push.analysis import Analysis, Racing
from grasp.push.inputs.contours import rings_from_image
from grasp.push.inputs.sources import Outline, without_details
from grasp.push.polygon import Part
from grasp.push.trials import Trials
from grasp.spatial.meshes.mesh_files import read_mesh

_SIZE_PX, _TRUTH = 400, 4000
_SAMPLES = (25, 50, 100, 200, 400)
_SEEN = {"top": (0, 1), "side": (0, 2)}


def silhouettes() -> None:
    """Share of the best quality that a plan's first grasp has, by its number of perturbations.

    Beside it, what planning on the nominal outline alone is worth (Kehoe 2014, 3.5): the mean
    quality of the grasps that close there, of which it can prefer none.
    """
    folder = Path(os.environ.get("RTASK_SHARED_DATA", "../shared/data")) / "ycb"
    kept: dict[str, list[float]] = {}
    asked: dict[str, list[int]] = {}
    blind: list[tuple[float, float]] = []
    refused = 0
    for _name, part in _parts(folder):
        if part is None:
            refused += 1
            continue
        grasps = sample_grasps(part, density=3.0, angles=9)
        if not len(grasps.contacts):
            continue
        test, tolerance = PushTest(0.25 * part.diameter, friction=0.7), Tolerance.default(part)
        truth = analyse(part, grasps, test, tolerance, samples=_TRUTH, seed=1).quality
        if truth.max() < 0.05:
            continue
        closes = Trials.of(part, grasps, test, tolerance, 0).nominal() > 0
        if closes.any():
            share = truth[closes] / truth.max()
            blind.append((float(share.mean()), float(np.mean(share >= 0.9))))
        for count in _SAMPLES:
            found = analyse(part, grasps, test, tolerance, samples=count)
            _note(f"{count}", found, truth, kept, asked)
        for count in _SAMPLES[2:]:
            found = analyse(part, grasps, test, tolerance, elimination=Racing(count))
            _note(f"racing {count}", found, truth, kept, asked)
    print(f"silhouettes {len(next(iter(kept.values()), []))}, refused {refused}")
    print("samples       keep .90   mean   least   evaluations")
    for key, shares in kept.items():
        values = np.array(shares)
        print(f"{key:12s}  {np.mean(values >= 0.9):8.3f}  {values.mean():.3f}  {values.min():.3f}"
              f"  {np.mean(asked[key]):12.0f}")  # fmt: skip
    mean, near = np.mean(blind, axis=0)
    print(f"nominal only: of {len(blind)} silhouettes, mean share {mean:.3f}; {near:.3f} of the "
          "grasps keep .90")  # fmt: skip


def _note(
    key: str, found: Analysis, truth: np.ndarray, kept: dict[str, list[float]],
    asked: dict[str, list[int]],
) -> None:  # fmt: skip
    kept.setdefault(key, []).append(float(truth[found.best] / truth.max()))
    asked.setdefault(key, []).append(found.evaluations)


def outlines() -> None:
    """Count the silhouettes that make no outline, from three sides at three resolutions."""
    folder = Path(os.environ.get("RTASK_SHARED_DATA", "../shared/data")) / "ycb"
    asked = refused = 0
    for size in (150, 400, 1200):
        for name, picture in _pictures(folder, {**_SEEN, "end": (1, 2)}, size):
            asked += 1
            try:
                _part(picture)
            except ValueError as error:
                refused += 1
                print(f"{name} at {size} px: {error}")
    print(f"outlines {asked}, refused {refused}")


def _parts(folder: Path) -> Iterator[tuple[str, Part | None]]:
    """Yield the silhouettes of each model from above and from the side; None = refused."""
    for name, picture in _pictures(folder, _SEEN, _SIZE_PX):
        try:
            yield name, _part(picture)
        except ValueError:
            yield name, None


def _part(picture: np.ndarray) -> Part:
    ring = rings_from_image(picture)[0]
    outline = without_details(Outline(ring, read=len(ring)))
    return as_part(outline.polygon, outline.com)


def _pictures(
    folder: Path, seen: dict[str, tuple[int, int]], size: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield images (h, w) uint8 of each model, black on white, its longer side ``size`` px."""
    for urdf in sorted(folder.glob("*.urdf")):
        pieces = [read_mesh(path) for path in sorted((folder / urdf.stem).glob("*coacd*.stl"))]
        if not pieces:
            continue
        for side, axes in seen.items():
            flat = [piece.vertices[:, axes] for piece in pieces]
            low = np.vstack(flat).min(axis=0)
            scale = size / float(np.ptp(np.vstack(flat), axis=0).max())
            picture = np.full((size + 40, size + 40), 255, np.uint8)
            for points in flat:
                hull = cv2.convexHull(np.rint((points - low) * scale + 20).astype(np.int32))
                cv2.fillPoly(picture, [hull], 0)
            yield f"{urdf.stem} {side}", picture


__all__ = ["outlines", "silhouettes"]
