"""Cameras that are no plain pinholes: lens distortion, colour and depth of different cameras.

What comes out is a :class:`~features.geometry.Frame`: one pinhole, colour and depth pixel by pixel
(Gatto 2016, 2.3: every pixel with its depth).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.types import Cloud
from features.geometry import (
    Float64Array,
    FloatArray,
    Frame,
    Intrinsics,
    UInt8Array,
    finite_depth,
    points_from_depth,
)

__all__ = [
    "Lens",
    "align_colour",
    "baseline_m",
    "camera_of_grid",
    "describes_rectified",
    "doubtful_size",
    "frame_of_grid",
    "has_same_rays",
    "lens_from_message",
    "lens_of_size",
    "scaled",
    "undistorted",
]

_MAX_GRID_ERROR_PX = 0.75
_MIN_GRID_POINTS = 50
_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
_SAME_RAYS = 0.02
_MAX_SKEW = 0.002
"""Of the focal length: half a pixel at the border of most pictures."""
_NARROWEST_DEG, _WIDEST_DEG = 0.5, 170.0
FISHEYE = "equidistant"
"""Distortion model of a fisheye lens, as ROS names it (Kannala and Brandt 2006, k1 to k4)."""


@dataclass(frozen=True)
class Lens:
    """A camera with the distortion of its lens.

    Parameters
    ----------
    intrinsics
        Of the image as it comes from the camera.
    distortion
        k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tx, ty]]]] as OpenCV and ROS
        (``plumb_bob``, ``rational_polynomial``) order them, or k1 to k4 of a fisheye; empty = none.
    is_fisheye
        Whether the distortion is that of :data:`FISHEYE`.

    Raises
    ------
    ValueError
        When there are so many coefficients as no model has, or one is not finite.
    """

    intrinsics: Intrinsics
    distortion: tuple[float, ...] = ()
    is_fisheye: bool = False

    def __post_init__(self) -> None:
        if self.is_fisheye and len(self.distortion) != 4:
            raise ValueError(f"{len(self.distortion)} coefficients; a fisheye has 4")
        if len(self.distortion) not in _DISTORTION_LENGTHS:
            raise ValueError(
                f"{len(self.distortion)} coefficients of distortion; expected one of "
                f"{_DISTORTION_LENGTHS[1:]}"
            )
        if not np.isfinite(self.distortion).all():
            raise ValueError("the coefficients of distortion must be finite")

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines are bent: a fisheye bends them even where its numbers are zero."""
        return self.is_fisheye or any(self.distortion)


def lens_from_message(message: Mapping[str, Any], is_rectified: bool = False) -> Lens:
    """Return the lens of a ``sensor_msgs/CameraInfo``, or of a mapping of plain names.

    Plain names are width, height, fx, fy, cx, cy and distortion.

    Parameters
    ----------
    is_rectified
        Whether the image was rectified before it was published (``image_rect``): P describes it
        then, and it has no distortion any more (``sensor_msgs/CameraInfo``).

    Raises
    ------
    ValueError
        When a number is missing or impossible.

    Examples
    --------
    >>> lens_from_message({"width": 640, "height": 480, "k": [500, 0, 320, 0, 501, 240, 0, 0, 1],
    ...                    "d": []}).intrinsics.fy
    501.0
    """
    matrix = message.get("k", message.get("K"))
    projection = _projection(message) if is_rectified else None
    try:
        if projection is not None:
            numbers = projection
        elif matrix is not None:
            k = np.asarray(matrix, np.float64).ravel()
            if k.shape != (9,):
                raise ValueError(f"k must have 9 numbers, got {len(k)}")
            _check_matrix(k)
            numbers = [float(k[place]) for place in (0, 4, 2, 5)]
        else:
            numbers = [float(message[name]) for name in ("fx", "fy", "cx", "cy")]
        size = [message[name] for name in ("width", "height")]
        if not all(isinstance(pixels, int) for pixels in size):
            raise ValueError(f"width and height must be whole numbers of px, got {size}")
        camera = Intrinsics(size[0], size[1], *numbers)
        _check_view(camera)
        given = message.get("distortion", message.get("d", message.get("D", ())))
        coefficients = tuple(float(value) for value in (() if given is None else given))
    except KeyError as error:
        raise ValueError(f"the camera lacks {error.args[0]}") from None
    except (TypeError, OverflowError) as error:
        raise ValueError(f"the camera does not read: {error}") from None
    # D describes the raw image; a rectified one is undistorted already (sensor_msgs/CameraInfo).
    if is_rectified:
        return Lens(camera)
    model = str(message.get("distortion_model", "plumb_bob"))
    if model == FISHEYE:
        return Lens(camera, coefficients, is_fisheye=True)
    if any(coefficients) and model not in ("plumb_bob", "rational_polynomial", ""):
        raise ValueError(f"distortion_model {model!r} is not known; undistort the images first")
    return Lens(camera, coefficients)


