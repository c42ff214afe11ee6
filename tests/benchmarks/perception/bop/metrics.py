"""Errors and average recall of the BOP benchmark (Hodan et al. 2018 and 2020, section 2.2).

VSD compares what can be seen of the object, MSSD its surface, MSPD its projection; the average
recall is the mean of the three over their thresholds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array, FloatArray, Intrinsics
from tests.benchmarks.perception.bop.render import render_depth

__all__ = ["AverageRecall", "BopErrors", "average_recall", "bop_errors", "mspd", "mssd", "vsd"]

_SHARES = np.arange(0.05, 0.51, 0.05)
_PIXELS = np.arange(5, 51, 5)
_WIDTH_PX = 640
_VISIBLE_M = 0.015


@dataclass(frozen=True)
class BopErrors:
    """Errors of one estimate.

    Parameters
    ----------
    vsd
        One for each tolerance of 5, 10, ... 50 % of the diameter, 0..1.
    mssd_m, mspd_px
    diameter_m
        Of the object.
    width_px
        Of the image; MSPD counts in pixels of an image 640 px wide.
    """

    vsd: tuple[float, ...]
    mssd_m: float
    mspd_px: float
    diameter_m: float
    width_px: int


@dataclass(frozen=True)
class AverageRecall:
    """Mean recall over the thresholds of each error, and their mean."""

    vsd: float
    mssd: float
    mspd: float
    mean: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", (self.vsd + self.mssd + self.mspd) / 3)


def mssd(
    estimated: FloatArray, true: FloatArray, vertices: FloatArray, symmetries: FloatArray
) -> float:
    """Return the maximum symmetry-aware surface distance, m.

    Parameters
    ----------
    estimated, true : (4, 4) float, m
        ``camera_from_object``.
    vertices : (v, 3) float, m, object frame
    symmetries : (s, 4, 4) float, m
        Movements that leave the object as it is, the identity among them.

    Examples
    --------
    >>> moved = np.eye(4); moved[0, 3] = 0.01
    >>> points = np.random.default_rng(0).normal(size=(50, 3))
    >>> round(mssd(moved, np.eye(4), points, np.eye(4)[None]), 6)
    0.01
    """
    here = _moved(estimated, vertices)
    return min(
        float(np.linalg.norm(here - _moved(true @ turn, vertices), axis=1).max())
        for turn in symmetries
    )


def mspd(
    estimated: FloatArray,
    true: FloatArray,
    vertices: FloatArray,
    symmetries: FloatArray,
    camera: Intrinsics,
) -> float:
    """Return the maximum symmetry-aware projection distance, px; see :func:`mssd`."""
    here = _projected(_moved(estimated, vertices), camera)
    worst = (
        np.linalg.norm(here - _projected(_moved(true @ turn, vertices), camera), axis=1).max()
        for turn in symmetries
    )
    return float(min(worst))


def vsd(
    depths: tuple[FloatArray, FloatArray],
    measured_m: FloatArray,
    camera: Intrinsics,
    tolerances_m: Sequence[float],
    visible_m: float = _VISIBLE_M,
) -> tuple[float, ...]:
    """Return the visible surface discrepancy for each tolerance, 0..1.

    Parameters
    ----------
    depths : two (h, w) float, m
        Rendered of the estimated and of the true pose; 0 = nothing.
    measured_m : (h, w) float, m
        Depth of the scene; 0 = missing.
    tolerances_m
        Most difference of distances that counts as agreement.
    visible_m
        What lies at most so far behind the measured surface is seen.
    """
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.sqrt(((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2 + 1)
    estimated, true = (np.asarray(depth, np.float64) * rays for depth in depths)
    scene = np.nan_to_num(np.asarray(measured_m, np.float64)) * rays
    seen_true = (true > 0) & ((scene <= 0) | (true - scene <= visible_m))
    seen = (estimated > 0) & ((scene <= 0) | (estimated - scene <= visible_m))
    seen |= seen_true & (estimated > 0)
    both, either = seen & seen_true, seen | seen_true
    if not either.any():
        return tuple(1.0 for _ in tolerances_m)
    apart = np.abs(estimated[both] - true[both])
    outside = float(either.sum() - both.sum())
    return tuple(float((outside + (apart > most).sum()) / either.sum()) for most in tolerances_m)


def bop_errors(
    estimated: FloatArray,
    true: FloatArray,
    mesh: tuple[FloatArray, NDArray[np.integer[Any]]],
    symmetries: FloatArray,
    camera: Intrinsics,
    measured_m: FloatArray,
    diameter_m: float,
) -> BopErrors:
    """Return all errors of one estimate.

    Parameters
    ----------
    mesh
        Vertices (v, 3), m, and faces (f, 3).
    symmetries : (s, 4, 4) float, m
    measured_m : (h, w) float, m
        Depth of the scene.
    """
    depths = (
        render_depth(*mesh, camera, estimated),
        render_depth(*mesh, camera, true),
    )  # fmt: skip
    return BopErrors(
        vsd(depths, measured_m, camera, [float(share * diameter_m) for share in _SHARES]),
        mssd(estimated, true, mesh[0], symmetries),
        mspd(estimated, true, mesh[0], symmetries, camera),
        diameter_m,
        camera.width,
    )


def average_recall(errors: Sequence[BopErrors | None]) -> AverageRecall:
    """Return the average recall over all targets; None = no estimate of that target.

    Examples
    --------
    >>> perfect = BopErrors((0.0,) * 10, 0.0, 0.0, 0.1, 640)
    >>> average_recall([perfect, None]).mean
    0.5
    """
    count = max(len(errors), 1)
    estimated = [error for error in errors if error is not None]
    by_vsd = sum(float((np.array(error.vsd)[:, None] < _SHARES).mean()) for error in estimated)
    by_mssd = sum(float((error.mssd_m < _SHARES * error.diameter_m).mean()) for error in estimated)
    by_mspd = sum(
        float((error.mspd_px < _PIXELS * error.width_px / _WIDTH_PX).mean()) for error in estimated
    )
    return AverageRecall(by_vsd / count, by_mssd / count, by_mspd / count)


def _moved(pose: FloatArray, points: FloatArray) -> Float64Array:
    moved = np.asarray(points, np.float64) @ pose[:3, :3].T + pose[:3, 3]
    return np.asarray(moved, dtype=np.float64)


def _projected(points: Float64Array, camera: Intrinsics) -> Float64Array:
    z = np.maximum(points[:, 2:], 1e-6)
    pixels = points[:, :2] / z * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return np.asarray(pixels, dtype=np.float64)
