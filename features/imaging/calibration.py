"""A camera's calibration checked against its depth (Gatto 2016, 2.3).

The thesis calibrates a Kinect so that every colour pixel gets the depth that belongs to it. Two
things can be checked without tools: whether depth ends where colours end, in any scene, and whether
a printed chessboard is as far and as large as it really is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array, Frame, UInt8Array

__all__ = ["BoardCheck", "Shift", "check_board", "registration_shift"]

_JUMP_M = 0.03
_MIN_EDGE_PX = 200
_BLUR_PX = 1.0
_MAX_SHIFT_PX = 12
_WINDOW_PX = 2
_MIN_MEASURED = 0.6


@dataclass(frozen=True)
class Shift:
    """Positions of the colours that belong to the edges of depth.

    Parameters
    ----------
    right_px, down_px
        From depth to colour; 0, 0 when they are registered.
    gain
        Strength of colour edges there over that without the shift, at least 1: near 1 the scene
        says little.
    edge_px
        Number of pixels at edges of depth.
    """

    right_px: int
    down_px: int
    gain: float
    edge_px: int


@dataclass(frozen=True)
class BoardCheck:
    """A chessboard as colour and as depth see it.

    Parameters
    ----------
    reprojection_px
        Root mean square of the corners about the best pose: what intrinsics and lens leave over.
    depth_scale
        Measured depth over the depth that the corners' pose says; 1 is right.
    depth_offset_m
        Median of measured minus expected depth.
    depth_noise_m
        Root mean square of what is left after scale.
    square_m
        Side of a square, measured in depth alone.
    distance_m
        Of the board.
    corners
        Inner corners with depth.
    """

    reprojection_px: float
    depth_scale: float
    depth_offset_m: float
    depth_noise_m: float
    square_m: float
    distance_m: float
    corners: int


def registration_shift(frame: Frame) -> Shift:
    """Return the shift at which edges of depth meet the strongest edges of colour.

    Parameters
    ----------
    frame
        With colour; of a scene in which things stand before others.

    Raises
    ------
    ValueError
        When there is no colour, or too few edges of depth to say anything.
    """
    if frame.rgb is None:
        raise ValueError("the frame has no colour image to compare depth with")
    edges = _depth_edges(frame.depth_m)
    inner = np.zeros_like(edges)
    inside = slice(_MAX_SHIFT_PX, -_MAX_SHIFT_PX)
    inner[inside, inside] = edges[inside, inside]
    rows, columns = np.nonzero(inner)
    if len(rows) < _MIN_EDGE_PX:
        raise ValueError(
            f"{len(rows)} px at edges of depth; at least {_MIN_EDGE_PX} are needed: show things "
            "that stand before others"
        )
    strength = _colour_edges(frame.rgb)
    span = range(-_MAX_SHIFT_PX, _MAX_SHIFT_PX + 1)
    scores = np.array(
        [[strength[rows + down, columns + right].mean() for right in span] for down in span]
    )
    # A ridge along straight edges has many maxima; the least shift among the nearly best counts.
    lengths = np.hypot(*np.meshgrid(np.array(span), np.array(span)))
    best = np.where(scores > 0.98 * scores.max(), lengths, np.inf)
    row, column = np.unravel_index(int(best.argmin()), best.shape)
    gain = float(scores[row, column] / max(scores[_MAX_SHIFT_PX, _MAX_SHIFT_PX], 1e-9))
    down, right = int(row) - _MAX_SHIFT_PX, int(column) - _MAX_SHIFT_PX
    return Shift(right, down, max(gain, 1.0), len(rows))


def _depth_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the near side of each jump of depth (h, w)."""
    far = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.inf)
    edges = np.zeros(far.shape, bool)
    is_measured = np.isfinite(far)
    for axis in (0, 1):
        for step in (-1, 1):
            beside = np.roll(far, step, axis=axis)
            with np.errstate(invalid="ignore"):
                edges |= is_measured & np.isfinite(beside) & (beside - far > _JUMP_M)
    edges[[0, -1]] = edges[:, [0, -1]] = False
    return edges


def _colour_edges(rgb: UInt8Array) -> NDArray[np.float32]:
    smooth = cv2.GaussianBlur(rgb, (0, 0), _BLUR_PX).astype(np.float32)
    across, down = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    strength = np.sqrt(np.asarray(across) ** 2 + np.asarray(down) ** 2).max(axis=2)
    # A strong print must not outweigh a faint outline.
    return np.asarray(np.sqrt(strength), dtype=np.float32)


