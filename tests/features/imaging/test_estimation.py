"""A camera estimated from rendered chessboards, of which all is known."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from features.geometry import Intrinsics
from features.imaging.camera import Lens
from features.imaging.estimation import Board, estimate_lens, estimate_place
from rtask.cli import main

BOARD = Board(8, 5, 0.03)
COLOUR = Lens(Intrinsics(480, 360, 420.0, 423.0, 243.0, 177.0), (-0.28, 0.09, 0.0008, -0.0005, 0.0))
DEPTH = Lens(Intrinsics(240, 180, 215.0, 215.0, 118.0, 91.0))
SCALE = 1.01
WALL_M = 1.6


def pose(turn: tuple[float, ...], place: tuple[float, ...]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
    out[:3, 3] = place
    return out


PLACE = pose((0.01, -0.02, 0.015), (0.025, 0.002, 0.004))


def rays(lens: Lens, parts: int) -> np.ndarray:
    """Return the directions of parts x parts points in every pixel."""
    camera = lens.intrinsics
    off = (np.arange(parts) + 0.5) / parts - 0.5
    across = (np.arange(camera.width)[:, None] + off).ravel()
    down = (np.arange(camera.height)[:, None] + off).ravel()
    points = np.stack(np.meshgrid(across, down), -1).reshape(-1, 1, 2)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    bent = np.array(lens.distortion or (0.0,) * 5)
    straight = cv2.undistortPoints(points, matrix, bent, criteria=(3, 40, 1e-8))
    flat = straight.reshape(len(down), len(across), 2)
    return np.dstack([flat, np.ones(flat.shape[:2])])


def render(directions: np.ndarray, board: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the picture and the depth of a board before a wall."""
    normal, place = board[:3, 2], board[:3, 3]
    z = (normal @ place) / (directions @ normal)
    on_board = (directions * z[..., None] - place) @ board[:3, :3]
    cells = np.floor(on_board[..., :2] / BOARD.square_m + 1).astype(int)
    size = (BOARD.across, BOARD.down)
    is_square = (cells >= 0).all(-1) & (cells <= size).all(-1)
    is_paper = (cells >= -1).all(-1) & (cells <= np.add(size, 1)).all(-1) & (z > 0)
    shades = np.where(is_square & (cells.sum(-1) % 2 == 0), 30.0, 220.0)
    shades = np.where(is_paper, shades, 110.0)
    height, width = shades.shape
    picture = shades.reshape(height // parts, parts, width // parts, parts).mean((1, 3))
    return picture, np.where(is_paper, z, WALL_M)


@dataclass
class Shots:
    pictures: list[np.ndarray]
    depths_m: list[np.ndarray]


@pytest.fixture(scope="module")
def shots() -> Shots:
    rng = np.random.default_rng(3)
    made = Shots([], [])
    seen_by, measured_by = rays(COLOUR, 2), rays(DEPTH, 1)
    middle = (BOARD.corners()[-1] / 2).tolist()
    for _ in range(10):
        turn = (*rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.2, 0.2))
        centre = (rng.uniform(-0.1, 0.1), rng.uniform(-0.07, 0.07), rng.uniform(0.45, 0.8))
        board = pose(turn, centre)
        board[:3, 3] -= board[:3, :3] @ middle
        picture, _ = render(seen_by, board, 2)
        noisy = picture + rng.normal(0, 3, picture.shape)
        made.pictures.append(np.clip(noisy, 0, 255).astype(np.uint8))
        _, depth = render(measured_by, np.linalg.inv(PLACE) @ board, 1)
        # Noise of a structured-light camera, and steps of 1 mm.
        measured = SCALE * depth + rng.normal(0, 0.0015, depth.shape) * depth**2
        made.depths_m.append((np.rint(1000 * measured) / 1000).astype(np.float32))
    return made


def test_the_lens_is_found_within_its_own_error(shots: Shots) -> None:
    found = estimate_lens([*shots.pictures, np.full_like(shots.pictures[0], 90)], BOARD)
    camera, truth = found.lens.intrinsics, COLOUR.intrinsics
    assert sorted(found.poses) == list(range(10))  # the last picture shows no board
    assert found.reprojection_px < 0.2
    assert 0.4 < found.reach < 0.8  # the boards stay off the corners of the picture
    # Three standard errors, each below .7 percent of the focal length.
    assert found.focal_error_px < 0.007 * truth.fx
    assert abs(camera.fx - truth.fx) < 3 * found.focal_error_px
    assert abs(camera.fy - truth.fy) < 3 * found.focal_error_px
    assert abs(camera.cx - truth.cx) < 3 * found.centre_error_px
    assert abs(camera.cy - truth.cy) < 3 * found.centre_error_px
    # The boards reach a third of the focal length off the middle, where .03 are a third of a pixel.
    assert found.lens.distortion[0] == pytest.approx(COLOUR.distortion[0], abs=0.03)


