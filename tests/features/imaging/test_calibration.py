"""Calibration checked against depth."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from features.geometry import Frame, Intrinsics
from features.imaging.calibration import check_board, registration_shift
from rtask.cli import main

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
INNER, SQUARE = (8, 5), 0.03


def blocks(shift=(0, 0)):
    """Return a frame of blocks before a wall, the colours shifted (right, down) px."""
    depth = np.full((480, 640), 1.0, np.float32)
    colours = np.full((480, 640, 3), 110, np.uint8)
    rng = np.random.default_rng(0)
    for row, column in ((80, 100), (220, 300), (120, 460), (330, 130)):
        place = (slice(row, row + 70), slice(column, column + 90))
        depth[place] = 0.8
        colours[place] = rng.integers(0, 255, 3)
    moved = np.roll(colours, shift[::-1], axis=(0, 1))
    noise = rng.normal(0, 3, colours.shape)
    return Frame(depth, CAMERA, np.clip(moved + noise, 0, 255).astype(np.uint8))


def board(depth_scale=1.0, focal_scale=1.0):
    """Return a frame of a slanted chessboard; depth and picture may come from other cameras."""
    turn = cv2.Rodrigues(np.array([0.25, -0.3, 0.05]))[0]
    centre = np.array([0.0, 0.0, 0.7])
    v, u = np.mgrid[:480, :640]
    rays = np.dstack([(u - CAMERA.cx) / (CAMERA.fx * focal_scale),
                      (v - CAMERA.cy) / (CAMERA.fy * focal_scale), np.ones(u.shape)])  # fmt: skip
    depth = (turn[:, 2] @ centre) / (rays @ turn[:, 2])
    flat = (rays * depth[..., None] - centre) @ turn
    cells = np.floor(flat[..., :2] / SQUARE + np.array(INNER) / 2 + 0.5)
    inside = (cells >= 0).all(-1) & (cells[..., 0] <= INNER[0]) & (cells[..., 1] <= INNER[1])
    dark = inside & (cells.sum(-1) % 2 == 0)
    image = cv2.GaussianBlur(np.where(dark, 30, 220).astype(np.uint8), (0, 0), 0.7)
    measured = (depth * depth_scale).astype(np.float32)
    measured[:60] = 1.5  # something behind, for the edges
    return Frame(measured, CAMERA, np.repeat(image[..., None], 3, axis=2))


@pytest.mark.parametrize("shift", [(0, 0), (5, 0), (-4, 6)])
def test_the_shift_between_depth_and_colour_is_found(shift):
    found = registration_shift(blocks(shift))
    # The near side of a jump is half a pixel inside the outline.
    assert abs(found.right_px - shift[0]) <= 1
    assert abs(found.down_px - shift[1]) <= 1
    assert (found.gain > 1.2) == (shift != (0, 0))


def test_a_scene_without_edges_of_depth_says_nothing():
    with pytest.raises(ValueError, match="edges of depth"):
        registration_shift(Frame(np.ones((480, 640), np.float32), CAMERA, blocks().rgb))


def test_a_board_tells_the_scale_of_depth_and_the_focal_length():
    right = check_board(board(), INNER, SQUARE)
    assert right.corners == 40
    assert right.reprojection_px < 0.2
    assert right.depth_scale == pytest.approx(1.0, abs=0.004)
    assert right.square_m == pytest.approx(SQUARE, rel=0.01)
    long = check_board(board(depth_scale=1.05), INNER, SQUARE)
    assert long.depth_scale == pytest.approx(1.05, abs=0.005)
    assert long.square_m == pytest.approx(1.05 * SQUARE, rel=0.012)
    # A lens of 5 % more focal length shows the board nearer than it is.
    wrong = check_board(board(focal_scale=1.05), INNER, SQUARE)
    assert wrong.depth_scale == pytest.approx(1.05, abs=0.02)
    with pytest.raises(ValueError, match="no chessboard of 7 x 6"):
        check_board(board(), (7, 6), SQUARE)


def test_the_command_says_what_is_off(tmp_path, capsys):
    def run(frame, *more):
        cv2.imwrite(str(tmp_path / "depth.png"), np.rint(frame.depth_m * 1000).astype(np.uint16))
        cv2.imwrite(str(tmp_path / "colour.png"), frame.rgb)
        with pytest.raises(SystemExit) as stopped:
            main(["camera", str(tmp_path / "depth.png"), "--colour", str(tmp_path / "colour.png"),
                  *more])  # fmt: skip
        said = capsys.readouterr()
        return stopped.value.code, said.out + said.err

    code, said = run(blocks())
    assert code == 0
    assert "the calibration fits" in said
    code, said = run(blocks((7, 0)))
    assert code == 1
    assert "px right" in said
    options = ("--board", "5", "8", "--square", "0.03", "--json", "--depth-unit", "0.001")
    code, said = run(board(depth_scale=1.1), *options)
    assert code == 2
    assert "nothing says which camera took the depth image" in said
    code, said = run(board(depth_scale=1.1), *options, "--focal", "525")
    told = json.loads(said)
    assert told["board"]["depth_scale"] == pytest.approx(1.1, abs=0.01)
    assert "depth is 1.1" in " ".join(told["faults"])
    assert code == 1
    assert "belong together" in run(blocks(), "--square", "0.03")[1]


@pytest.mark.parametrize("inner", [(0, 0), (4, 2)])
def test_a_board_too_small_to_be_found_is_refused(inner):
    camera = Intrinsics(40, 40, 40.0, 40.0, 20.0, 20.0)
    frame = Frame(np.ones((40, 40), np.float32), camera, np.zeros((40, 40, 3), np.uint8))
    with pytest.raises(ValueError, match="at least 3 x 3"):
        check_board(frame, inner, 0.02)
