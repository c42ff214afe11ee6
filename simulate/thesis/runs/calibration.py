"""Calibration of a camera, Gatto 2016, 2.3: what is estimated from a chessboard in 12 postures."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.imaging.estimation import Board, estimate_lens
from simulate.thesis.materials.pictures import png
from simulate.thesis.result import Compared, Result, Setting

__all__ = ["calibration"]

_BOARD = Board(8, 6, 0.03)
_SIZE, _FOCAL, _CENTRE = (640, 480), 525.0, (319.5, 239.5)
"""Of a Kinect whose depth is registered to colour."""
_CELL_PX = 40
_NOISE = 3.0
"""Standard deviation of a pixel, of 255."""


def calibration(setting: Setting) -> Result:
    """Focal length and principal point from pictures whose camera is known."""
    postures = 12
    rng = np.random.default_rng([setting.seed, 0xB0A2D])
    pictures = [_picture(rng) for _ in range(postures)]
    estimate = estimate_lens(pictures, _BOARD)
    camera = estimate.lens.intrinsics
    focal, centre = estimate.focal_error_px, estimate.centre_error_px
    return Result(
        (
            _about("focal length across, of 525 px", camera.fx, focal),
            _about("focal length down, of 525 px", camera.fy, focal),
            _about("principal point across, of 319.5 px", camera.cx, centre),
            _about("principal point down, of 239.5 px", camera.cy, centre),
            Compared("corners about their places, root mean square", estimate.reprojection_px,
                     unit="px"),
        ),
        (
            "the thesis shows a picture before and after, and gives no figures",
            f"{len(estimate.poses)} of {postures} pictures used, drawn without distortion, with "
            f"noise of {_NOISE:g} of 255",
        ),
        {"a posture of the board": png(np.dstack([pictures[0]] * 3))},
    )  # fmt: skip


def _about(what: str, ours: float, error: float) -> Compared:
    return Compared(what, ours, unit="px", interval=(ours - 1.96 * error, ours + 1.96 * error))


def _picture(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a picture (480, 640) of the board, tilted by up to .5 rad to a side drawn."""
    turn = Rotation.from_euler("xyz", rng.uniform(-0.5, 0.5, 3)).as_matrix()
    middle = np.array([(_BOARD.across - 1) / 2, (_BOARD.down - 1) / 2, 0]) * _BOARD.square_m
    place = np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(0.45, 0.75)]) - turn @ middle
    matrix = np.array([[_FOCAL, 0, _CENTRE[0]], [0, _FOCAL, _CENTRE[1]], [0, 0, 1]])
    # From pixels of the drawn board, two cells of margin, to its plane and to the picture.
    board_from_drawn = np.array(
        [
            [1, 0, -3 * _CELL_PX + 0.5],
            [0, 1, -3 * _CELL_PX + 0.5],
            [0, 0, _CELL_PX / _BOARD.square_m],
        ]
    )
    board_from_drawn = board_from_drawn * (_BOARD.square_m / _CELL_PX)
    seen = matrix @ np.column_stack([turn[:, :2], place]) @ board_from_drawn
    drawn = cv2.warpPerspective(_drawn(), seen, _SIZE, flags=cv2.INTER_AREA, borderValue=120)
    noisy = drawn + rng.normal(0, _NOISE, drawn.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def _drawn() -> NDArray[np.uint8]:
    """Return the board from straight above, its first inner corner three cells from the edges."""
    rows, columns = np.indices((_BOARD.down + 5, _BOARD.across + 5))
    inside = (rows > 1) & (rows < _BOARD.down + 3) & (columns > 1) & (columns < _BOARD.across + 3)
    shades = np.where(inside & ((rows + columns) % 2 == 0), 30, 225).astype(np.uint8)
    return np.asarray(np.kron(shades, np.ones((_CELL_PX, _CELL_PX), np.uint8)), np.uint8)