def test_the_depth_camera_is_found_beside_colour(shots: Shots) -> None:
    found = estimate_lens(shots.pictures, BOARD)
    place = estimate_place(found.poses, BOARD, shots.depths_m, DEPTH)
    off = np.linalg.inv(PLACE) @ place.colour_from_depth
    stated_m = np.hypot(place.place_error_m, found.board_error_m)
    # What the principal point leaves open at this distance is most of it.
    assert np.abs(place.colour_from_depth[:3, 3] - PLACE[:3, 3]).max() < min(2 * stated_m, 0.004)
    assert np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1))) < 0.6
    assert place.depth_scale == pytest.approx(SCALE, abs=0.008)
    assert place.place_error_m < 0.004


def test_postures_that_leave_the_camera_open_are_refused(shots: Shots) -> None:
    with pytest.raises(ValueError, match="at least 6"):
        estimate_lens(shots.pictures[:5], BOARD)
    with pytest.raises(ValueError, match="at least 6"):
        estimate_lens(shots.pictures[:1], Board(7, 6, 0.03))
    with pytest.raises(ValueError, match="differ in size"):
        estimate_lens([*shots.pictures, shots.pictures[0][:100]], BOARD)
    # Boards that face the camera fit any focal length at another distance.
    directions = rays(COLOUR, 2)
    flat = [
        render(directions, pose((0, 0, 0), (-0.105 + 0.01 * k, -0.06, 0.5)), 2)[0].astype(np.uint8)
        for k in range(6)
    ]
    with pytest.raises(ValueError, match="leaves the focal length open"):
        estimate_lens(flat, BOARD)
    found = estimate_lens(shots.pictures, BOARD)
    nothing = [np.zeros_like(depth) for depth in shots.depths_m]
    with pytest.raises(ValueError, match="plane of 0 boards"):
        estimate_place(found.poses, BOARD, nothing, DEPTH)


def test_pictures_that_were_cropped_elsewhere_do_not_agree_on_a_camera(shots: Shots) -> None:
    # The residuals stay below .2 px: a board that is turned a little looks nearly as one that was
    # shifted.
    shifted = [np.roll(picture, 40, axis=1) for picture in shots.pictures[:3]]
    with pytest.raises(ValueError, match=r"do not agree on one camera: without picture \d+ its"):
        estimate_lens([*shifted, *shots.pictures[3:]], BOARD)


def test_the_command_writes_what_the_option_camera_reads(
    tmp_path: Path, shots: Shots, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "depth"
    folder.mkdir()
    files = []
    for k, (picture, depth) in enumerate(zip(shots.pictures, shots.depths_m, strict=True)):
        files.append(str(tmp_path / f"{k}.png"))
        cv2.imwrite(files[-1], picture)
        cv2.imwrite(str(folder / f"{k}.png"), np.rint(1000 * depth).astype(np.uint16))
    out = tmp_path / "camera.json"

    def run(*words: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as stopped:
            main(["camera", *words])
        said = capsys.readouterr()
        # Of ten depth images of one camera the unit is doubted once.
        assert said.err.count("nothing says the unit") == (stopped.value.code == 0)
        return int(stopped.value.code or 0), said.out or said.err

    board = ("--board", "8", "5", "--square", "0.03", "--estimate", str(out))
    code, said = run(*files, *board, "--depths", str(folder))
    assert code == 2
    assert "must describe the depth camera" in said
    depth_lens = ("--focal", "215", "--centre", "118", "91")
    code, said = run(*files, *board, "--depths", str(folder), *depth_lens, "--json")
    assert code == 0
    assert json.loads(said)["pictures"] == 10
    written = json.loads(out.read_text())
    assert written["colour"]["fx"] == pytest.approx(420, abs=5)
    assert np.allclose(written["colour_from_depth"], PLACE, atol=0.01)
    # The board is as far and as large in depth as in the picture, by the camera just written.
    check = ("--board", "8", "5", "--square", "0.03", "--camera", str(out))
    code, said = run(str(folder / "0.png"), "--colour", files[0], *check, "--json")
    told = json.loads(said)
    assert told["board"]["depth_scale"] == pytest.approx(SCALE, abs=0.02)
    assert told["board"]["reprojection_px"] < 1
    assert run(*files, *board[:2], "5", *board[3:5])[0] == 2
    assert "belongs to --estimate" in run(files[0], "--depths", str(folder))[1]
