"""``rtask teach`` and ``rtask recognise`` with nothing but pictures."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from features.codec.pcd import write_pcd
from features.geometry import Intrinsics, points_from_depth
from features.imaging.masks import encode_rle
from rtask.cli import main
from tests.commands import run_command
from tests.servers import running_server

pytestmark = pytest.mark.slow


def print_of(seed):
    """Return a printed label (240, 180, 3) that no other seed shares."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 180, 3), rng.integers(60, 200, 3), np.uint8)
    for _ in range(150):
        ink = tuple(int(v) for v in rng.integers(0, 256, 3))
        x, y, w, h = (int(v) for v in (*rng.integers(0, 230, 2), *rng.integers(5, 32, 2)))
        if rng.random() < 0.6:
            cv2.rectangle(image, (x, y), (x + w, y + h), ink, -1)
        else:
            cv2.circle(image, (x, y), w // 2, ink, -1)
    return image


def photograph(seed, angle=0.0, shelf=0):
    """Return a picture of the label in the middle of a plain shelf, and its mask."""
    rng = np.random.default_rng(100 + shelf)
    picture = cv2.GaussianBlur(rng.integers(90, 130, (420, 400, 3)).astype(np.uint8), (0, 0), 4)
    turn = cv2.getRotationMatrix2D((90, 120), angle, 1.1)
    turn[:, 2] += (110, 90)
    drawn = cv2.warpAffine(print_of(seed), turn, (400, 420))
    mask = cv2.warpAffine(np.full((240, 180), 255, np.uint8), turn, (400, 420)) > 127
    picture[mask] = drawn[mask]
    return picture, mask


def save(path, picture):
    cv2.imwrite(str(path), picture[..., ::-1])
    return path


def run(capsys, *arguments, code=0):
    with pytest.raises(SystemExit) as stopped:
        main([str(one) for one in arguments])
    said = capsys.readouterr()
    assert stopped.value.code == code, said
    return said.out + said.err


@pytest.fixture(scope="module")
def taught_once(tmp_path_factory):
    """Return a folder with a store of two products, one of them shown twice, and what they are."""
    place = tmp_path_factory.mktemp("taught")
    (place / "tea").mkdir()
    for k, angle in enumerate((0, 8)):
        save(place / "tea" / f"{k}.jpg", photograph(1, angle, k)[0])
    coffee, store = str(save(place / "coffee.jpg", photograph(2)[0])), str(place / "store")
    kind = ("--kind", "tea box")
    said = run_command("teach", "green tea", str(place / "tea"), *kind, "-d", store, check=True)
    assert "2 views of green tea (new)" in said.stdout + said.stderr
    run_command("teach", "coffee", coffee, "-d", store, check=True)
    return place


@pytest.fixture
def taught(taught_once, tmp_path):
    """Return a copy of the store, which a test may change."""
    shutil.copytree(taught_once, tmp_path, dirs_exist_ok=True)
    return tmp_path / "store"


def test_two_photographs_of_one_thing_are_recognised_together(taught, tmp_path, capsys):
    photo, other, strange = (
        save(tmp_path / f"{k}.jpg", photograph(seed, angle, 7)[0])
        for k, (seed, angle) in enumerate(((1, -6), (1, 12), (3, 0)))
    )

    def sure(*looks, code=0):
        given = [word for one in looks for word in ("--look", one)]
        rows = json.loads(
            run(capsys, "recognise", photo, *given, "-d", taught, "--json", code=code)
        )
        return rows[0]["matches"][0]["confidence"]

    assert sure(other) > 0.82
    assert sure(strange, code=1) < sure()


def test_what_was_taught_by_photographs_is_recognised_on_another(taught, tmp_path, capsys):
    photo = save(tmp_path / "seen.jpg", photograph(1, -6, 7)[0])
    said = run(capsys, "recognise", photo, "-d", taught)
    assert "1 object seen, 1 recognised" in said
    assert "green tea" in said
    other = save(tmp_path / "other.jpg", photograph(3, 0, 8)[0])
    assert "0 recognised" in run(capsys, "recognise", other, "-d", taught, code=1)
    plot = tmp_path / "plot.png"
    run(capsys, "recognise", photo, "-d", taught, "--save-plot", plot)
    assert cv2.imread(str(plot)).shape[0] > 300


def test_masks_of_other_tools_name_each_object(taught, tmp_path, capsys):
    (left, mask), (right, _) = photograph(1, 3, 5), photograph(2, 0, 5)
    both = save(tmp_path / "both.png", np.hstack([left, right]))
    nothing = np.zeros_like(mask)
    labels = np.hstack([mask * 4, nothing]).astype(np.uint8)
    labels = np.maximum(labels, np.hstack([nothing, photograph(2, 0, 5)[1] * 9]).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "labels.png"), labels)
    told = run(capsys, "recognise", both, "-d", taught, "--mask", tmp_path / "labels.png", "--json")
    rows = {row["label"]: row["matches"][0]["name"] for row in json.loads(told) if row["accepted"]}
    assert rows == {4: "green tea", 9: "coffee"}
    (tmp_path / "masks.json").write_text(json.dumps([encode_rle(labels == 9)]))
    told = run(capsys, "recognise", both, "-d", taught, "--mask", tmp_path / "masks.json", "--json")
    assert [row["matches"][0]["name"] for row in json.loads(told)] == ["coffee"]
    box = [str(n) for n in cv2.boundingRect((labels == 4).astype(np.uint8))]
    assert "green tea" in run(capsys, "recognise", both, "-d", taught, "--box", *box)


