"""Doubts about depth and clouds: what was not measured, or is in another unit or frame.

No format of depth says all of its unit, its frame and what stands for "not measured". What can be
told from the numbers is told here, in a sentence; nothing is changed by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.ros import DEPTH_ENCODINGS, pixels_of_image
from features.geometry import Float64Array, FloatArray, Intrinsics, points_from_depth
from features.segmentation.plane import find_table_plane

__all__ = [
    "doubtful_bytes",
    "doubtful_camera",
    "doubtful_distortion",
    "doubtful_frame",
    "doubtful_inverse",
    "doubtful_rays",
    "doubtful_steps",
    "implausible_cloud",
    "implausible_depth",
    "implausible_middle",
    "implausible_object",
    "implausible_support",
    "upright_frame",
]

_NEAREST_M, _FARTHEST_M = 0.1, 6.0
"""Median depth of what a camera at a table may see."""
_WIDEST_M = 10.0
"""Median distance from their middle of the points that it may see."""
_BEHIND = 0.01
"""Share of points behind a camera that errors of measurement do not explain."""
_UPRIGHT_FRAMES = ("base_footprint", "base_link", "base", "odom", "map", "world")
_LARGEST_OBJECT_M = 1.0
"""Median distance of an object's points from their middle; a box of centimetres has some 5."""
_UNDER_M, _OVER_M = 0.05, 1.0
"""How far an object may reach below its support by errors of measurement, and how far its lowest
visible point may be above: the top alone of a tall one is seen from above."""
_OFF_CENTRE, _STRETCHED = 0.25, 1.25
"""A principal point farther from the middle, of the side, and pixels less square, are no camera's
that shows all of its sensor."""
_LEFT_IN_VIEW = 0.5
"""Share of the depth of a wide lens that stays in view at least when it is straightened."""
_NO_NUMBER_M = 1e-6
_ROUGHER = 20
"""Neighbours differ so many times more if the bytes of each number are read in the wrong order."""
_STEP_PX, _FEW_PX = 3, 60_000
"""Every third row and column tells as much of numbers, and sorts in a ninth of the time; of an
image of fewer pixels all are needed."""
_INDEX_BITS = (4, 3, 2)
_SAME_INDEX, _MIN_STEPS, _LARGEST_STEP = 0.9, 100, 3
"""Of so many neighbours on a surface, a few units apart above their lowest bits, such a share has
the same bits below: of depth alone, one in four to sixteen has."""
_MAX_PLATEAU, _OUTSTANDING, _MANY_NUMBERS = 0.01, 10, 50
"""One number of so many that holds such a share, so many times that of any near it, was not
measured: noise spreads even a wall that faces the camera."""
_NEAR_NUMBERS = 0.1
_NOISY = 0.3
"""Share of the pixels that differ from one beside them, at least, where there is noise: in a clean
picture only borders do."""
_NOISE_M = 0.0015
"""Median second difference along rows: twice as much as rounding to millimetres makes."""
_BENT = 1.5
"""By so much more points lie in one plane if depth is taken as a distance along the ray."""
_MIN_PLANE_SHARE = 0.3
_MOST_POINTS, _DRAWS, _OFF_LINE, _FLATTER = 2_000, 300, 0.012, 1.5
"""Noise at a table is half of that share of the spread of depth; by so much more points lie in one
plane if the numbers are linear in inverse depth."""
_OFF_PLANE_M, _NEAR_PLANE_M = 0.012, 0.4
_MIN_OFF_PLANE, _BEHIND_PLANE = 200, 0.9
"""So many points stand off the table, and so large a share on the side that no camera sees."""


def implausible_depth(depth_m: NDArray[np.float32]) -> str:
    """Return why the unit of a depth image is doubtful; empty if it is plausible.

    Examples
    --------
    >>> implausible_depth(np.full((2, 2), 700.0, np.float32))
    'half of the depth lies beyond 700 m: is it in another unit?'
    """
    measured = depth_m[depth_m > 0]
    if not len(measured):
        return ""
    return implausible_middle(float(np.median(measured))) or _outstanding(depth_m)


