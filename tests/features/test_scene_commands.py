"""``rtask segment`` and ``rtask recognise``: pictures and labels, and one line for bad input."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from features.codec import encode_cloud, encode_frame
from features.codec.pcd import write_pcd
from features.geometry import Frame, Intrinsics
from features.pictures import draw_box, draw_matches, draw_model
from rtask.cli import main
from tests.features.imaging.table_seen import in_base, points_of_table

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


def table() -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Return depth (mm) and colours of a table seen from above with three blocks on it."""
    depth = np.full((480, 640), 800, np.uint16)
    colour = np.full((480, 640, 3), 120, np.uint8)
    rng = np.random.default_rng(0)
    for row, column, height in ((120, 150, 60), (260, 320, 80), (150, 480, 50)):
        depth[row : row + 80, column : column + 70] = 800 - height
        block = colour[row : row + 80, column : column + 70]
        for _ in range(60):
            centre, radius = rng.uniform(0, 75, 2), rng.uniform(2, 9)
            place = np.rint(centre).astype(int).tolist()
            ink = rng.integers(0, 255, 3).tolist()
            painted = cv2.circle(block.copy(), place, int(radius), ink, -1, cv2.LINE_AA)
            block[:] = painted
    return depth, colour


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    depth, colour = table()
    files = tmp_path / "depth.png", tmp_path / "colour.png"
    for file, image in zip(files, (depth, colour), strict=True):
        cv2.imwrite(str(file), image)
    return files


def failed(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Run a command that must fail with one line, and return the line."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    assert stopped.value.code in (2, 3)
    said = capsys.readouterr().err.strip()
    assert "Traceback" not in said
    return said


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path, code: int = 0) -> str:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    assert stopped.value.code == code
    return capsys.readouterr().out


def test_a_pair_of_images_gives_labels_and_a_picture(
    pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    labels, plot = tmp_path / "labels.png", tmp_path / "plot.png"
    said = run(
        capsys, "segment", pair[0], "--colour", pair[1], "--labels", labels, "--save-plot", plot
    )
    assert said.startswith("ok: 3 objects")
    written = cv2.imread(str(labels), cv2.IMREAD_UNCHANGED)
    assert written.dtype == np.uint16
    assert set(np.unique(written)) == {0, 1, 2, 3}
    assert len({int(written[r, c]) for r, c in ((160, 185), (300, 355), (190, 515))}) == 3
    shown = cv2.imread(str(plot))
    assert shown.shape[0] == 480
    assert shown.shape[1] > 640  # a legend stands beside it
    assert (shown[:, :640] != table()[1])[written > 0].mean() > 0.5


def test_clouds_in_files_are_cut_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    depth, _ = table()
    points = Frame((depth / 1000).astype(np.float32), CAMERA).points()[::2, ::2].reshape(-1, 3)
    file = tmp_path / "cloud.ply"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "property float x\nproperty float y\nproperty float z\nend_header\n"
    file.write_bytes(head.encode() + points.astype("<f4").tobytes())
    plot, labels = tmp_path / "plot.jpg", tmp_path / "labels.npy"
    said = run(capsys, "segment", file, "--json", "--save-plot", plot, "--labels", labels)
    found = json.loads(said)
    assert found["status"] == "ok"
    assert len(found["objects"]) == 3
    assert np.load(labels).shape == (len(points),)
    assert plot.stat().st_size > 1000


def test_a_table_without_objects_and_nothing_at_all_are_answers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, depth, status in (
        ("bare", np.full((480, 640), 800, np.uint16), "table_only"),
        ("nothing", np.zeros((480, 640), np.uint16), "empty"),
    ):
        file = tmp_path / f"{name}.png"
        cv2.imwrite(str(file), depth)
        assert run(capsys, "segment", file, code=1).startswith(status)


def test_bad_files_are_refused_in_one_line(
    pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    depth_file, colour_file = pair
    assert "16-bit depth image" in failed(capsys, "segment", colour_file)
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.zeros((48, 64), np.uint8))
    assert "8 bits" in failed(capsys, "segment", grey)
    cut = tmp_path / "cut.png"
    cut.write_bytes(depth_file.read_bytes()[:-400])
    assert "cut off" in failed(capsys, "segment", cut)
    huge = tmp_path / "huge.png"
    data = bytearray(depth_file.read_bytes())
    data[16:24] = struct.pack(">II", 2**30, 2**30)
    huge.write_bytes(data)
    assert "px" in failed(capsys, "segment", huge)
    bomb = tmp_path / "bomb.pcd"
    bomb.write_bytes(
        b"# .PCD v.7\nVERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        b"WIDTH 400000000\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 400000000\nDATA binary\n"
    )
    assert "points" in failed(capsys, "segment", bomb)
    future = tmp_path / "future.rtkc"
    crop = bytearray(encode_cloud(np.zeros((10, 3), np.float32) + 0.5))
    crop[4] = 9
    future.write_bytes(crop)
    assert "version" in failed(capsys, "segment", future)
    plain = tmp_path / "plain.rtkc"
    plain.write_bytes(encode_cloud(np.zeros((10, 3), np.float32) + 0.5))
    assert "without an image" in failed(capsys, "recognise", plain, "--data", tmp_path)
    text = tmp_path / "notes.txt"
    text.write_text("no cloud")
    assert "no picture (JPEG, PNG, WebP, BMP, TIFF), cloud (PCD, PLY)" in failed(
        capsys, "segment", text
    )
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((48, 96, 3), np.uint8))  # not the sides of the depth image
    assert "96x48" in failed(capsys, "segment", depth_file, "--colour", small)