def test_more_photographs_are_added_to_the_object_of_that_name(taught, tmp_path, capsys):
    photo = save(tmp_path / "more.jpg", photograph(1, 15, 3)[0])
    (entry,) = json.loads(run(capsys, "teach", "green tea", photo, "-d", taught, "--json"))
    assert not entry["new"]
    shown = json.loads(run(capsys, "objects", "show", entry["object"], "-d", taught, "--json"))
    assert len(shown["views"]) == 3


def test_a_photograph_is_stored_once_and_again_after_it_was_forgotten(taught, tmp_path, capsys):
    again = tmp_path / "tea" / "0.jpg"
    said = run(capsys, "teach", "green tea", again, "-d", taught)
    assert f"{again}: stored already" in said
    assert "0 views of green tea (known)" in said
    (entry,) = json.loads(run(capsys, "teach", "green tea", again, "-d", taught, "--json"))
    assert entry["stored"] == 0
    run(capsys, "objects", "forget", "green tea", entry["view"], "-d", taught)
    assert "1 view of green tea (known)" in run(capsys, "teach", "green tea", again, "-d", taught)


def test_nothing_is_stored_where_one_of_the_photographs_cannot_be_read(taught, tmp_path, capsys):
    photo = save(tmp_path / "cocoa.jpg", photograph(3)[0])
    for name, data, why in (
        ("page.jpg", b"<html>", "no picture (JPEG, PNG, WebP, BMP, TIFF), cloud (PCD, PLY)"),
        ("empty.jpg", b"", "it is empty"),
        ("cut.png", b"\x89PNG\r\n", "PNG is cut off"),
    ):
        bad = tmp_path / name
        bad.write_bytes(data)
        said = run(capsys, "teach", "cocoa", photo, bad, "-d", taught, code=3)
        assert f"{bad}: " in said
        assert why in said
    assert "cocoa" not in run(capsys, "objects", "list", "-d", taught)


def test_a_name_is_neither_blank_nor_the_address_of_nothing(tmp_path, capsys):
    photo, store = save(tmp_path / "one.jpg", photograph(1)[0]), tmp_path / "store"
    assert "NAME is blank" in run(capsys, "teach", " ", photo, "-d", store, code=2)
    said = run(capsys, "teach", "http://example.org/mug", photo, "-d", store, code=1)
    assert "no object http://example.org/mug" in said


def test_a_picture_without_print_is_stored_with_a_warning(tmp_path, capsys):
    plain = save(tmp_path / "plain.png", np.full((60, 60, 3), 90, np.uint8))
    said = run(capsys, "teach", "wall", plain, "-d", tmp_path / "store")
    assert "0 keypoints; too few to be recognised" in said


def test_options_without_effect_are_refused(taught, tmp_path, capsys):
    photo = save(tmp_path / "seen.jpg", photograph(1, -6, 7)[0])
    for option, value in (("--focal", "nan"), ("--distortion", "0.1,0"), ("--at", "3")):
        said = run(capsys, "recognise", photo, option, value, "-d", taught, code=2)
        assert f"{option}: no use here" in said
    blank = save(tmp_path / "blank.png", np.zeros((420, 400, 3), np.uint8))
    said = run(capsys, "recognise", photo, "--mask", blank, "-d", taught, code=3)
    assert "marks no pixel" in said
    folder = tmp_path / "folder"
    folder.mkdir()
    assert "no metadata.yaml" in run(capsys, "recognise", folder, "-d", taught, code=2)


