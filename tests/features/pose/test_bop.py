"""Metrics and folders of the BOP benchmark."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from features.geometry import Intrinsics
from tests.benchmarks.perception.bop.dataset import BopDataset, BopEstimate, write_results
from tests.benchmarks.perception.bop.metrics import average_recall, bop_errors, mspd, mssd, vsd
from tests.benchmarks.perception.bop.render import render_depth

CAMERA = Intrinsics(160, 120, 150.0, 150.0, 79.5, 59.5)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])
BOX = CORNERS * (0.05, 0.03, 0.02)
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
SYMMETRIES = np.stack([np.eye(4), HALF_TURN])


def pose(x=0.0, z=0.5, turn=0.0):
    made = np.eye(4)
    made[:3, :3] = cv2.Rodrigues(np.array([0.6, 0.2, turn]))[0]
    made[:3, 3] = (x, 0.0, z)
    return made


@pytest.mark.slow
def test_a_rendered_box_has_the_depth_of_its_sides():
    flat = np.eye(4)
    flat[2, 3] = 0.5
    depth = render_depth(BOX, FACES, CAMERA, flat)
    seen = depth > 0
    assert depth[60, 80] == pytest.approx(0.48)
    # 10 cm by 6 cm at 48 cm, seen through a lens of 150 px.
    assert seen.sum() == pytest.approx(0.1 * 0.06 * (150 / 0.48) ** 2, rel=0.05)
    behind = flat.copy()
    behind[2, 3] = -0.5
    assert not render_depth(BOX, FACES, CAMERA, behind).any()


def test_symmetric_poses_are_no_error_and_others_are():
    true = pose()
    assert mssd(true @ HALF_TURN, true, BOX, SYMMETRIES) < 1e-12
    assert mspd(true @ HALF_TURN, true, BOX, SYMMETRIES, CAMERA) < 1e-9
    assert mssd(true @ HALF_TURN, true, BOX, SYMMETRIES[:1]) > 0.1
    # The corner farthest to one side moves by the shift, at half a metre: 150 px / m / 0.5.
    moved = pose(0.01)
    assert mssd(moved, true, BOX, SYMMETRIES) == pytest.approx(0.01)
    assert 2.7 < mspd(moved, true, BOX, SYMMETRIES, CAMERA) < 3.6


def test_what_is_hidden_costs_no_visible_discrepancy():
    true = pose()
    depth = render_depth(BOX, FACES, CAMERA, true)
    assert vsd((depth, depth), depth, CAMERA, [0.005]) == (0.0,)
    wall = np.where(depth > 0, depth, 0.8)
    wall[:, 80:] = 0.2  # something stands before the right half
    cut = depth.copy()
    cut[:, 80:] = 0
    assert vsd((cut, depth), wall, CAMERA, [0.005]) == (0.0,)
    moved = render_depth(BOX, FACES, CAMERA, pose(0.02))
    strict, lenient = vsd((moved, depth), depth, CAMERA, [0.001, 0.05])
    assert strict > lenient > 0.1


def test_average_recall_falls_with_the_error_and_counts_misses():
    true = pose()
    depth = render_depth(BOX, FACES, CAMERA, true)
    errors = [
        bop_errors(pose(shift), true, (BOX, FACES), SYMMETRIES, CAMERA, depth, 0.123)
        for shift in (0.0, 0.01, 0.05)
    ]
    recalls = [average_recall([one]).mean for one in errors]
    assert recalls[0] == 1.0
    assert recalls[0] > recalls[1] > recalls[2]
    assert average_recall([errors[0], None]).mean == 0.5
    # MSSD of 10 mm passes from 10 % of 123 mm on: nine of ten thresholds.
    assert average_recall([errors[1]]).mssd == pytest.approx(0.9)


@pytest.fixture
def dataset(tmp_path):
    """Write a dataset of one image with a box and a cylinder's symmetry, as BOP lays it out."""
    import trimesh

    models, scene = tmp_path / "models", tmp_path / "test" / "000003"
    for folder in (models, scene / "depth", scene / "rgb", scene / "mask_visib"):
        folder.mkdir(parents=True)
    trimesh.Trimesh(BOX * 1000, FACES, process=False).export(models / "obj_000007.ply")
    told = {"diameter": 123.3, "symmetries_discrete": [HALF_TURN.ravel().tolist()],
            "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [10, 0, 0]}]}  # fmt: skip
    (models / "models_info.json").write_text(json.dumps({"7": told}))
    true = pose()
    depth = render_depth(BOX, FACES, CAMERA, true)
    cv2.imwrite(str(scene / "depth/000005.png"), np.rint(depth * 10_000).astype(np.uint16))
    cv2.imwrite(str(scene / "rgb/000005.png"), np.full((120, 160, 3), (1, 2, 3), np.uint8))
    cv2.imwrite(str(scene / "mask_visib/000005_000000.png"), (depth > 0).astype(np.uint8) * 255)
    k = [CAMERA.fx, 0, CAMERA.cx, 0, CAMERA.fy, CAMERA.cy, 0, 0, 1]
    files = {
        "scene_camera": {"cam_K": k, "depth_scale": 0.1},
        "scene_gt": [{"obj_id": 7, "cam_R_m2c": true[:3, :3].ravel().tolist(),
                      "cam_t_m2c": (true[:3, 3] * 1000).tolist()}],
        "scene_gt_info": [{"visib_fract": 0.9}],
    }  # fmt: skip
    for name, content in files.items():
        (scene / f"{name}.json").write_text(json.dumps({"5": content}))
    targets = [{"scene_id": 3, "im_id": 5, "obj_id": 7, "inst_count": 1}]
    (tmp_path / "test_targets_bop19.json").write_text(json.dumps(targets))
    return tmp_path


def test_a_dataset_reads_in_metres_and_radians(dataset):
    bop = BopDataset(dataset)
    assert bop.scenes() == [3]
    assert bop.targets() == [(3, 5, 7, 1)]
    (view,) = bop.views(3)
    (thing,) = view.objects
    model = bop.model(7)
    assert view.frame.rgb[0, 0].tolist() == [3, 2, 1]
    assert thing.visible == 0.9
    assert np.allclose(thing.camera_from_object, pose())
    assert model.diameter_m == pytest.approx(0.1233)
    assert np.allclose(model.vertices.max(axis=0), (0.05, 0.03, 0.02))
    drawn = render_depth(model.vertices, model.faces, view.frame.intrinsics, pose())
    assert np.abs(drawn - view.frame.depth_m).max() < 1e-4
    assert np.array_equal(thing.mask, drawn > 0)
    assert len(model.symmetries) == 2 * 72
    # A turn about an axis that passes beside the origin leaves that axis where it is.
    axis = np.array([0.01, 0, 0.3, 1])
    assert np.allclose(model.symmetries[5] @ axis, axis)
    assert list(bop.views(3, images=[6])) == []
    with pytest.raises(ValueError, match="no object 8"):
        bop.model(8)
    with pytest.raises(ValueError, match=r"scene_camera\.json"):
        list(bop.views(4))


def _without(dataset, name, key):
    path = dataset / name
    content = json.loads(path.read_text())
    entry = next(iter(content.values()))
    del (entry[0] if isinstance(entry, list) else entry)[key]
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("scene_camera.json", "cam_K"), ("scene_camera.json", "depth_scale"),
        ("scene_gt.json", "cam_R_m2c"), ("scene_gt.json", "cam_t_m2c"), ("scene_gt.json", "obj_id"),
    ],
)  # fmt: skip
def test_an_entry_that_lacks_a_number_is_named_with_its_file(dataset, name, key):
    _without(dataset, f"test/000003/{name}", key)
    with pytest.raises(ValueError, match=rf"000003/{name}: an entry lacks {key}"):
        list(BopDataset(dataset).views(3))


