"""B-splines as stored visual features: the outline of an object and its visible surface.

Gatto 2016, 3.2.2 names B-splines beside images and clouds as what an object keeps. Control points
depend on frame and parameters and are never compared; outlines are compared by their spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

__all__ = ["ContourSpline", "SurfaceSpline", "fit_contour", "fit_surface"]

CONTOUR_CONTROLS = 32
HARMONICS = 12
INNER_KNOTS = 3
_CUBIC_KNOTS = np.concatenate(
    [np.zeros(4), np.arange(1, INNER_KNOTS + 1) / (INNER_KNOTS + 1), np.ones(4)]
)
_PER_AXIS = INNER_KNOTS + 4
_MIN_POINTS = 200
_MAX_POINTS = 4000


@dataclass(frozen=True, eq=False)
class ContourSpline:
    """A closed, uniform, cubic B-spline.

    Parameters
    ----------
    control_points : (32, 2) float32, px of the image
    """

    control_points: NDArray[np.float32]

    def sample(self, count: int = 128) -> NDArray[np.float64]:
        """Return ``count`` points (count, 2), px, equally spaced in the parameter."""
        parameter = np.arange(count, dtype=np.float64) * (len(self.control_points) / count)
        samples: NDArray[np.float64] = _periodic_basis(parameter) @ self.control_points
        return samples

    def spectrum(self) -> NDArray[np.float32]:
        """Describe the outline, whatever its place, size, turn and first point.

        Returns
        -------
        (24,) float32
            Magnitudes of the Fourier coefficients 1..12 and -1..-12 of the outline as complex
            numbers, relative to the first two.
        """
        points = self.sample()
        coefficients = np.abs(np.fft.fft(points[:, 0] + 1j * points[:, 1]))
        chosen = np.concatenate(
            [coefficients[1 : HARMONICS + 1], coefficients[: -HARMONICS - 1 : -1]]
        )
        scale = max(coefficients[1] + coefficients[-1], 1e-9)
        spectrum: NDArray[np.float32] = (chosen / scale).astype(np.float32)
        return spectrum


def fit_contour(mask: NDArray[np.bool_]) -> ContourSpline | None:
    """Fit the longest outer contour of a mask by least squares over chord length.

    Returns nothing when the contour has fewer points than the spline has controls.
    """
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = max((c[:, 0, :] for c in contours), key=len, default=np.empty((0, 2)))
    if len(points) < CONTOUR_CONTROLS:
        return None
    points = points.astype(np.float64)
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    start = np.concatenate([[0.0], np.cumsum(chords)[:-1]])
    basis = _periodic_basis(start * (CONTOUR_CONTROLS / chords.sum()))
    controls = _least_squares(csr_array(basis), points, 1e-6)
    return ContourSpline(controls.astype(np.float32))


def _least_squares(
    basis: csr_array, values: NDArray[np.float64], ridge: float
) -> NDArray[np.float64]:
    """Return the coefficients (k,) or (k, m) of a basis (n, k) that fit values (n,) or (n, m)."""
    # Sparse, since few functions of a spline's basis meet at a point, and BLAS's threads wait for
    # each other on busy cores: a product of .1 ms took 30 ms of the processor.
    normal = (basis.T @ basis).toarray() + ridge * np.eye(basis.shape[1])
    return np.asarray(np.linalg.solve(normal, basis.T @ values), np.float64)


def _periodic_basis(parameter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (n, 32) uniform cubic basis at parameters in [0, 32)."""
    span = np.floor(parameter).astype(np.intp)
    t = parameter - span
    weights = np.stack(
        [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1
    )
    basis = np.zeros((len(parameter), CONTOUR_CONTROLS))
    columns = (span[:, None] + np.arange(4)) % CONTOUR_CONTROLS
    np.put_along_axis(basis, columns, weights / 6.0, axis=1)
    return basis


@dataclass(frozen=True, eq=False)
class SurfaceSpline:
    """A bicubic surface: depth over the image box of a segment.

    Parameters
    ----------
    coefficients : (7, 7) float32, m
        Of the basis in v (rows) and u (columns); 3 inner knots each way, uniform on 0..1.
    box : (4,) float32, px
        Left, top, right, bottom of the box that (u, v) = 0..1 spans.
    rms_m
        Residual of the fit.
    """

    coefficients: NDArray[np.float32]
    box: NDArray[np.float32]
    rms_m: float

    def depth(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the depth in m at image points (n,), px; outside the box that of its edge."""
        rows = _surface_basis(self.box, np.asarray(x, float), np.asarray(y, float))
        depth: NDArray[np.float64] = rows @ self.coefficients.ravel().astype(np.float64)
        return depth


def fit_surface(depth_m: NDArray[np.floating], mask: NDArray[np.bool_]) -> SurfaceSpline | None:
    """Fit the depth of a segment by least squares.

    Parameters
    ----------
    depth_m : (h, w) float, m
        0 or not finite = missing.
    mask : (h, w) bool

    Returns
    -------
    SurfaceSpline or None
        None with fewer than 200 measured points.
    """
    rows, columns = np.nonzero(mask & np.isfinite(depth_m) & (depth_m > 0))
    if len(rows) < _MIN_POINTS:
        return None
    step = -(-len(rows) // _MAX_POINTS)
    rows, columns = rows[::step], columns[::step]
    z = depth_m[rows, columns].astype(np.float64)
    box = np.array([columns.min(), rows.min(), columns.max(), rows.max()], np.float32)
    basis = csr_array(_surface_basis(box, columns.astype(float), rows.astype(float)))
    # Corners of the box that the segment does not reach are held near the mean by a weak ridge.
    middle = z.mean()
    flat = _least_squares(basis, z - middle, 1e-3) + middle
    rms = float(np.sqrt(np.mean((basis @ flat - z) ** 2)))
    return SurfaceSpline(flat.reshape(_PER_AXIS, _PER_AXIS).astype(np.float32), box, rms)


def _surface_basis(
    box: NDArray[np.float32], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    left, top, right, bottom = (float(side) for side in box)
    u = np.clip((x - left) / max(right - left, 1.0), 0, 1)
    v = np.clip((y - top) / max(bottom - top, 1.0), 0, 1)
    across = BSpline.design_matrix(u, _CUBIC_KNOTS, 3).toarray()
    down = BSpline.design_matrix(v, _CUBIC_KNOTS, 3).toarray()
    basis: NDArray[np.float64] = (down[:, :, None] * across[:, None, :]).reshape(len(u), -1)
    return basis