def implausible_middle(middle_m: float) -> str:
    """Return why the unit is doubtful if half of what a camera sees lies nearer, m; else nothing.

    Examples
    --------
    >>> implausible_middle(0.0007)
    'half of the depth lies within 0.0007 m: is it in another unit?'
    """
    if middle_m > _FARTHEST_M:
        return f"half of the depth lies beyond {middle_m:.3g} m: is it in another unit?"
    if middle_m < _NO_NUMBER_M:
        return f"half of the depth lies within {middle_m:.3g} m: are its bytes in another order?"
    if middle_m < _NEAREST_M:
        return f"half of the depth lies within {middle_m:.3g} m: is it in another unit?"
    return ""


def _outstanding(depth_m: NDArray[np.float32]) -> str:
    """Return which single number holds more of a depth image than a surface can; else nothing."""
    step = _STEP_PX if depth_m.size > _FEW_PX else 1
    some = depth_m[::step, ::step]
    numbers, counts = np.unique(some[some > 0], return_counts=True)
    if len(numbers) < _MANY_NUMBERS:
        return ""
    most = int(counts.argmax())
    share, off = counts[most] / counts.sum(), np.abs(numbers - numbers[most])
    # Far away, the steps of a stereo camera are a hundredth of the depth: a tenth holds some.
    is_near = (off > 0) & (off < _NEAR_NUMBERS * numbers[most])
    next_most = int(counts[is_near].max(initial=0))
    if share < _MAX_PLATEAU or counts[most] < _OUTSTANDING * next_most:
        return ""
    # Without noise a wall that faces the camera is of one number, too.
    bends = np.abs(np.diff(depth_m, n=2, axis=1))[(depth_m[:, 1:-1] > 0) & _differ(depth_m)]
    if len(bends) < _NOISY * np.count_nonzero(depth_m > 0) or np.median(bends) < _NOISE_M:
        return ""
    return (
        f"{share:.0%} of the depth is exactly {numbers[most]:.4g} m, which no surface is that is "
        "seen with noise: does that stand for what was not measured?"
    )


