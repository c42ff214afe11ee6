"""A camera's intrinsics, distortion and place beside depth, estimated from a chessboard.

The thesis calibrates a Kinect's colour and depth (Gatto 2016, 2.3). Intrinsics and distortion are
those of Zhang (2000), as OpenCV fits them. Depth does not see a print, but the plane that carries
it: the planes of several postures of the board, as colour and as depth see them, tell how the two
cameras stand to each other (Zhang and Zhang 2011, "Calibration between depth and color sensors for
commodity depth cameras").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from features.geometry import Float64Array, Intrinsics, finite_depth, pose_matrix
from features.imaging.camera import Lens, undistorted

__all__ = ["Board", "EstimatedLens", "EstimatedPlace", "estimate_lens", "estimate_place"]

_LEAST_VIEWS = 6
_MAX_FOCAL_ERROR = 0.02
"""Largest standard error of a focal length, as a share of it."""
_MAX_DISAGREEMENT = 3.5
"""Largest spread of the centre over the pictures left out, in standard errors: at most 2.8 in 144
sets of 6 to 12 boards, and mostly more than 4 where three of 6 or 9 pictures are shifted."""
_LEAST_TILT_RAD = 0.35
_MAX_PLACE_ERROR_M = 0.01
_REACH_PX = (2, 8)
"""Half the side of the window in which a corner is refined."""
_OFF = 3.0
_MIN_OFF_PX = 0.5
_PLANE_TRIES, _PLANE_M = 100, 0.01
_MIN_PLANE_PX = 300
_SAMPLES = 400
_ROUNDS = 3


@dataclass(frozen=True)
class Board:
    """A printed chessboard: inner corners across and down, and the side of a square, m."""

    across: int
    down: int
    square_m: float

    def corners(self) -> Float64Array:
        """Return the inner corners (n, 3), m, row by row; the board is the plane z = 0."""
        places = np.zeros((self.across * self.down, 3))
        places[:, :2] = np.mgrid[: self.across, : self.down].T.reshape(-1, 2) * self.square_m
        return places

    def find(self, grey: NDArray[np.uint8]) -> Float64Array | None:
        """Return the inner corners (n, 2) in a picture (h, w), px; None where it is not seen."""
        flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        is_seen, corners = cv2.findChessboardCornersSB(grey, (self.across, self.down), flags=flags)
        if not is_seen:
            return None
        # Where edges meet is known better than the middle of the pattern: half of the error.
        grid = np.asarray(corners, np.float32).reshape(self.down, self.across, 2)
        sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        reach = int(np.clip(min(sides) / 2 - 1, *_REACH_PX))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        fine = cv2.cornerSubPix(grey, grid.reshape(-1, 1, 2), (reach, reach), (-1, -1), stop)
        return np.asarray(fine, np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class EstimatedLens:
    """A lens with what its estimate is worth.

    Parameters
    ----------
    lens
    reprojection_px
        Root mean square of the corners about their places.
    focal_error_px, centre_error_px
        Standard errors, the larger of both axes: those of the fit, or those of the jackknife over
        the pictures (Quenouille 1956; Efron and Stein 1981), which are larger where errors of one
        picture are alike.
    poses
        Of the board in the camera, (4, 4), m, by the number of the picture; those not listed show
        no board, or one that fits no other.
    reach
        How far from the principal point the boards were seen, of the way to the corner of the
        picture that is farthest from it. Beyond, the distortion is extrapolated: of rendered boards
        with a reach of .5, rays at the corners were off by a hundred pixels, and by one within.
    """

    lens: Lens
    reprojection_px: float
    focal_error_px: float
    centre_error_px: float
    poses: dict[int, Float64Array]
    reach: float

    @property
    def board_error_m(self) -> float:
        """How far its errors alone put a board off, at the median distance of the boards."""
        camera = self.lens.intrinsics
        distance_m = float(np.median([pose[2, 3] for pose in self.poses.values()]))
        worst_px = max(self.focal_error_px, self.centre_error_px)
        return distance_m * worst_px / min(camera.fx, camera.fy)


@dataclass(frozen=True)
class EstimatedPlace:
    """The place of a depth camera beside a colour camera.

    Parameters
    ----------
    colour_from_depth : (4, 4), m
    depth_scale
        Measured depth over true depth; 1 is right.
    place_error_m
        Standard error of the place, along the axis that is known worst, if the boards are where
        the pictures put them; :attr:`EstimatedLens.board_error_m` comes on top.
    residual_m
        Root mean square distance of the points of depth from the boards.
    views
        Number of views that were used.
    """

    colour_from_depth: Float64Array
    depth_scale: float
    place_error_m: float
    residual_m: float
    views: int


def estimate_lens(pictures: Sequence[NDArray[np.uint8]], board: Board) -> EstimatedLens:
    """Return the lens that took pictures of a chessboard in several postures.

    k3 is left at zero: few pictures show the board in the corners of the image, where it acts.

    Parameters
    ----------
    pictures : (h, w) uint8 each
        Grey, of one size, as the camera gives them.

    Raises
    ------
    ValueError
        Fewer than six show the board, their postures leave the focal length open, or they do not
        agree on one camera.
    """
    shape = pictures[0].shape
    if any(picture.shape != shape for picture in pictures):
        raise ValueError("the pictures differ in size; one camera at one resolution is expected")
    seen = {k: board.find(picture) for k, picture in enumerate(pictures)}
    corners = {k: places for k, places in seen.items() if places is not None}
    fitted = _fit_lens(corners, board, shape)
    off = {k: float(error) for k, error in zip(corners, fitted.errors, strict=True)}
    limit = max(_OFF * float(np.median(list(off.values()))), _MIN_OFF_PX)
    if max(off.values()) > limit:
        corners = {k: places for k, places in corners.items() if off[k] <= limit}
        fitted = _fit_lens(corners, board, shape)
    matrix, spread = fitted.matrix, fitted.spread
    if spread[0] > _MAX_FOCAL_ERROR * matrix[0, 0] or spread[1] > _MAX_FOCAL_ERROR * matrix[1, 1]:
        raise ValueError(
            f"the focal length is open by {max(spread[:2]):.0f} of {matrix[0, 0]:.0f} px: show the "
            "board tilted to each side, near and far"
        )
    normals = np.array([pose[:3, 2] for pose in fitted.poses])
    apart_rad = float(np.arccos(np.clip(normals @ normals.T, -1, 1)).max())
    if apart_rad < _LEAST_TILT_RAD:
        # Boards that face the camera fit every focal length, each at another distance.
        raise ValueError(
            f"the postures of the board differ by {np.degrees(apart_rad):.0f} degrees, which "
            "leaves the focal length open: tilt it to each side"
        )
    jackknife = _jackknife(fitted, corners, board, shape)
    camera = Intrinsics(shape[1], shape[0], matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    return EstimatedLens(
        Lens(camera, tuple(float(value) for value in fitted.distortion)),
        fitted.reprojection_px,
        float(max(*spread[:2], *jackknife[:2])),
        float(max(*spread[2:4], *jackknife[2:])),
        dict(zip(corners, fitted.poses, strict=True)),
        _reach(np.concatenate(list(corners.values())), camera),
    )


def _reach(corners: Float64Array, camera: Intrinsics) -> float:
    """Return how far corners of boards (n, 2) reach from the principal point, of the whole way."""
    centre = np.array([camera.cx, camera.cy])
    size = np.array([camera.width - 1, camera.height - 1])
    farthest = np.linalg.norm(np.maximum(centre, size - centre))
    return float(np.linalg.norm(corners - centre, axis=1).max() / farthest)


@dataclass(frozen=True)
class _Fit:
    matrix: Float64Array
    distortion: Float64Array
    reprojection_px: float
    spread: Float64Array
    errors: Float64Array
    poses: list[Float64Array]


def _jackknife(
    fitted: _Fit, corners: dict[int, Float64Array], board: Board, shape: tuple[int, ...]
) -> Float64Array:
    """Return standard errors of fx, fy, cx and cy (4,), px, by leaving out one picture at a time.

    A picture that was cropped or taken at another zoom is hardly seen in the residuals: its board
    is turned a little instead. But the camera moves when it is left out.

    Raises
    ------
    ValueError
        The centre moves by far more than its standard errors allow.
    """
    moved, errors = {}, []
    for left_out in corners:
        others = {k: places for k, places in corners.items() if k != left_out}
        fit = _fit_lens(others, board, shape, least=_LEAST_VIEWS - 1)
        moved[left_out] = _lens_numbers(fit.matrix) - _lens_numbers(fitted.matrix)
        errors.append(fit.spread[:4])
    moves = np.array(list(moved.values()))
    count = len(moves)
    spread = np.sqrt((count - 1) / count * ((moves - moves.mean(axis=0)) ** 2).sum(axis=0))
    # Where few pictures hold the camera, it moves much without one, and the errors say so.
    expected = np.sqrt(np.mean(np.square(errors), axis=0))
    if (spread[2:] > _MAX_DISAGREEMENT * expected[2:]).any():
        worst = max(moved, key=lambda k: float(np.abs(moved[k][2:]).max()))
        raise ValueError(
            f"the pictures do not agree on one camera: without picture {worst + 1} its centre "
            f"moves by {np.abs(moved[worst][2:]).max():.1f} px, where {expected[2:].max():.1f} are "
            "its standard error; leave out those that were cropped or taken at another zoom"
        )
    return np.asarray(spread, np.float64)


def _lens_numbers(matrix: Float64Array) -> Float64Array:
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])


def _fit_lens(
    corners: dict[int, Float64Array], board: Board, shape: tuple[int, ...],
    least: int = _LEAST_VIEWS,
) -> _Fit:  # fmt: skip
    if len(corners) < least:
        raise ValueError(
            f"{len(corners)} pictures show a chessboard of {board.across} x {board.down} inner "
            f"corners; at least {_LEAST_VIEWS} are needed"
        )
    places = board.corners().astype(np.float32)
    size = (shape[1], shape[0])
    start = np.array([[max(size), 0, size[0] / 2], [0, max(size), size[1] / 2], [0, 0, 1.0]])
    try:
        error, matrix, distortion, turns, shifts, spread, _, errors = cv2.calibrateCameraExtended(
            [places] * len(corners),
            [pixels.astype(np.float32) for pixels in corners.values()],
            size, start, np.zeros(5), flags=cv2.CALIB_FIX_K3,
        )  # fmt: skip
    except cv2.error as failed:
        raise ValueError(f"the pictures do not determine a camera ({failed.err})") from None
    poses = [_pose(turn, shift) for turn, shift in zip(turns, shifts, strict=True)]
    return _Fit(
        np.asarray(matrix, np.float64), np.asarray(distortion, np.float64).ravel()[:5],
        float(error), np.asarray(spread, np.float64).ravel(),
        np.asarray(errors, np.float64).ravel(), poses,
    )  # fmt: skip


def _pose(turn: NDArray[Any], shift: NDArray[Any]) -> Float64Array:
    return pose_matrix(
        np.asarray(cv2.Rodrigues(np.asarray(turn, np.float64))[0]),
        np.asarray(shift, np.float64).ravel(),
    )


def estimate_place(
    boards: dict[int, Float64Array], board: Board, depths_m: Sequence[NDArray[np.float32]],
    depth_lens: Lens,
) -> EstimatedPlace:  # fmt: skip
    """Return where a depth camera stands beside the colour camera that saw the same boards.

    Parameters
    ----------
    boards
        Poses of the board in the colour camera, (4, 4), m, by the number of the view.
    depths_m : (h, w) float32 each, m
        Depth of all views; 0 = missing.
    depth_lens
        Of the depth camera.

    Raises
    ------
    ValueError
        Too few boards are seen in depth, or their postures leave the place open.
    """
    straight = {}
    for k in boards:
        _, depth = undistorted(depth_lens, None, finite_depth(depths_m[k]))
        assert depth is not None
        straight[k] = depth
    pose = np.eye(4)
    rng = np.random.default_rng(0)
    for _ in range(_ROUNDS):
        planes = {
            k: points
            for k, depth in straight.items()
            if (points := _on_board(depth, depth_lens.intrinsics, boards[k], board, pose, rng))
            is not None
        }
        if len(planes) < _LEAST_VIEWS:
            raise ValueError(
                f"depth shows the plane of {len(planes)} boards; at least {_LEAST_VIEWS} are needed"
            )
        pose, scale, error_m, residual_m = _fit_place(planes, boards, pose)
    if not error_m < _MAX_PLACE_ERROR_M:
        raise ValueError(
            f"the place of the depth camera is open by {error_m:.2g} m: tilt the board to each side"
        )
    return EstimatedPlace(pose, scale, error_m, residual_m, len(planes))


def _on_board(
    depth_m: NDArray[np.float32], camera: Intrinsics, seen: Float64Array, board: Board,
    pose: Float64Array, rng: np.random.Generator,
) -> Float64Array | None:  # fmt: skip
    """Return points (n, 3), m, of depth on the plane of a board; None where there are too few."""
    corners = board.corners()
    outline = corners[[0, board.across - 1, -1, -board.across]]
    here = (np.linalg.inv(pose) @ seen)[:3]
    places = outline @ here[:, :3].T + here[:, 3]
    if (places[:, 2] <= 0).any():
        return None
    pixels = places[:, :2] / places[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    inside = np.zeros(depth_m.shape, np.uint8)
    polygon = np.rint(np.clip(pixels, -1e5, 1e5)).astype(np.int32)
    cv2.fillConvexPoly(inside, polygon, 1)
    v, u = np.nonzero((inside > 0) & (depth_m > 0))
    if len(u) < _MIN_PLANE_PX:
        return None
    z = depth_m[v, u].astype(np.float64)
    points = np.column_stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z])
    best: NDArray[np.bool_] = np.zeros(len(points), bool)
    for three in rng.integers(len(points), size=(_PLANE_TRIES, 3)):
        a, b, c = points[three]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-9:
            continue
        near = np.abs((points - a) @ normal) < _PLANE_M * length
        best = near if near.sum() > best.sum() else best
    on_plane = points[best]
    if len(on_plane) < max(_MIN_PLANE_PX, len(points) / 2):
        return None
    return on_plane[rng.choice(len(on_plane), min(_SAMPLES, len(on_plane)), replace=False)]


def _fit_place(
    planes: dict[int, Float64Array], boards: dict[int, Float64Array], start: Float64Array
) -> tuple[Float64Array, float, float, float]:
    """Return pose, scale of depth, standard error of the place and residual, m."""
    points = np.concatenate([planes[k] for k in planes])
    counts = [len(planes[k]) for k in planes]
    normals = np.repeat([boards[k][:3, 2] for k in planes], counts, axis=0)
    offsets = np.repeat([boards[k][:3, 2] @ boards[k][:3, 3] for k in planes], counts)

    def off(values: Float64Array) -> Float64Array:
        turned = Rotation.from_rotvec(values[:3]).apply(points / values[6]) + values[3:6]
        return np.asarray((turned * normals).sum(axis=1) - offsets, np.float64)

    first = np.concatenate([Rotation.from_matrix(start[:3, :3]).as_rotvec(), start[:3, 3], [1.0]])
    fitted = least_squares(off, first, loss="soft_l1", f_scale=0.005, x_scale="jac")
    pose = pose_matrix(Rotation.from_rotvec(fitted.x[:3]).as_matrix(), fitted.x[3:6])
    left = off(fitted.x)
    residual_m = float(np.sqrt(np.mean(left**2)))
    # Points of one board share what its pose and the sensor's bias leave over: a view counts once.
    means = [float(part.mean()) for part in np.split(left, np.cumsum(counts)[:-1])]
    spread_m = max(float(np.std(means)), residual_m / np.sqrt(_SAMPLES))
    inverse = np.linalg.pinv(fitted.jac.T @ fitted.jac * (len(planes) / len(points)))
    error_m = spread_m * float(np.sqrt(np.linalg.eigvalsh(inverse[3:6, 3:6]).max()))
    return pose, float(fitted.x[6]), error_m, residual_m