def _check_matrix(k: Float64Array) -> None:
    """Refuse a K (9,) that is no (fx, 0, cx; 0, fy, cy; 0, 0, 1) row by row.

    Its other numbers would be passed over: column by column the centre is (0, 0), and sensors with
    a skew have places that this model does not give.
    """
    rest = np.abs(k[[1, 3, 6, 7]])
    if (rest > _MAX_SKEW * abs(k[0])).any() or k[8] not in (0, 1):
        raise ValueError(
            f"k must be fx 0 cx 0 fy cy 0 0 1, row by row, got {' '.join(f'{n:g}' for n in k)}"
        )


def _check_view(camera: Intrinsics) -> None:
    """Refuse intrinsics that no camera has: in mm, or as shares of the image."""
    for focal, centre, side in (
        (camera.fx, camera.cx, camera.width), (camera.fy, camera.cy, camera.height)
    ):  # fmt: skip
        view_deg = float(np.degrees(2 * np.arctan(side / (2 * focal))))
        if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG or not -side <= centre <= 2 * side:
            raise ValueError(
                f"a focal length of {focal:g} and a centre of {centre:g} over {side} px are no "
                f"camera's (a view of {view_deg:.3g} degrees): are they in px?"
            )


def describes_rectified(message: Mapping[str, Any]) -> bool:
    """Whether a ``sensor_msgs/CameraInfo`` says how its rectified image looks.

    Without P, and with a lens that bends lines, K is the best there is, and not quite right.
    """
    given = message.get("d", message.get("D", ()))
    return _projection(message) is not None or not np.any(() if given is None else given)


def lens_of_size(lens: Lens, message: Mapping[str, Any], shape: tuple[int, int]) -> Lens:
    """Return a lens for an image (h, w) that its camera cut out, binned or made smaller.

    ``sensor_msgs/CameraInfo`` describes the full sensor; ``roi`` and ``binning_x``, ``binning_y``
    say which part was read, and how. Where they do not lead to the size of the image, one with the
    same proportions is taken for the full view at another resolution.

    Raises
    ------
    ValueError
        No such change makes an image of this size.
    """
    full = lens.intrinsics
    if (full.height, full.width) == shape:
        return lens
    part = _part_read(full, message, shape)
    if part is not None:
        return replace(lens, intrinsics=scaled(part, shape[1], shape[0]))
    if abs(shape[1] * full.height / (shape[0] * full.width) - 1) > 0.01:
        raise ValueError(
            f"it describes {full.width}x{full.height} px, the image has {shape[1]}x{shape[0]}"
        )
    return replace(lens, intrinsics=scaled(full, shape[1], shape[0]))


def doubtful_size(lens: Lens, message: Mapping[str, Any], shape: tuple[int, ...]) -> str:
    """Return what is assumed of an image (h, w) of another size than its camera; empty if nothing.

    :func:`lens_of_size` takes it for the full view, though it may as well be a part of it, which
    has the same proportions and a longer focal length.

    Examples
    --------
    >>> told = {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240}
    >>> lens = lens_from_message(told)
    >>> doubtful_size(lens, told, (240, 320))[:53]
    'its CameraInfo is of 640x480 px, the image of 320x240'
    >>> doubtful_size(lens, {**told, "binning_x": 2, "binning_y": 2}, (240, 320))
    ''
    """
    full, (height, width) = lens.intrinsics, shape[:2]
    is_full = (full.height, full.width) == (height, width)
    if is_full or _part_read(full, message, (height, width)) is not None:
        return ""
    return (
        f"its CameraInfo is of {full.width}x{full.height} px, the image of {width}x{height}, and "
        "no binning or roi says why: taken for the whole view"
    )