def _differ(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return which pixels (h, w - 2) differ from one beside them."""
    steps = np.diff(depth_m, axis=1) != 0
    differ: NDArray[np.bool_] = steps[:, 1:] | steps[:, :-1]
    return differ


def doubtful_steps(steps: NDArray[np.integer[Any]]) -> str:
    """Return why the step of a depth image of whole numbers is doubtful; empty if it is not.

    Examples
    --------
    >>> doubtful_steps(np.arange(500, 900).reshape(20, 20) * 5)
    'every number is a multiple of 5: is a step 1/5 of a millimetre, 0.0002 m?'
    """
    numbers = np.unique(steps[steps > 0])
    if len(numbers) < _MANY_NUMBERS:
        return ""
    by = int(np.gcd.reduce(numbers))
    if by < 2:
        bits = _index_bits(steps)
        if not bits:
            return ""
        return (
            f"neighbours that differ have the same lowest {bits} bits: is that an index, as of the "
            f"persons of a Kinect? A step then is 1/{2**bits} of a millimetre, "
            f"{0.001 / 2**bits:.4g} m"
        )
    # Cameras count millimetres: TUM's data sets hold five steps of each, the first Kinect's eight.
    return (
        f"every number is a multiple of {by}: is a step 1/{by} of a millimetre, {0.001 / by:.4g} m?"
    )


def _index_bits(steps: NDArray[np.integer[Any]]) -> int:
    """Return how many of the lowest bits hold something else than depth; 0 if none seem to.

    Kinect's SDK writes depth << 3 | player: 5,600 for .7 m, which would pass for the far wall.
    """
    here, there = steps[:, :-1].astype(np.int64), steps[:, 1:].astype(np.int64)
    is_measured = (here > 0) & (there > 0)
    here, there = here[is_measured], there[is_measured]
    for bits in _INDEX_BITS:
        apart = np.abs((here >> bits) - (there >> bits))
        is_step = (apart > 0) & (apart <= _LARGEST_STEP)
        is_same = ((here ^ there) & (2**bits - 1))[is_step] == 0
        if len(is_same) >= _MIN_STEPS and is_same.mean() > _SAME_INDEX:
            return bits
    return 0


def doubtful_bytes(message: Mapping[str, Any]) -> str:
    """Return why the bytes of an Image of 16 bits may be in another order than it says.

    Neighbours on a surface differ by little; with their bytes exchanged, by 256 times as much.

    Examples
    --------
    >>> steps = np.arange(600, 856, dtype=">u2").reshape(16, 16)
    >>> image = {"encoding": "16UC1", "height": 16, "width": 16, "data": steps.tobytes()}
    >>> doubtful_bytes(image)
    'its surfaces are smooth only if the bytes of each number are exchanged: is is_bigendian wrong?'
    >>> doubtful_bytes(image | {"is_bigendian": 1})
    ''
    """
    if message.get("encoding") not in ("mono16", *DEPTH_ENCODINGS):
        return ""
    steps = pixels_of_image(message)
    if steps.dtype != np.uint16:
        return ""
    read, exchanged = _roughness(steps), _roughness(steps.byteswap())
    if exchanged * _ROUGHER > read or not exchanged < read:
        return ""
    return (
        "its surfaces are smooth only if the bytes of each number are exchanged: is is_bigendian "
        "wrong?"
    )


def _roughness(steps: NDArray[np.uint16]) -> float:
    """Return the median difference of neighbours that were measured, and at least half a step."""
    apart = np.abs(np.diff(steps.astype(np.int64), axis=1))[
        (steps[:, 1:] > 0) & (steps[:, :-1] > 0)
    ]
    return max(float(np.median(apart)), 0.5) if len(apart) else 0.0


def doubtful_camera(camera: Intrinsics) -> str:
    """Return why the numbers of a camera may be of another image; empty if they may be its own.

    Parameters
    ----------
    camera
        Of the whole sensor: a part that was cut out has its principal point anywhere.

    Examples
    --------
    >>> doubtful_camera(Intrinsics(640, 480, 1200.0, 1200.0, 639.5, 479.5))
    'a centre at (640, 480) of 640x480 px, far from the middle: are K or P of another size?'
    """
    size = f"{camera.width}x{camera.height} px"
    for centre, side in ((camera.cx, camera.width), (camera.cy, camera.height)):
        if abs(centre - (side - 1) / 2) > _OFF_CENTRE * side:
            return (
                f"a centre at ({camera.cx:.3g}, {camera.cy:.3g}) of {size}, far from the middle: "
                "are K or P of another size?"
            )
    if max(camera.fx / camera.fy, camera.fy / camera.fx) > _STRETCHED:
        return (
            f"focal lengths of {camera.fx:.4g} across and {camera.fy:.4g} down, for {size}: are K "
            "or P of another size?"
        )
    return ""


def doubtful_distortion(seen_m: NDArray[np.float32], straight_m: NDArray[np.float32]) -> str:
    """Return why a distortion may not be that of an image; empty if it may be.

    Parameters
    ----------
    seen_m, straight_m : (h, w) float32, m
        Depth before and after it was straightened.

    Examples
    --------
    >>> doubtful_distortion(np.ones((4, 4), np.float32), np.eye(4, dtype=np.float32))
    'its distortion leaves 25% of its depth in view: are D and K its own?'
    """
    seen, left = np.count_nonzero(seen_m > 0), np.count_nonzero(straight_m > 0)
    if left >= _LEFT_IN_VIEW * seen:
        return ""
    return f"its distortion leaves {left / seen:.0%} of its depth in view: are D and K its own?"


def doubtful_rays(depth_m: NDArray[np.float32], camera: Intrinsics) -> str:
    """Return why depth may be the distance along each ray instead of along the axis; else nothing.

    A table that is flat in the one is bent in the other: some simulators and cameras that measure
    the time of flight write the distance (REP 118 asks for the axis).
    """
    along_axis = points_from_depth(depth_m, camera)
    plane = find_table_plane(along_axis)
    length = np.linalg.norm(along_axis / along_axis[..., 2:], axis=-1, keepdims=True)
    other = find_table_plane(along_axis / length)
    if other is None or other.inlier_share < _MIN_PLANE_SHARE:
        return ""
    if plane is not None and other.inlier_share < _BENT * plane.inlier_share:
        return ""
    return (
        "its largest plane is flat only if depth is the distance along each ray: it is read as "
        "that along the axis of the camera (REP 118)"
    )


def doubtful_inverse(depth_m: NDArray[np.float32]) -> str:
    """Return why numbers may be disparity or inverse depth; empty if they may be depth.

    Over the pixels of a plane the inverse of its depth is linear; depth itself is not. A z-buffer
    is linear as well, but holds so narrow a range that its inverse nearly is, too: it is not told.

    Examples
    --------
    >>> v, u = np.mgrid[:48, :64].astype(np.float32)
    >>> inverse = (0.8 + 0.02 * v + 0.001 * u).astype(np.float32)
    >>> doubtful_inverse(1 / inverse)
    ''
    >>> doubtful_inverse(inverse)[:51]
    'its largest plane is flat only if the numbers are d'
    """
    rows, columns = np.nonzero(depth_m > 0)
    if len(rows) < _MOST_POINTS // 4:
        return ""
    rng = np.random.default_rng(0)  # the same image, the same answer
    some = rng.permutation(len(rows))[:_MOST_POINTS]
    numbers = depth_m[rows[some], columns[some]].astype(np.float64)
    pixels = np.stack([columns[some], rows[some], np.ones(len(some))], axis=1).astype(np.float64)
    drawn = rng.integers(len(some), size=(_DRAWS, 3))
    linear, inverse = (_linear_share(pixels, each, drawn) for each in (numbers, 1 / numbers))
    if linear < _MIN_PLANE_SHARE or linear < _FLATTER * inverse:
        return ""
    return (
        "its largest plane is flat only if the numbers are disparity or inverse depth: they are "
        "read as depth"
    )


def _linear_share(
    pixels: NDArray[np.float64], numbers: NDArray[np.float64], drawn: NDArray[np.int64]
) -> float:
    """Return the largest share of numbers (n,) that is linear over its pixels (n, 3), 1 last."""
    low, high = np.percentile(numbers, [5, 95])
    corners = pixels[drawn]
    is_sound = np.abs(np.linalg.det(corners)) > 1.0
    if not high > low or not is_sound.any():
        return 0.0
    slopes = np.linalg.solve(corners[is_sound], numbers[drawn[is_sound]][..., None])[..., 0]
    off = np.abs(slopes @ pixels.T - numbers)
    return float((off < _OFF_LINE * (high - low)).mean(axis=1).max())


def implausible_cloud(positions: NDArray[np.float32]) -> str:
    """Return why the unit of points (n, 3), m, is doubtful; empty if it is plausible.

    What a robot sees of a table lies together, wherever the origin is.

    Examples
    --------
    >>> implausible_cloud(np.array([[0, 0, 700], [90, 0, 730], [-80, 10, 690]], np.float32))
    'half of the points lie 81.2 m apart from their middle: are they in another unit?'
    """
    return _apart(positions, _WIDEST_M)


def doubtful_frame(positions: NDArray[np.float32], frame_id: str) -> str:
    """Return why points (n, 3), m, may not be in a camera's frame; empty if they may be.

    A camera has x to the right, y down and z forward (REP 103) and sees nothing behind itself; the
    frames of a robot and of maps have z up (REP 105).

    Examples
    --------
    >>> ahead = np.array([[0.1, 0.2, 0.7]], np.float32)
    >>> doubtful_frame(ahead, "camera_depth_optical_frame")
    ''
    >>> doubtful_frame(ahead, "nao1/base_link")
    'in the frame nao1/base_link, which has z up: it is read as that of a camera, z forward'
    """
    behind = float((positions[:, 2] < 0).mean()) if len(positions) else 0.0
    if behind > _BEHIND:
        return f"{behind:.0%} of the points lie behind the camera: is z forward in their frame?"
    return upright_frame(frame_id) or _behind_table(positions)


def upright_frame(frame_id: str) -> str:
    """Return why points of a camera are not in a frame, by its name; empty if they may be.

    Examples
    --------
    >>> upright_frame("map")
    'in the frame map, which has z up: it is read as that of a camera, z forward'
    """
    if frame_id.rpartition("/")[2] not in _UPRIGHT_FRAMES:
        return ""
    return f"in the frame {frame_id}, which has z up: it is read as that of a camera, z forward"


def _behind_table(positions: NDArray[np.float32]) -> str:
    """Return that no camera at the origin sees what stands on the table, if that is so."""
    plane = find_table_plane(positions)
    if plane is None:
        return ""
    heights = plane.heights(positions)
    stands = (np.abs(heights) > _OFF_PLANE_M) & (np.abs(heights) < _NEAR_PLANE_M)
    # The floor that is seen past the edge of a table lies behind it as well, but beside it.
    stands &= _over(positions, np.abs(heights) < _OFF_PLANE_M, plane.normal)
    if np.count_nonzero(stands) < _MIN_OFF_PLANE or (heights[stands] < 0).mean() < _BEHIND_PLANE:
        return ""
    return (
        "what stands on the largest plane lies behind it as seen from the origin: is the origin a "
        "camera's, with z forward, or that of a robot?"
    )


def _over(
    positions: NDArray[np.float32], is_plane: NDArray[np.bool_], normal: Float64Array
) -> NDArray[np.bool_]:
    """Return which points (n, 3) lie over or under those of a plane, within the middle .9 of it."""
    across = np.linalg.svd(normal[None])[2][1:]
    flat = positions @ across.T
    low, high = np.quantile(flat[is_plane], [0.05, 0.95], axis=0)
    inside: NDArray[np.bool_] = ((flat > low) & (flat < high)).all(axis=1)
    return inside


def implausible_object(positions: FloatArray) -> str:
    """Return why the unit of the points (n, 3), m, of one object is doubtful; empty if plausible.

    Examples
    --------
    >>> implausible_object(np.array([[0, 0, 700], [9, 0, 730], [-8, 10, 690]], np.float32))
    'half of the points lie 16.2 m apart from their middle: are they in another unit?'
    """
    return _apart(positions, _LARGEST_OBJECT_M)


def implausible_support(heights: FloatArray, support: float) -> str:
    """Return why an object cannot stand at a height; empty if it can.

    Parameters
    ----------
    heights : (n,), m
        Of its visible points; none tell nothing.
    support : m
        Height of what it stands on, in the same frame.

    Examples
    --------
    >>> implausible_support(np.array([0.0, 0.03, 0.06]), 750.0)
    'the object lies from 0.00 to 0.06 m, all of it below 750 m: another unit, or another frame?'
    """
    if not len(heights):
        return ""
    low, high = (float(h) for h in np.percentile(heights, [2, 98]))
    if high < support - _UNDER_M:
        where = f"all of it below {support:g} m"
    elif low > support + _OVER_M:
        where = f"{low - support:.3g} m above {support:g} m"
    else:
        return ""
    return (
        f"the object lies from {low:.2f} to {high:.2f} m, {where}: another unit, or another frame?"
    )


def _apart(positions: FloatArray, most_m: float) -> str:
    if not len(positions):
        return ""
    off = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    apart = float(np.median(off))
    if apart <= most_m:
        return ""
    return (
        f"half of the points lie {apart:.3g} m apart from their middle: are they in another unit?"
    )