def check_board(frame: Frame, inner: tuple[int, int], square_m: float) -> BoardCheck:
    """Compare a printed chessboard's distance and size with what depth says.

    Parameters
    ----------
    frame
        With colour, undistorted.
    inner
        Inner corners along the longer and the shorter side.
    square_m
        Side of a square as printed.

    Raises
    ------
    ValueError
        When the board is not found, has fewer than 3 x 3 inner corners, or too little depth.
    """
    if frame.rgb is None:
        raise ValueError("the frame has no colour image to find the board in")
    if min(inner) < 3:
        raise ValueError(f"a chessboard has at least 3 x 3 inner corners, got {inner}")
    grey = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
    has_corners, corners = cv2.findChessboardCornersSB(grey, inner, flags=cv2.CALIB_CB_ACCURACY)
    if not has_corners:
        raise ValueError(f"no chessboard of {inner[0]} x {inner[1]} inner corners in the picture")
    pixels = np.asarray(corners, np.float64).reshape(-1, 2)
    lens = frame.intrinsics
    matrix = np.array(
        [[lens.fx, 0, lens.cx - frame.x0], [0, lens.fy, lens.cy - frame.y0], [0, 0, 1.0]]
    )
    board = np.zeros((len(pixels), 3))
    board[:, :2] = np.mgrid[: inner[0], : inner[1]].T.reshape(-1, 2) * square_m
    _, turn, place = cv2.solvePnP(board, pixels, matrix, np.zeros(5))
    again = np.asarray(cv2.projectPoints(board, turn, place, matrix, np.zeros(5))[0])
    off = np.linalg.norm(again.reshape(-1, 2) - pixels, axis=1)
    expected = (board @ np.asarray(cv2.Rodrigues(turn)[0]).T + np.asarray(place).ravel())[:, 2]
    measured = _depth_at(frame.depth_m, pixels)
    has_depth = np.isfinite(measured)
    if has_depth.mean() < _MIN_MEASURED:
        raise ValueError(
            f"{int(has_depth.sum())} of {len(has_depth)} corners of the board have depth"
        )
    scale = float(
        measured[has_depth] @ expected[has_depth] / (expected[has_depth] @ expected[has_depth])
    )
    left = measured[has_depth] - scale * expected[has_depth]
    return BoardCheck(
        float(np.sqrt(np.mean(off**2))),
        scale,
        float(np.median(measured[has_depth] - expected[has_depth])),
        float(np.sqrt(np.mean(left**2))),
        _square_in_depth(pixels, measured, matrix, inner),
        float(np.median(measured[has_depth])),
        int(has_depth.sum()),
    )


def _depth_at(depth_m: NDArray[np.float32], pixels: Float64Array) -> Float64Array:
    """Return the median depth (n,) around pixels (n, 2); NaN where most of it is missing."""
    values = np.full(len(pixels), np.nan)
    for k, (u, v) in enumerate(np.rint(pixels).astype(int)):
        top, left = max(v - _WINDOW_PX, 0), max(u - _WINDOW_PX, 0)
        around = depth_m[top : v + _WINDOW_PX + 1, left : u + _WINDOW_PX + 1]
        around = around[np.isfinite(around) & (around > 0)]
        if len(around) > 2 * _WINDOW_PX**2:
            values[k] = float(np.median(around))
    return values


def _square_in_depth(
    pixels: Float64Array, depth: Float64Array, matrix: Float64Array, inner: tuple[int, int]
) -> float:
    """Return the median distance of neighbouring corners lifted by their depth, m.

    Rows are fitted by lines in depth first: its noise would make every distance longer.
    """
    across, down = inner
    z = depth.reshape(down, across)
    rows, columns = np.mgrid[:down, :across]
    has_depth = np.isfinite(z)
    terms = np.column_stack([np.ones(has_depth.sum()), columns[has_depth], rows[has_depth]])
    weights, *_ = np.linalg.lstsq(terms, 1 / z[has_depth], rcond=None)
    # Along a plane, the inverse of depth is linear in pixels, and nearly so in corners.
    smooth = 1 / (weights[0] + weights[1] * columns + weights[2] * rows)
    rays = (pixels - matrix[:2, 2]) / (matrix[0, 0], matrix[1, 1])
    points = np.dstack([rays.reshape(down, across, 2) * smooth[..., None], smooth])
    steps = [np.linalg.norm(np.diff(points, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.median(np.concatenate(steps)))