def test_nothing_is_written_where_anything_is_refused(
    pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    depth_file, picture = pair[0], tmp_path / "picture.png"
    nowhere = tmp_path / "nowhere" / "labels.png"
    before = depth_file.read_bytes()
    for labels, said in ((nowhere, "no folder"), (tmp_path / "l.txt", ".npy"),
                         (depth_file, "is an input"), (picture, "written twice")):  # fmt: skip
        assert said in failed(
            capsys, "segment", depth_file, "--labels", labels, "--save-plot", picture
        )
    assert depth_file.read_bytes() == before
    assert not picture.exists()
    assert not nowhere.parent.exists()


def test_depths_in_a_wrong_unit_name_the_file_and_the_option(
    pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    said = failed(capsys, "segment", pair[0], "--depth-unit", "1")
    assert "depth.png" in said
    assert "--depth-unit" in said


def test_an_object_cut_by_the_image_border_is_said_to_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    depth = np.full((480, 640), 700, np.uint16)
    depth[200:260, 560:] = 640
    depth[200:260, 200:260] = 650  # of the same size and wholly visible
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    lines = run(capsys, "segment", tmp_path / "depth.png").splitlines()
    assert [line.endswith("touches the border") for line in lines] == [False, True, False]


def test_a_camera_that_cannot_be_is_refused(
    pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "fx" in failed(capsys, "segment", pair[0], "--focal", "-525")
    assert "cannot belong" in failed(capsys, "segment", pair[0], "--focal", "525000")
    assert "cannot belong" in failed(capsys, "segment", pair[0], "--centre", "-900", "240")
    assert "depth-unit" in failed(capsys, "segment", pair[0], "--depth-unit", "0")


@pytest.mark.slow
def test_recognition_names_what_it_knows_and_draws_it(
    pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import rtask
    from features.segmentation import segment_scene
    from rtask.engine import Engine

    depth, colour = table()
    frame = Frame((depth / 1000).astype(np.float32), CAMERA, colour[..., ::-1].copy())
    scene = segment_scene(frame.points(), frame.rgb)
    number = scene.labels[300, 355]
    crop = frame.crop(scene.labels == number)
    store = tmp_path / "store"
    with rtask.open(store) as kb, Engine(kb) as engine:
        engine.call(
            "insert_object",
            {"objects": [{"data": encode_frame(crop), "class_description": "box"}]},
        )
    plot = tmp_path / "plot.png"
    said = run(
        capsys, "recognise", pair[0], "--colour", pair[1], "-d", store, "--json",
        "--save-plot", plot,
    )  # fmt: skip
    rows = {row["label"]: row for row in json.loads(said)}
    assert len(rows) == 3
    assert rows[number]["accepted"]
    assert rows[number]["matches"][0]["inliers"] >= 10
    pose = rows[number]["pose"]
    assert pose["accepted"]
    assert pose["source"] == "model"
    # Seen from where it was stored, the object is where its points are.
    middle = np.nanmean(crop.points()[crop.object_mask()], axis=0)
    assert np.linalg.norm(np.array(pose["camera_from_object"])[:3, 3] - middle) < 0.1
    assert all(row["pose"] is None for label, row in rows.items() if label != number)
    assert not any(row["accepted"] for label, row in rows.items() if label != number)
    assert cv2.imread(str(plot)).shape[0] > 480
    assert "needs colours" in failed(capsys, "recognise", pair[0], "-d", store)


def test_pictures_refuse_what_does_not_fit_and_survive_what_lies_outside() -> None:
    image = np.zeros((40, 60, 3), np.uint8)
    nothing = np.zeros((0, 2))
    assert draw_matches(image, image, (nothing, nothing), np.zeros(0, bool)).shape[2] == 3
    behind = np.eye(4)
    behind[2, 3] = -1.0
    drawn = draw_box(image, Intrinsics(60, 40, 50, 50, 30, 20), behind, np.full(3, 0.1))
    assert not drawn.any()
    one_behind = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, -1.0]])
    lens = Intrinsics(60, 40, 50, 50, 30, 20)
    assert not draw_model(image, lens, behind, one_behind).any()
    ahead = np.eye(4)
    ahead[2, 3] = 1.0
    drawn = draw_model(image, lens, ahead, one_behind)
    assert drawn[20, 30].any()  # the point faces the camera, in the middle of the image
    assert not drawn[:10].any()
    assert not draw_model(image, lens, ahead, np.zeros((0, 6))).any()


def test_a_cloud_in_the_robots_frame_is_cut_like_that_of_its_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], compiled_kernels: None
) -> None:
    counts = []
    for name, points in (("camera", points_of_table()), ("base", in_base(points_of_table()))):
        table = {axis: points[..., k].ravel().astype("<f4") for k, axis in enumerate("xyz")}
        file = tmp_path / f"{name}.pcd"
        file.write_bytes(write_pcd(table, points.shape[:2]))
        with pytest.raises(SystemExit) as stopped:
            main(["segment", str(file), "--json"])
        out, err = capsys.readouterr()
        assert stopped.value.code == 0
        assert ("in the frame of that camera" in err) is (name == "base")
        counts.append([row["centroid_m"] for row in json.loads(out)["objects"]])
    assert len(counts[0]) == 1
    assert np.allclose(counts[0], counts[1], atol=0.003)