def _part_read(
    full: Intrinsics, message: Mapping[str, Any], shape: tuple[int, int]
) -> Intrinsics | None:
    """Return the part of the sensor that ``roi`` and binning bring to an image (h, w), if any."""
    region = _region(message)
    bins = [max(int(message.get(name) or 1), 1) for name in ("binning_x", "binning_y")]
    left, top, across, down = region if region[2] and region[3] else (0, 0, full.width, full.height)
    # Only if it leads to the image that came: roi and binning may be left over from an earlier
    # setting.
    if (down // bins[1], across // bins[0]) != shape:
        return None
    return Intrinsics(across, down, full.fx, full.fy, full.cx - left, full.cy - top)


def _region(message: Mapping[str, Any]) -> tuple[int, int, int, int]:
    """Return left, top, width and height of ``roi``; zeros where it is not said."""
    roi = message.get("roi")
    names = ("x_offset", "y_offset", "width", "height")
    fields = roi if isinstance(roi, Mapping) else {name: getattr(roi, name, 0) for name in names}
    left, top, across, down = (int(fields.get(name) or 0) for name in names)
    return left, top, across, down


def _projection(message: Mapping[str, Any]) -> list[float] | None:
    """Return fx, fy, cx, cy of P (3, 4) of a CameraInfo; None where it is left at zero."""
    given = message.get("p", message.get("P"))
    p = np.asarray(() if given is None else given, np.float64).ravel()
    if p.shape != (12,) or p[0] == 0:
        return None
    return [float(p[place]) for place in (0, 5, 2, 6)]


def baseline_m(message: Mapping[str, Any]) -> tuple[float, float]:
    """Return where a rectified camera has the origin of its frame, m to the right and down.

    The second camera of a stereo pair is described in the frame of the first, and P holds how far
    it stands off, times the focal length (``sensor_msgs/CameraInfo``: Tx, Ty).

    Examples
    --------
    >>> baseline_m({"p": [50.0, 0, 32, -5, 0, 50, 24, 0, 0, 0, 1, 0]})
    (-0.1, 0.0)
    """
    projection = _projection(message)
    if projection is None:
        return 0.0, 0.0
    given = message.get("p", message.get("P"))
    p = np.asarray(given, np.float64).ravel()
    return float(p[3] / projection[0]), float(p[7] / projection[1] if projection[1] else 0.0)


def has_same_rays(first: Lens, other: Lens) -> bool:
    """Whether two lenses look along the same rays, at whatever resolution, to 2 % of the image.

    Examples
    --------
    >>> full, half = Intrinsics(8, 4, 9.0, 9.0, 3.5, 1.5), Intrinsics(4, 2, 4.5, 4.5, 1.5, 0.5)
    >>> has_same_rays(Lens(full), Lens(half))
    True
    """
    camera = first.intrinsics
    same = scaled(other.intrinsics, camera.width, camera.height)
    off = [camera.fx - same.fx, camera.fy - same.fy, camera.cx - same.cx, camera.cy - same.cy]
    return bool(np.max(np.abs(off)) <= _SAME_RAYS * max(camera.width, camera.height))


def undistorted(
    lens: Lens, rgb: UInt8Array | None = None, depth_m: FloatArray | None = None
) -> tuple[UInt8Array | None, NDArray[np.float32] | None]:
    """Return colour and depth as a pinhole of the lens's own intrinsics would see them.

    Depth is picked from the nearest pixel, since between two surfaces there is none; pixels that
    the lens did not see are black and without depth.

    Parameters
    ----------
    rgb : (h, w, 3) uint8 or None
    depth_m : (h, w) float, m, or None
    """
    if not lens.is_distorted:
        return rgb, None if depth_m is None else np.asarray(depth_m, np.float32)
    camera = lens.intrinsics
    matrix, size = _matrix(camera), (camera.width, camera.height)
    straighten = (
        cv2.fisheye.initUndistortRectifyMap if lens.is_fisheye else cv2.initUndistortRectifyMap
    )
    coefficients = np.array(lens.distortion)
    maps = straighten(matrix, coefficients, np.eye(3), matrix, size, cv2.CV_32FC1)
    straight, depth = rgb, None
    if rgb is not None:
        straight = np.asarray(cv2.remap(rgb, *maps, cv2.INTER_LINEAR), dtype=np.uint8)
    if depth_m is not None:
        depth = np.asarray(
            cv2.remap(finite_depth(depth_m), *maps, cv2.INTER_NEAREST), dtype=np.float32
        )
    return straight, depth


def align_colour(
    depth_m: FloatArray,
    depth_camera: Intrinsics,
    rgb: UInt8Array,
    colour_camera: Intrinsics | None = None,
    colour_from_depth: Float64Array | None = None,
) -> Frame:
    """Return depth with the colour of another camera, or of another size, at each of its pixels.

    Parameters
    ----------
    depth_m : (h, w) float, m
        0 or not finite = missing.
    depth_camera
        Of ``depth_m``.
    rgb : (k, l, 3) uint8
    colour_camera
        Of ``rgb``; None = the same camera at another resolution.
    colour_from_depth : (4, 4) float64, m, or None
        Pose of the depth camera in the frame of the colour camera; None = one place.

    Returns
    -------
    Frame
        In the depth camera. Black where the colour camera does not look, or where there is no
        depth to say where it looks. What the colour camera cannot see for something nearer keeps
        the colour of that.

    Raises
    ------
    ValueError
        When the sides of the images differ in more than their scale and no camera is given.
    """
    depth = finite_depth(depth_m)
    height, width = depth.shape
    if colour_camera is None and colour_from_depth is None:
        down, across = rgb.shape[0] / height, rgb.shape[1] / width
        if abs(down / across - 1) > 0.01:
            raise ValueError(
                f"colour of {rgb.shape[1]}x{rgb.shape[0]} px does not show what depth of "
                f"{width}x{height} px shows; say how the colour camera is built and where it sits"
            )
        # Averaged when it shrinks: picking single pixels would alias fine print.
        way = cv2.INTER_AREA if across > 1 else cv2.INTER_LINEAR
        same = rgb if down == across == 1 else cv2.resize(rgb, (width, height), interpolation=way)
        return Frame(depth, depth_camera, np.asarray(same, dtype=np.uint8))
    lens = colour_camera or scaled(depth_camera, rgb.shape[1], rgb.shape[0])
    pose = np.eye(4) if colour_from_depth is None else np.asarray(colour_from_depth, np.float64)
    points = points_from_depth(depth, depth_camera) @ pose[:3, :3].T + pose[:3, 3]
    z = points[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        u = lens.fx * points[..., 0] / z + lens.cx
        v = lens.fy * points[..., 1] / z + lens.cy
        seen = (z > 0) & (u > -0.5) & (u < lens.width - 0.5) & (v > -0.5) & (v < lens.height - 0.5)
    # Far outside, where remap gives the border; NaN would be undefined in it.
    across, down = (np.where(seen, axis, -10).astype(np.float32) for axis in (u, v))
    colours = cv2.remap(rgb, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    colours[~seen] = 0
    return Frame(depth, depth_camera, np.asarray(colours, dtype=np.uint8))


def scaled(camera: Intrinsics, width: int, height: int) -> Intrinsics:
    """Return the same camera at another resolution; pixel centres lie at whole numbers.

    Examples
    --------
    >>> scaled(Intrinsics(4, 2, 8.0, 8.0, 1.5, 0.5), 8, 4).cx
    3.5
    """
    across, down = width / camera.width, height / camera.height
    return Intrinsics(
        width, height, camera.fx * across, camera.fy * down,
        (camera.cx + 0.5) * across - 0.5, (camera.cy + 0.5) * down - 0.5,
    )  # fmt: skip


def camera_of_grid(points: FloatArray) -> Intrinsics | None:
    """Return the pinhole from whose pixels an organised cloud was made, if it was.

    Parameters
    ----------
    points : (h, w, 3) float, m, optical frame
        NaN = missing.

    Returns
    -------
    None when the points do not lie on the rays of such a camera, as after a transform.

    Examples
    --------
    >>> camera = Intrinsics(64, 48, 80.0, 82.0, 31.0, 24.5)
    >>> z = np.random.default_rng(0).uniform(0.5, 1, (48, 64))
    >>> found = camera_of_grid(points_from_depth(z, camera))
    >>> round(found.fx, 3), round(found.cy, 3)
    (80.0, 24.5)
    """
    height, width = points.shape[:2]
    usable = np.isfinite(points).all(axis=-1)
    usable &= np.where(usable, points[..., 2], 0) > 1e-3
    v, u = np.nonzero(usable)
    if len(u) < _MIN_GRID_POINTS:
        return None
    rays = points[v, u, :2].astype(np.float64) / points[v, u, 2:]
    axes = []
    for pixels, slopes in ((u, rays[:, 0]), (v, rays[:, 1])):
        if np.ptp(slopes) < 1e-6:
            return None
        focal, centre = np.polyfit(slopes, pixels, 1)
        off = np.abs(focal * slopes + centre - pixels)
        if focal <= 0 or np.quantile(off, 0.99) > _MAX_GRID_ERROR_PX:
            return None
        axes.append((float(focal), float(centre)))
    (fx, cx), (fy, cy) = axes
    return Intrinsics(width, height, fx, fy, cx, cy)


def frame_of_grid(cloud: Cloud) -> Frame | None:
    """Return an organised, coloured cloud as the frame of its camera; None if it has none."""
    if not cloud.is_organised or cloud.colours is None:
        return None
    points, colours = cloud.grid()
    camera = camera_of_grid(points)
    if camera is None:
        return None
    depth = finite_depth(points[..., 2])
    return Frame(
        np.where(depth > 0, depth, np.float32(0)), camera, colours, frame_id=cloud.frame_id,
        stamp_s=cloud.stamp_s,
    )  # fmt: skip


def _matrix(camera: Intrinsics) -> Float64Array:
    return np.array(
        [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]], np.float64
    )