def test_images_and_scenes_may_be_numbered_with_fewer_digits(dataset):
    """As writers of the layout do that began with SIXD; a folder of that format is no scene."""
    (usual,) = BopDataset(dataset).views(3)
    scene = dataset / "test/000003"
    for kind in ("depth", "rgb"):
        (scene / kind / "000005.png").rename(scene / kind / "0005.png")
    scene.rename(dataset / "test/03")
    (dataset / "test/04").mkdir()
    (dataset / "test/04/gt.yml").write_text("{}")
    assert BopDataset(dataset).scenes() == [3]
    (view,) = BopDataset(dataset).views(3)
    assert np.array_equal(view.frame.depth_m, usual.frame.depth_m)
    assert np.array_equal(view.frame.rgb, usual.frame.rgb)
    assert view.objects[0].mask.any()


def test_damage_of_a_dataset_is_told_in_words(dataset):
    scene = dataset / "test/000003"
    with pytest.raises(ValueError, match=r"no such split; .* has models, test"):
        BopDataset(dataset).scenes("val")
    (dataset / "models/obj_000007.ply").unlink()
    with pytest.raises(ValueError, match=r"obj_000007\.ply: no such mesh"):
        BopDataset(dataset).model(7)
    cv2.imwrite(str(scene / "rgb/000005.png"), np.zeros((60, 80, 3), np.uint8))
    with pytest.raises(ValueError, match=r"\(120, 160\) pixels, its colour image \(60, 80\)"):
        list(BopDataset(dataset).views(3))
    cv2.imwrite(str(scene / "depth/000005.png"), np.zeros((120, 160), np.uint8))
    with pytest.raises(ValueError, match=r"000005\.png: no depth image of 16 bits"):
        list(BopDataset(dataset).views(3))
    (scene / "scene_camera.json").write_text('{"5": {"cam_K": [1, 2], "depth_scale": 1}}')
    cv2.imwrite(str(scene / "depth/000005.png"), np.zeros((120, 160), np.uint16))
    with pytest.raises(ValueError, match=r"scene_camera\.json: cam_K is \[1, 2\]"):
        list(BopDataset(dataset).views(3))


def test_results_are_written_as_the_benchmark_reads_them(tmp_path):
    path = tmp_path / "ours_lm-test.csv"
    write_results(path, [BopEstimate(3, 5, 7, 0.5, pose(0.01))])
    head, line = path.read_text().splitlines()
    assert head == "scene_id,im_id,obj_id,score,R,t,time"
    fields = line.split(",")
    assert fields[:4] == ["3", "5", "7", "0.500000"]
    assert np.allclose(np.array(fields[4].split(), float).reshape(3, 3), pose()[:3, :3])
    assert np.allclose(np.array(fields[5].split(), float), (10, 0, 500))
