"""Clouds that are not in the frame of the camera that took them, brought back to it.

All of perception looks from the origin along z. A cloud in the frame of a robot or a room is as
good, once it is known where its camera was: the header says so (PCD), or the rows and columns of an
organised cloud, each of whose points lies on the ray of its pixel.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq

from features.codec.types import Cloud
from features.geometry import Float64Array, FloatArray, Intrinsics, pose_matrix, transform
from features.imaging.camera import camera_of_grid
from features.imaging.doubts import doubtful_frame, implausible_middle

__all__ = ["camera_of_placed_grid", "in_camera_frame", "in_sensor_frame", "on_pixels"]

_MIN_POINTS, _MAX_FITTED = 200, 2_000
_MAX_ERROR_PX = 0.75
_ALL, _WIDEST = 0.995, float(np.tan(np.deg2rad(60)))
"""Share of the points, and the slope to the axis, that one camera sees."""
_SLOPE_DIGITS, _MAX_OFF_PX = 5, 0.15
_SMALL_STEP, _IN_ORDER = 0.1, 0.9
_MAX_EMPTY = 12
"""Pixels for each point: a cloud of one thing leaves most of its image empty."""
_BEHIND_SENSOR = 0.01
_MAX_SKEW, _MAX_STRETCH = 0.01, 0.05
"""Of a pixel, as shares of the focal length: sensors have square ones."""


class _Pinhole(NamedTuple):
    """A camera, its pose (4, 4) in the frame of its points, and whether they are mirrored."""

    camera: Intrinsics
    source_from_camera: Float64Array
    is_mirrored: bool


def in_camera_frame(cloud: Cloud) -> tuple[Cloud, str]:
    """Return a cloud in the frame of its camera, and what was done or remains doubtful.

    The sentence is empty where the cloud came in that frame and nothing speaks against it.
    """
    if cloud.is_organised and camera_of_grid(cloud.grid()[0]) is not None:
        # A camera's own rows: how far it sees tells the unit of all three axes.
        return cloud, implausible_middle(float(np.median(cloud.positions[:, 2])))
    if cloud.viewpoint is not None:
        return _from_viewpoint(cloud, _inverse(cloud.viewpoint))
    pinhole = _pinhole_of_grid(cloud.grid()[0]) if cloud.is_organised else None
    if pinhole is None:
        return _with_sides_exchanged(cloud) or _in_other_rows(cloud) or _of_drawing(cloud)
    if pinhole.is_mirrored:
        return cloud, (
            "its rows and columns show a mirror image: does one of its axes, or the order of its "
            "pixels, run the other way?"
        )
    placed = pinhole.camera, pinhole.source_from_camera
    x, y, z = placed[1][:3, 3].round(3) + 0.0  # -0.000 would be read as a side
    return _moved(cloud, _inverse(placed[1])), (
        f"its rows and columns show a camera at ({x:.3f}, {y:.3f}, {z:.3f}) m in its frame: read "
        "in the frame of that camera"
    )


def _with_sides_exchanged(cloud: Cloud) -> tuple[Cloud, str] | None:
    """Return a cloud whose height and width are exchanged, put right; None if it is none such."""
    if not cloud.is_organised:
        return None
    exchanged = replace(cloud, shape=cloud.shape[::-1])
    if camera_of_grid(exchanged.grid()[0]) is None:
        return None
    height, width = exchanged.shape
    return exchanged, (
        f"its rows are those of a camera only if they are {width} wide and {height} high: height "
        "and width are taken to be exchanged"
    )


def _in_other_rows(cloud: Cloud) -> tuple[Cloud, str] | None:
    """Return a cloud, and that its rows are cut elsewhere than those of its camera, if they are."""
    if not cloud.is_organised:
        return None
    laid = on_pixels(replace(cloud, shape=(), places=None))
    if laid is None or camera_of_grid(laid.grid()[0]) is None:
        return None
    height, width = laid.shape
    return cloud, (
        f"it says {cloud.shape[1]} wide and {cloud.shape[0]} high, but its points lie on the "
        f"pixels of a camera, {width} wide and {height} high as far as they reach: are its rows "
        "cut elsewhere?"
    )


def _runs_mirrored(positions: FloatArray) -> bool:
    """Whether points (n, 3) come row by row as of a mirror image.

    Programs that leave out what was not measured keep the order of the pixels: slopes to the right
    rise within a row, and those down from row to row. Turned by half, both fall.
    """
    if len(positions) < _MIN_POINTS or (positions[:, 2] <= 0).any():
        return False
    across, down = (positions[:, :2] / positions[:, 2:]).T
    step = np.diff(across)
    in_row = np.abs(step) < _SMALL_STEP * np.ptp(across)
    if not in_row.any() or not np.ptp(down):
        return False
    right, below = np.mean(np.sign(step[in_row])), np.corrcoef(np.arange(len(down)), down)[0, 1]
    return bool(min(abs(right), abs(below)) > _IN_ORDER and right * below < 0)


def _of_drawing(cloud: Cloud) -> tuple[Cloud, str]:
    """Return a cloud in the axes of drawings (y up, z backward) in those of a camera.

    So RealSense's viewer and most programs that draw export what a camera sees.
    """
    doubt = doubtful_frame(cloud.positions, cloud.frame_id)
    if not doubt and len(cloud.positions):
        # Nothing lies behind it: a camera's, then, and one does not see so near.
        doubt = implausible_middle(float(np.median(cloud.positions[:, 2])))
        if doubt:
            return cloud, doubt
    if not doubt and not cloud.is_organised and _runs_mirrored(cloud.positions):
        return cloud, (
            "its points come row by row as of a mirror image: does one of its axes, or the order "
            "of its pixels, run the other way?"
        )
    x, y, z = cloud.positions.T
    if not doubt or not len(z) or (z < 0).mean() < _ALL:
        return cloud, doubt
    if np.quantile(np.hypot(x, y) / np.maximum(-z, 1e-6), _ALL) > _WIDEST:
        return cloud, doubt
    turned = _moved(cloud, np.diag([1.0, -1.0, -1.0, 1.0]))
    if doubtful_frame(turned.positions, ""):
        return cloud, doubt
    return turned, "all of it has z < 0: read in the axes of drawings, y up and z backward"


def _from_viewpoint(cloud: Cloud, camera_from_cloud: Float64Array) -> tuple[Cloud, str]:
    """Return a cloud of a PCD with VIEWPOINT in the frame of its sensor.

    The format does not say whether its numbers are in the frame of the sensor or in the frame in
    which VIEWPOINT is given, and programs write both: taken is the first that a camera may see.
    """
    seen = _moved(cloud, camera_from_cloud)
    doubt = doubtful_frame(seen.positions, "")
    if not doubt:
        return seen, "read in the frame of its sensor, which VIEWPOINT places"
    already = _moved(seen, camera_from_cloud)
    if not doubtful_frame(already.positions, ""):
        return already, (
            "its points are where a camera at VIEWPOINT sees them: taken to be in the frame in "
            "which VIEWPOINT is given, and read in that of the camera"
        )
    return seen, doubt


def in_sensor_frame(cloud: Cloud) -> Cloud:
    """Return the points of one object, from a PCD with VIEWPOINT, in the frame of its sensor.

    As the format has it, unless they lie behind the sensor so and before it where they are placed
    already. One object alone shows no more: a cup is as hollow as a table that is seen from below.

    Raises
    ------
    ValueError
        The cloud has no viewpoint.
    """
    if cloud.viewpoint is None:
        raise ValueError("the cloud has no viewpoint")
    camera_from_cloud = _inverse(cloud.viewpoint)
    seen = _moved(cloud, camera_from_cloud)
    if len(seen) and (seen.positions[:, 2] < 0).mean() > _BEHIND_SENSOR:
        already = _moved(seen, camera_from_cloud)
        if not (already.positions[:, 2] < 0).any():
            return already
    return seen


def _inverse(pose: Float64Array) -> Float64Array:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _moved(cloud: Cloud, target_from_source: Float64Array) -> Cloud:
    moved = np.asarray(transform(target_from_source, cloud.positions), np.float32)
    return replace(cloud, positions=moved, frame_id="", viewpoint=None)


def camera_of_placed_grid(points: FloatArray) -> tuple[Intrinsics, Float64Array] | None:
    """Return the pinhole from whose pixels an organised cloud was made, and its pose, if it was.

    Direct linear transformation (Hartley and Zisserman 2004, 7.1). Noise of depth moves a point
    along its ray, so that it does no harm.

    Parameters
    ----------
    points : (h, w, 3) float, m, any right-handed frame
        NaN = missing.

    Returns
    -------
    The camera and ``source_from_camera`` (4, 4). None where the points lie on no such rays, or in
    one plane, of which many cameras make the same image.

    Examples
    --------
    >>> from features.geometry import look_at, points_from_depth
    >>> camera = Intrinsics(64, 48, 80.0, 80.0, 31.0, 24.5)
    >>> z = np.random.default_rng(0).uniform(0.5, 1, (48, 64))
    >>> base_from_camera = look_at(np.array([0.1, -0.4, 1.0]), np.array([0.5, 0.0, 0.2]))
    >>> seen = transform(base_from_camera, points_from_depth(z, camera))
    >>> pinhole, pose = camera_of_placed_grid(seen)
    >>> round(pinhole.fx, 2), pose[:3, 3].round(3).tolist()
    (80.0, [0.1, -0.4, 1.0])
    """
    pinhole = _pinhole_of_grid(points)
    if pinhole is None or pinhole.is_mirrored:
        return None
    return pinhole.camera, pinhole.source_from_camera


def _pinhole_of_grid(points: FloatArray) -> _Pinhole | None:
    """Return the pinhole of an organised cloud (h, w, 3), be it mirrored; None if it has none."""
    height, width = points.shape[:2]
    v, u = np.nonzero(np.isfinite(points).all(axis=-1))
    if len(u) < _MIN_POINTS:
        return None
    places = points[v, u].astype(np.float64)
    projection = _projection(places, u, v)
    image = np.c_[places, np.ones(len(places))] @ projection.T
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.hypot(image[:, 0] / image[:, 2] - u, image[:, 1] / image[:, 2] - v)
    if not np.quantile(off, 0.99) <= _MAX_ERROR_PX:
        return None
    if np.median(image[:, 2]) < 0:
        projection = -projection
    matrix, turn = rq(projection[:, :3])
    signs = np.sign(np.diag(matrix))
    matrix, turn = matrix * signs, signs[:, None] * turn
    matrix = matrix / matrix[2, 2]
    fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
    is_camera = (
        abs(matrix[0, 1]) < _MAX_SKEW * fx
        and abs(fx / fy - 1) < _MAX_STRETCH
        and 0 <= matrix[0, 2] < width
        and 0 <= matrix[1, 2] < height
    )
    if not is_camera:
        return None
    pose = pose_matrix(turn.T, -np.linalg.solve(projection[:, :3], projection[:, 3]))
    camera = Intrinsics(width, height, fx, fy, float(matrix[0, 2]), float(matrix[1, 2]))
    return _Pinhole(camera, pose, bool(np.linalg.det(turn) < 0))


def _projection(places: Float64Array, u: NDArray[np.intp], v: NDArray[np.intp]) -> Float64Array:
    """Return the matrix (3, 4) that projects places (n, 3) onto pixels (n,), by least squares."""
    some = slice(None, None, max(len(places) // _MAX_FITTED, 1))
    # Numbers of one size, or the squares of pixels drown those of metres.
    middle, spread = places.mean(axis=0), float(places.std()) or 1.0
    pixel = float(max(u.max(), v.max()))
    near = np.c_[(places[some] - middle) / spread, np.ones(len(places[some]))]
    zeros = np.zeros_like(near)
    across, down = (axis[some, None] / pixel - 0.5 for axis in (u, v))
    rows = np.vstack(
        [np.hstack([near, zeros, -across * near]), np.hstack([zeros, near, -down * near])]
    )
    smallest = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    pixels = np.array([[pixel, 0, pixel / 2], [0, pixel, pixel / 2], [0, 0, 1.0]])
    source = np.diag([1 / spread] * 3 + [1.0])
    source[:3, 3] = -middle / spread
    projection: Float64Array = pixels @ smallest @ source
    return projection


def on_pixels(cloud: Cloud) -> Cloud | None:
    """Return a cloud without rows on the pixels that it was measured on; None if on none.

    A cloud that was exported from one depth image has its rays still: their slopes are those of
    columns and rows, one pixel apart.

    Parameters
    ----------
    cloud
        In the frame of its camera; the result has as many points, and a place for each.

    Examples
    --------
    >>> v, u = np.divmod(np.arange(0, 600, 2), 30)
    >>> z = np.random.default_rng(0).uniform(0.5, 1, 300)
    >>> seen = np.stack([(u - 14.5) / 40 * z, (v - 9.5) / 40 * z, z], axis=1).astype(np.float32)
    >>> on_pixels(Cloud(seen)).shape
    (20, 15)
    """
    if len(cloud) < _MIN_POINTS or (cloud.positions[:, 2] <= 0).any():
        return None
    slopes = cloud.positions[:, :2].astype(np.float64) / cloud.positions[:, 2:]
    across, down = _pixels(slopes[:, 0]), _pixels(slopes[:, 1])
    if across is None or down is None:
        return None
    width, height = int(across.max()) + 1, int(down.max()) + 1
    places = down * width + across
    if width * height > _MAX_EMPTY * len(cloud) or len(np.unique(places)) < len(cloud):
        return None
    return replace(cloud, shape=(height, width), places=places)


def _pixels(slopes: Float64Array) -> NDArray[np.int64] | None:
    """Return the column (n,) of each slope if all of them lie on equal steps; else nothing."""
    columns = np.unique(np.round(slopes, _SLOPE_DIGITS))
    # One column may be rounded both ways.
    columns = columns[np.diff(columns, prepend=-np.inf) > 1.5 * 10.0**-_SLOPE_DIGITS]
    gaps = np.diff(columns)
    if len(gaps) < 2:
        return None
    # Over hundreds of columns the error of one step adds up, but that of their mean does not.
    pitch = float(gaps[gaps < 1.5 * np.median(gaps)].mean())
    for _ in range(2):
        numbers = np.rint((slopes - slopes.min()) / pitch)
        if not numbers.any():
            return None
        pitch, start = (float(n) for n in np.polyfit(numbers, slopes, 1))
    off = np.abs((slopes - start) / pitch - np.rint((slopes - start) / pitch))
    if np.quantile(off, 0.99) > _MAX_OFF_PX:
        return None
    numbers = np.rint((slopes - start) / pitch)
    steps = numbers.astype(np.int64)
    return steps - int(steps.min())
