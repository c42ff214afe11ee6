"""Comparison of the depth that a pose predicts with the measured depth image.

A scan covers one side of an object; hidden parts of the model cost a wrong pose nothing. The
sensor, however, also says where there is nothing: a model surface that it looked through is a
contradiction (the wrong alignments of Kehoe 2014, 4.6, are of that sort).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["Sight", "check_free_space"]

_TOLERANCE_M = 0.008
_OCCLUSION_M = 0.008
_CELL_PX = 4
_CELL_SPACINGS = 2.5
_MIN_FACING = 0.15


@dataclass(frozen=True, eq=False)
class Sight:
    """Counts of visible model samples, one entry (k,) for each pose.

    Parameters
    ----------
    agreeing : (k,) float64
        Measured where they were predicted, on the object's mask or beside it.
    violating : (k,) float64
        The sensor saw through them, or the object's own surface lies in front of them.
    occluded : (k,) float64
        Something else stands in front.
    """

    agreeing: NDArray[np.float64]
    violating: NDArray[np.float64]
    occluded: NDArray[np.float64]

    @property
    def violation(self) -> NDArray[np.float64]:
        """Share of contradictions among what could be judged, (k,)."""
        share: NDArray[np.float64] = self.violating / np.maximum(
            self.agreeing + self.violating, 1.0
        )
        return share

    @property
    def coverage(self) -> NDArray[np.float64]:
        """Share of the visible side that was measured where it should be, (k,)."""
        total = self.agreeing + self.violating + self.occluded
        share: NDArray[np.float64] = self.agreeing / np.maximum(total, 1.0)
        return share


def check_free_space(
    samples: NDArray[np.float32],
    rotations: NDArray[np.float64],
    translations: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    own: NDArray[np.bool_],
    camera: tuple[float, float, float, float],
    spacing_m: float,
    plane: NDArray[np.float64] | None = None,
) -> Sight:
    """Project the model at each pose and compare with the depth image.

    Parameters
    ----------
    samples : (m, 6) float32
        Of the model.
    rotations, translations : (k, 3, 3), (k, 3) float64
        ``camera_from_model``.
    depth_m : (h, w) float32, m
        0 = missing.
    own : (h, w) bool
        Pixels that the hypothesis counts to the object.
    camera : fx, fy, cx, cy
        Of this image, px.
    spacing_m
        Between neighbouring samples: what hides others must leave no holes.
    plane : (4,) float64, optional
        Normal and offset of the table in the camera's frame; nothing is below it.
    """
    table = np.array([0.0, 0.0, 0.0, 1e3]) if plane is None else np.asarray(plane, np.float64)
    counts = _project(
        samples,
        rotations,
        translations,
        depth_m,
        own,
        np.array(camera, np.float64),
        table,
        spacing_m,
    )
    return Sight(counts[:, 0], counts[:, 1], counts[:, 2])


@numba.njit(cache=True, nogil=True)
def _project(samples, rotations, translations, depth, own, camera, plane, spacing):  # type: ignore[no-untyped-def]
    """Return agreeing, violating and occluded samples of each pose."""
    height, width = depth.shape
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    n = len(samples)
    counts = np.zeros((len(rotations), 3))
    place = np.zeros((n, 3))
    cells = np.zeros(n, np.int64)
    radius = 0.0
    for i in range(n):
        d = samples[i, 0] ** 2 + samples[i, 1] ** 2 + samples[i, 2] ** 2
        radius = max(radius, d)
    radius = np.sqrt(radius)
    for k in range(len(rotations)):
        r, t = rotations[k], translations[k]
        if t[2] - radius <= 0.01:
            counts[k, 1] = 1.0
            continue
        cell = max(float(_CELL_PX), _CELL_SPACINGS * spacing * fx / t[2])
        reach = fx * radius / (t[2] - radius) + cell
        u0, v0 = fx * t[0] / t[2] + cx - reach, fy * t[1] / t[2] + cy - reach
        side = min(int(2 * reach / cell) + 2, 1024)
        front = np.full(side * side, np.float32(1e6), np.float32)
        for i in range(n):
            x, y, z = samples[i, 0], samples[i, 1], samples[i, 2]
            px = r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + t[0]
            py = r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + t[1]
            pz = r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + t[2]
            place[i, 0], place[i, 1], place[i, 2] = fx * px / pz + cx, fy * py / pz + cy, pz
            a = int((place[i, 0] - u0) / cell)
            b = int((place[i, 1] - v0) / cell)
            x, y, z = samples[i, 3], samples[i, 4], samples[i, 5]
            facing = (
                (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z) * px
                + (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z) * py
                + (r[2, 0] * x + r[2, 1] * y + r[2, 2] * z) * pz
            )
            grazing = -_MIN_FACING * np.sqrt(px * px + py * py + pz * pz)
            if a < 0 or b < 0 or a >= side or b >= side or facing > grazing:
                cells[i] = -1
                continue
            cells[i] = b * side + a
            if pz < front[cells[i]]:
                front[cells[i]] = pz
        for i in range(n):
            if cells[i] < 0 or place[i, 2] > front[cells[i]] + _OCCLUSION_M:
                continue
            u, v = int(np.floor(place[i, 0] + 0.5)), int(np.floor(place[i, 1] + 0.5))
            if u < 0 or v < 0 or u >= width or v >= height or depth[v, u] <= 0:
                continue
            off = depth[v, u] - place[i, 2]
            if abs(off) < _TOLERANCE_M:
                counts[k, 0] += 1
            elif off > 0 or own[v, u]:
                counts[k, 1] += 1
            else:
                z = place[i, 2]
                x, y = (place[i, 0] - cx) / fx * z, (place[i, 1] - cy) / fy * z
                if plane[0] * x + plane[1] * y + plane[2] * z + plane[3] < -_TOLERANCE_M:
                    counts[k, 1] += 1
                else:
                    counts[k, 2] += 1
    return counts