def test_what_cannot_be_taught_says_why(tmp_path, capsys):
    photo = save(tmp_path / "one.jpg", photograph(1)[0])
    empty = tmp_path / "empty"
    empty.mkdir()
    store = tmp_path / "store"
    assert "no photographs" in run(capsys, "teach", "x", empty, "-d", store, code=2)
    blank = tmp_path / "one.png"
    cv2.imwrite(str(blank), np.zeros((10, 10), np.uint8))
    depth = tmp_path / "depth.png"
    cv2.imwrite(str(depth), np.full((48, 64), 700, np.uint16))
    said = run(capsys, "teach", "x", depth, "--colour", photo, "-d", store, code=2)
    assert "depth.png: nothing says which camera took the depth image" in said
    masks = tmp_path / "masks"
    masks.mkdir()
    said = run(capsys, "teach", "x", photo, "--mask", masks, "-d", store, code=2)
    assert "no one.png or one.json" in said
    said = run(capsys, "teach", "x", photo, "--box", "900", "0", "10", "10", "-d", store, code=3)
    assert "outside the image" in said


def test_an_organised_cloud_with_colours_is_cut_and_gets_labels_in_its_shape(tmp_path, capsys):
    camera = Intrinsics(160, 120, 140.0, 140.0, 79.5, 59.5)
    depth = np.full((120, 160), 0.6, np.float32)
    depth[40:70, 60:100], depth[5:9] = 0.55, 0
    points = points_from_depth(depth, camera).reshape(-1, 3)
    table = {axis: points[:, k].astype("<f4") for k, axis in enumerate("xyz")}
    table["rgb"] = np.full(len(points), 0x808080, "<u4")
    cloud, labels = tmp_path / "scene.pcd", tmp_path / "labels.npy"
    cloud.write_bytes(write_pcd(table, (120, 160)))
    run(capsys, "segment", cloud, "--labels", labels)
    found = np.load(labels)
    assert found.shape == (120, 160)
    assert found[55, 80] == 1
    assert not found[5:9].any()
    picture = tmp_path / "labels.png"
    run(capsys, "segment", cloud, "--labels", picture)
    assert np.array_equal(cv2.imread(str(picture), cv2.IMREAD_UNCHANGED), found)
    cloud.write_bytes(write_pcd(table, (1, 120 * 160)))
    run(capsys, "segment", cloud, "--labels", labels)
    assert np.load(labels).shape == (120 * 160,)


def test_a_camera_file_and_colour_of_another_size_are_taken(tmp_path: Path, capsys):
    depth = np.full((120, 160), 600, np.uint16)
    depth[40:70, 60:100] = 550
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    colour = save(tmp_path / "colour.png", np.full((240, 320, 3), 90, np.uint8))
    told = {"width": 160, "height": 120, "k": [140, 0, 79.5, 0, 141, 59.5, 0, 0, 1], "d": [0] * 5}
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps(told))
    options = ("--colour", colour, "--camera", camera)
    assert "1 objects" in run(capsys, "segment", tmp_path / "depth.png", *options)
    camera.write_text(json.dumps({"depth": told, "colour": told}))
    said = run(capsys, "segment", tmp_path / "depth.png", *options, code=2)
    assert "not that of its camera" in said
    said = run(capsys, "segment", tmp_path / "depth.png", "--distortion", "0.1,x", code=2)
    assert "numbers with commas" in said


def test_a_server_is_taught_and_asked_the_same_way(tmp_path, capsys):
    tea = save(tmp_path / "tea.jpg", photograph(1)[0])
    coffee = save(tmp_path / "coffee.jpg", photograph(2)[0])
    with running_server(None) as server:
        for name, photo in (("green tea", tea), ("coffee", coffee)):
            said = run(capsys, "teach", name, photo, "--server", server.url)
            assert f"1 view of {name} (new)" in said
        seen = save(tmp_path / "seen.jpg", photograph(1, -6, 7)[0])
        said = run(capsys, "recognise", seen, "--server", server.url)
        assert "1 object seen, 1 recognised" in said
        assert "green tea" in said
        told = run(capsys, "teach", "green tea", seen, "--server", server.url, "--json")
        assert not json.loads(told)[0]["new"]
        other = photograph(1)[0].copy()
        other[150:250, 130:260] = photograph(4)[0][150:250, 130:260]
        changed = save(tmp_path / "changed.jpg", other)
        said = run(capsys, "recognise", changed, "--server", server.url, code=1)
        assert "looks like a known object, but differs" in said
        plot = tmp_path / "plot.png"
        options = ("--server", server.url, "--save-plot", plot)
        assert "--data alone" in run(capsys, "recognise", seen, *options, code=2)
