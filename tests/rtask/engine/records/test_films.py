"""Films of attempts: animated pictures that a data set has row by row."""

from __future__ import annotations

import base64
import json

import cv2
import numpy as np
import pytest

from rtask.errors import DataError
from rtask.interop.episodes.episode import episodes_of
from rtask.interop.episodes.films import decode_film, encode_film, films_of
from rtask.interop.episodes.lerobot import write_lerobot

pq = pytest.importorskip("pyarrow.parquet")
pytestmark = pytest.mark.slow

_TIMES = [0.0, 0.1, 0.2, 0.3]


def _frames(count: int, size: tuple[int, int] = (24, 32)) -> list[np.ndarray]:
    """Return frames whose red tells which they are."""
    frames = [np.full((*size, 3), 40, np.uint8) for _ in range(count)]
    for number, frame in enumerate(frames):
        frame[..., 0] = 10 * number
        frame[3, 4] = (200, 0, 7)
    return frames


def _picture(phase: str, data: bytes) -> dict[str, str]:
    return {"phase": phase, "data": base64.b64encode(data).decode()}


def _attempt(bench, robot, images) -> None:
    seen = bench.sight(bench.CAN)
    answer = robot.recognise(seen)
    motion = {
        "joints": ["elbow", "hand"], "times": _TIMES,
        "positions": [0.0] * 8, "commands": [0.0] * 8,
    }  # fmt: skip
    outcome = bench.held(motion=motion, images=images)
    robot.insert(seen, grasp=answer["grasps"][0], outcome=outcome, task_id=answer["task_id"])


def test_a_film_comes_back_frame_by_frame_and_repeats_last_longer() -> None:
    a, b, c = _frames(3)
    film = decode_film(encode_film([a, b, b, c], rate_hz=10))
    assert film is not None
    assert film.frames.shape == (3, 24, 32, 3)
    assert (film.frames == np.stack([a, b, c])).all()
    assert film.starts.tolist() == pytest.approx([0.0, 0.1, 0.3])
    assert film.at(np.array([0.0, 0.09, 0.1, 0.25, 0.3, 9.0])).tolist() == [0, 0, 1, 1, 2, 2]


def test_a_picture_that_does_not_move_is_no_film() -> None:
    still = cv2.imencode(".png", _frames(1)[0])[1].tobytes()
    assert decode_film(still) is None
    assert decode_film(cv2.imencode(".jpg", _frames(1)[0])[1].tobytes()) is None
    moving = encode_film(_frames(3), 10)
    for cut in (60, len(moving) - 60):
        with pytest.raises(DataError, match="cannot be decoded"):
            decode_film(moving[:cut])


def test_a_data_set_has_what_each_camera_saw_in_each_row(bench, robots, kb, tmp_path) -> None:
    front, above = encode_film(_frames(4), 10), encode_film(_frames(2, (20, 20)), 5)
    lift = cv2.imencode(".png", _frames(1)[0])[1].tobytes()
    images = [_picture("lift", lift), _picture("overhead", above), _picture("front", front)]
    _attempt(bench, robots("nao-1"), images)
    _attempt(bench, robots("nao-2"), images[1:])
    found = episodes_of(kb)
    assert sorted(films_of(kb, found[0])) == ["front", "overhead"]
    write_lerobot(kb, found, tmp_path / "set", rate_hz=20)
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert info["features"]["observation.images.front"] == {
        "dtype": "image", "shape": [24, 32, 3], "names": ["height", "width", "channels"],
    }  # fmt: skip
    rows = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    assert set(rows) == set(info["features"])
    shown = {
        camera: [
            cv2.imdecode(np.frombuffer(cell["bytes"], np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
            for cell in rows[f"observation.images.{camera}"]
        ]
        for camera in ("front", "overhead")
    }
    reds = {camera: [int(image[0, 0, 0]) for image in seen] for camera, seen in shown.items()}
    assert reds["front"] == [0, 0, 10, 10, 20, 20, 30] * 2
    assert reds["overhead"] == [0, 0, 0, 0, 10, 10, 10] * 2
    assert shown["front"][0][3, 4].tolist() == [200, 0, 7]  # neither colours nor sides are mixed up
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())["observation.images.front"]
    assert stats["count"] == [14]
    every = np.stack(shown["front"]) / 255
    for name in ("min", "max", "mean", "std"):
        expected = getattr(every, name)(axis=(0, 1, 2)).reshape(3, 1, 1)
        assert np.array(stats[name]) == pytest.approx(expected, abs=1e-9)
    kept = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert np.array(kept["stats/observation.images.front/mean"][0]).shape == (3, 1, 1)


def test_a_camera_that_missed_an_attempt_or_changed_its_size_is_left_out(
    bench, robots, kb, tmp_path
) -> None:
    small, large = encode_film(_frames(2), 10), encode_film(_frames(2, (48, 64)), 10)
    _attempt(bench, robots("nao-1"), [_picture(c, small) for c in ("front", "side", "wrist")])
    _attempt(bench, robots("nao-2"), [_picture("front", small), _picture("side", large)])
    write_lerobot(kb, episodes_of(kb), tmp_path / "set")
    features = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    images = [name for name in features if name.startswith("observation.images.")]
    assert images == ["observation.images.front"]
