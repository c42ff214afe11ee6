"""Search for the poses of a model that fit a set of points, from many starts."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.pose.icp import align, fit_scores
from features.pose.model import PoseModel
from features.pose.rotations import super_fibonacci

__all__ = ["Poses", "ScenePoints", "refine", "scene_points", "search"]

_LAST_CUT_M = 0.005
_COARSE_SIGMA_M, _FINE_SIGMA_M = 0.005, 0.003
_FINE_CUTS_M = np.geomspace(0.008, 0.003, 10)
_SAME_RAD, _SAME_M = 0.09, 0.006
_STAGES = ((6, 0.7, 200), (6, 1.0, 300))
"""Rounds, share of the starts that goes on, points."""


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Scene points that the model must explain.

    Parameters
    ----------
    places, normals : (n, 3) float64, m, camera
        Normals towards the camera.
    """

    places: NDArray[np.float64]
    normals: NDArray[np.float64]

    def __len__(self) -> int:
        """Return their number."""
        return len(self.places)

    def some(self, count: int) -> ScenePoints:
        """Return the first ones; they come in random order."""
        return ScenePoints(self.places[:count], self.normals[:count])


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses ``camera_from_model`` with how well points lie on them, best first.

    Parameters
    ----------
    rotations : (k, 3, 3) float64
    translations : (k, 3) float64, m
    fit : (k,) float64
    """

    rotations: NDArray[np.float64]
    translations: NDArray[np.float64]
    fit: NDArray[np.float64]

    def __len__(self) -> int:
        """Return their number."""
        return len(self.fit)

    def take(self, chosen: NDArray[np.intp]) -> Poses:
        """Return some of them."""
        return Poses(self.rotations[chosen], self.translations[chosen], self.fit[chosen])


def scene_points(
    points: NDArray[np.float32], most: int, within_m: float, rng: np.random.Generator
) -> ScenePoints:
    """Choose points (n, 3) with normals; far strays are left out.

    Parameters
    ----------
    most
        Number of points.
    within_m
        Greatest distance from their median.
    """
    places = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    places = places[rng.permutation(len(places))[:most]]
    if len(places):
        middle = np.median(places, axis=0)
        places = places[np.linalg.norm(places - middle, axis=1) < within_m]
    if len(places) < 4:
        return ScenePoints(places, np.zeros_like(places))
    _, near = cKDTree(places).query(places, k=min(16, len(places)))
    _, vectors = np.linalg.eigh(_scatter(places, near))
    normals = vectors[:, :, 0]
    normals *= np.where(np.einsum("ni,ni->n", normals, places) > 0, -1.0, 1.0)[:, None]
    return ScenePoints(places, normals)


def search(model: PoseModel, points: ScenePoints, starts: int, keep: int) -> Poses:
    """Return the best distinct poses of a model for points, refined."""
    few = points.some(300)
    rotations = super_fibonacci(starts)
    translations = points.places.mean(axis=0) - _facing_means(model, rotations, points)
    rounds = sum(stage[0] for stage in _STAGES)
    cuts = np.geomspace(0.25 * model.diameter_m, _LAST_CUT_M, rounds)
    done = 0
    poses = Poses(rotations, translations, np.zeros(starts))
    for count, share, size in _STAGES:
        now = few.some(size)
        align(
            *(now.places, now.normals, poses.rotations, poses.translations, model.samples),
            *(model.grid, model.corner, model.cell_m, cuts[done : done + count]),
        )
        done += count
        sigma = max(_COARSE_SIGMA_M, 0.5 * float(cuts[done - 1]))
        poses = _scored(model, now, poses, sigma)
        poses = poses.take(np.arange(max(int(share * len(poses)), min(keep, len(poses)))))
    return refine(model, points, _distinct(poses, keep))


def refine(
    model: PoseModel, points: ScenePoints, poses: Poses, judged: ScenePoints | None = None
) -> Poses:
    """Improve poses on all points; ``judged`` are the points that their fit is taken of."""
    rotations, translations = poses.rotations.copy(), poses.translations.copy()
    align(
        *(points.places, points.normals, rotations, translations, model.samples),
        *(model.grid, model.corner, model.cell_m, _FINE_CUTS_M),
    )
    moved = Poses(rotations, translations, poses.fit)
    return _scored(model, points if judged is None else judged, moved, _FINE_SIGMA_M)


def _scored(model: PoseModel, points: ScenePoints, poses: Poses, sigma_m: float) -> Poses:
    fit = fit_scores(
        *(points.places, points.normals, poses.rotations, poses.translations, model.samples),
        *(model.grid, model.corner, model.cell_m, sigma_m),
    )
    order = np.argsort(-fit, kind="stable")
    return Poses(poses.rotations[order], poses.translations[order], fit[order])


def _facing_means(
    model: PoseModel, rotations: NDArray[np.float64], points: ScenePoints
) -> NDArray[np.float64]:
    """Return the mean (k, 3) of the turned samples that face the camera."""
    towards = points.places.mean(axis=0)
    towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
    some = model.samples[::12].astype(np.float64)
    places = np.einsum("kij,nj->kni", rotations, some[:, :3])
    faces = np.einsum("kij,nj,i->kn", rotations, some[:, 3:], towards) < 0
    total = np.einsum("kni,kn->ki", places, faces.astype(np.float64))
    means: NDArray[np.float64] = total / np.maximum(faces.sum(axis=1), 1)[:, None]
    return means


def _distinct(poses: Poses, keep: int) -> Poses:
    """Return the best poses that differ from each other."""
    most = 1 + 2 * np.cos(_SAME_RAD)
    return poses.take(_distinct_rows(poses.rotations, poses.translations, keep, most, _SAME_M))


@numba.njit(cache=True, nogil=True)
def _distinct_rows(
    rotations: NDArray[np.float64],
    translations: NDArray[np.float64],
    keep: int,
    most_trace: float,
    near_m: float,
) -> NDArray[np.intp]:
    """Return the first ``keep`` rows none of which is turned and placed like one before it."""
    chosen = np.empty(keep, np.intp)
    count = 0
    for k in range(len(rotations)):
        is_new = True
        for c in chosen[:count]:
            trace = square = 0.0
            for i in range(3):
                square += (translations[c, i] - translations[k, i]) ** 2
                for j in range(3):
                    trace += rotations[c, i, j] * rotations[k, i, j]
            if trace > most_trace and np.sqrt(square) < near_m:
                is_new = False
                break
        if is_new:
            chosen[count] = k
            count += 1
            if count == keep:
                break
    return chosen[:count]


@numba.njit(cache=True, nogil=True)
def _scatter(places: NDArray[np.float64], near: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the second moments (n, 3, 3) of each place's neighbours (n, k) about their mean."""
    n, k = near.shape
    scatter = np.zeros((n, 3, 3))
    mean = np.empty(3)
    for row in range(n):
        mean[:] = 0.0
        for m in near[row]:
            for i in range(3):
                mean[i] += places[m, i] / k
        for m in near[row]:
            for i in range(3):
                for j in range(i + 1):
                    scatter[row, i, j] += (places[m, i] - mean[i]) * (places[m, j] - mean[j])
        for i in range(3):
            for j in range(i):
                scatter[row, j, i] = scatter[row, i, j]
    return scatter
