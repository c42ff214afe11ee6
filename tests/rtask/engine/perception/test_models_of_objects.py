"""Models grow with good views, stay as they are after bad ones, and tell the pose."""

from __future__ import annotations

import base64
import json

import cv2
import numpy as np
import pytest

import rtask
from features.codec import encode_cloud, encode_frame, to_wire
from features.geometry import Frame
from features.modelling import ObjectModel
from grasp.messages import matrix_from_message
from rtask.engine import Engine
from rtask.engine.stored import stored_models
from rtask.errors import UsageError
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import iri

YAWS = (0.3, 0.9, -0.5)


def model_of(engine, thing):
    found = engine.models.of(iri(thing))
    assert found is not None
    return found


@pytest.fixture
def robot(robots):
    return robots("nao-1")


def fill_store(bench, robots):
    """Fill the store of tests that ask for ``filled``; return the IRI of a box seen three times."""
    name, robot = "", robots("nao-1")
    for yaw in YAWS:
        more = {"object": name} if name else {}
        told = robot.insert(bench.sight(bench.BOX.at(0.16, -0.06, yaw)), **more)
        name = told["objects"][0]["object"]
    return name


@pytest.mark.slow
def test_a_model_grows_with_every_view_and_there_is_one_for_each_author(bench, engine, filled):
    (stored,) = stored_models(engine.kb, iri(filled))
    views = {q.object.value for q in engine.kb.match(iri(filled), RT.hasView)}
    assert stored.views == views
    model = ObjectModel.from_bytes(engine.kb.blobs.read(stored.blob))
    assert [source for source, _ in model.sources] == sorted(views)
    low, high = model.cloud[:, :3].min(axis=0), model.cloud[:, :3].max(axis=0)
    # The frame of the grasps: in the middle of the footprint, z up from the table, x along.
    assert np.abs((high - low) - bench.BOX.size).max() < 0.006
    assert np.abs((high + low)[:2] / 2).max() < 0.004
    assert abs(high[2] - bench.BOX.size[2]) < 0.004
    assert len(engine.kb.match(None, RDF.type, RT.TriangleMesh)) == 1


@pytest.mark.slow
def test_the_answer_carries_the_pose_and_its_confidence(bench, engine, robot, filled):
    thing = bench.BOX.at(0.15, -0.05, 0.6)
    answer = robot.recognise(bench.sight(thing))
    assert answer["object"] == filled
    recognition = answer["recognition"]
    json.dumps(recognition, allow_nan=False)
    assert recognition["pose_accepted"]
    assert recognition["pose_confidence"] >= 0.7
    assert recognition["pose"]["source"] == "model"
    assert recognition["pose"]["views"] == 3
    pose = matrix_from_message(recognition["pose"]["frame_from_object"])
    # The first view's yaw was the object's own; its frame turned as the thing did.
    assert np.linalg.norm(pose[:3, 3] - [*thing.position, bench.TABLE]) < 0.005
    turned = np.arctan2(pose[1, 0], pose[0, 0]) - thing.yaw
    assert abs((turned + np.pi / 2) % np.pi - np.pi / 2) < np.deg2rad(5)


def test_what_nobody_knows_has_no_pose(bench, robot):
    recognition = robot.recognise(bench.sight(bench.PEN))["recognition"]
    assert recognition["pose"] is None
    assert recognition["pose_confidence"] == 0.0
    assert not recognition["pose_accepted"]


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.060, 0.032, 0.085), (0.046, 0.032, 0.072)])
def test_a_look_alike_told_under_the_same_name_does_not_spoil_the_model(bench, engine, robot, size):
    name = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    before = model_of(engine, name)[0]
    taller = bench.Thing(size, texture_seed=1)  # same print, another body
    told = robot.insert(bench.sight(taller.at(0.16, -0.06, 0.4)), object=name)
    assert told["stored"] == 1  # the view is kept; the robot said so
    assert model_of(engine, name)[0] == before
    assert told["objects"][0]["view"] not in before.views


@pytest.mark.slow
def test_two_robots_grow_one_model_each_in_its_own_graph(bench, engine, robots):
    first, second = robots("nao-1"), robots("nao-2")
    seen = bench.sight(bench.BOX.at(0.16, -0.06, 0.3))
    name = first.insert(seen)["objects"][0]["object"]
    second.insert(bench.sight(bench.BOX.at(0.15, -0.05, 1.0)), object=name)
    models = stored_models(engine.kb, iri(name))
    assert [len(model.views) for model in models] == [2, 1]
    assert len(model_of(engine, name)[0].views) == 2
    second.insert(bench.sight(bench.BOX.at(0.17, -0.05, -0.6)), object=name)
    assert [len(m.views) for m in stored_models(engine.kb, iri(name))] == [3, 1]


@pytest.mark.slow
def test_models_are_made_again_from_the_views(bench, engine, robot, filled):
    can = robot.insert(bench.sight(bench.CAN))["objects"][0]["object"]
    before = {thing: model_of(engine, thing) for thing in (filled, can)}
    assert engine.rebuild_models() == 2
    for thing, (stored, model) in before.items():
        (again,) = stored_models(engine.kb, iri(thing))
        assert again.views == stored.views
        cloud = model_of(engine, thing)[1].cloud
        assert abs(len(cloud) / len(model.cloud) - 1) < 0.1
        assert (
            np.abs(np.ptp(cloud[:, :3], axis=0) - np.ptp(model.cloud[:, :3], axis=0)).max() < 0.003
        )
    engine.kb.collect_blobs(0)
    assert model_of(engine, filled)[1] is not None
    assert not [f for f in engine.kb.verify(parts=("blobs",)) if f.severity == "error"]


@pytest.mark.slow
def test_a_model_outlives_the_process_and_a_missing_blob_is_no_error(bench, tmp_path):
    seen = bench.sight(bench.BOX)
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        name = robot.insert(seen)["objects"][0]["object"]
        blob = model_of(engine, name)[0].blob
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        assert robot.recognise(seen)["recognition"]["pose_accepted"]
        kb.blobs.discard(blob.rpartition(":")[2], 0)
    with rtask.open(tmp_path / "kb", reason=False) as kb, Engine(kb) as engine:
        answer = bench.Robot("nao-1", engine).recognise(seen)
        assert answer["object"] == name  # without a model the stored view gives the pose
        assert answer["recognition"]["pose"]["source"] == "view"
        assert answer["recognition"]["pose_confidence"] <= 0.8
        assert engine.rebuild_models() == 1
        assert bench.Robot("nao-1", engine).recognise(seen)["recognition"]["pose"]["source"] == (
            "model"
        )


@pytest.mark.slow
def test_an_insertion_that_fails_leaves_no_model(bench, engine, robot, monkeypatch):
    name = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
    before = model_of(engine, name)[0]

    def broken(*args, **kwargs):
        raise OSError("the disk is gone")

    monkeypatch.setattr("rtask.kb.commit.transaction.Transaction.commit", property(broken))
    with pytest.raises(OSError, match="disk"):
        robot.insert(bench.sight(bench.BOX.at(0.15, -0.05, 1.0)), object=name)
    monkeypatch.undo()
    robot.insert(bench.sight(bench.BOX.at(0.15, -0.05, 0.9)), object=name)
    assert len(model_of(engine, name)[0].views) >= len(before.views) + 1


def changed(bench, thing, change):
    """Return what a robot sends of a thing whose crop was changed."""
    eye = bench.Eye(target=(*thing.position, bench.TABLE))
    frame = bench.look(thing, eye)
    sent = bench.sight(thing)
    return {**sent, "data": to_wire(encode_frame(change(frame.crop(frame.mask))))}


def test_an_empty_cloud_is_refused_by_name(robot):
    with pytest.raises(UsageError, match="data"):
        robot.recognise({"data": to_wire(encode_cloud(np.zeros((0, 3), np.float32)))})
    nothing = np.full((50, 3), np.nan, np.float32)
    with pytest.raises(UsageError, match="data"):
        robot.recognise({"data": to_wire(encode_cloud(nothing))})


@pytest.mark.slow
@pytest.mark.usefixtures("filled")
def test_a_crop_without_depth_is_named_and_has_no_pose(bench, robot):
    blind = changed(
        bench, bench.BOX, lambda c: Frame(0 * c.depth_m, c.intrinsics, c.rgb, c.mask, c.x0, c.y0)
    )
    answer = robot.recognise(blind)
    assert answer["shape"] is None
    assert not answer["recognition"]["pose_accepted"]
    assert answer["grasps"] == []


@pytest.mark.slow
def test_wrong_intrinsics_give_no_accepted_pose(bench, engine, robot, filled):

    def longer(crop):
        camera = crop.intrinsics
        twice = type(camera)(camera.width, camera.height, 2 * camera.fx, 2 * camera.fy,
                             camera.cx, camera.cy)  # fmt: skip
        return Frame(crop.depth_m, twice, crop.rgb, crop.mask, crop.x0, crop.y0)

    seen = changed(bench, bench.BOX, longer)
    answer = robot.recognise(seen, object=filled)
    assert not answer["recognition"]["pose_accepted"]
    before = model_of(engine, filled)[0]
    robot.insert(seen, object=filled)
    assert model_of(engine, filled)[0] == before


@pytest.mark.slow
@pytest.mark.usefixtures("filled")
def test_a_mirrored_picture_is_not_recognised(bench, robot):

    def mirrored(crop):
        return Frame(crop.depth_m[:, ::-1].copy(), crop.intrinsics, crop.rgb[:, ::-1].copy(),
                     crop.mask[:, ::-1].copy(), crop.x0, crop.y0)  # fmt: skip

    answer = robot.recognise(changed(bench, bench.BOX, mirrored))
    assert not answer["recognition"]["accepted"]
    assert answer["recognition"]["pose"] is None


@pytest.mark.slow
def test_an_object_that_the_border_cuts_is_placed_or_left_open(bench, engine, robot, filled):
    eye = bench.Eye(target=(0.16, -0.06, bench.TABLE))
    frame = bench.look(bench.BOX, eye)
    columns = np.nonzero(frame.mask)[1]
    cut = frame.mask.copy()
    cut[:, int(np.median(columns)) :] = False
    sent = {**bench.sight(bench.BOX), "data": to_wire(encode_frame(frame.crop(cut)))}
    recognition = robot.recognise(sent, object=filled)["recognition"]
    if recognition["pose_accepted"]:
        pose = matrix_from_message(recognition["pose"]["frame_from_object"])
        assert np.linalg.norm(pose[:2, 3] - bench.BOX.position) < 0.01


@pytest.mark.slow
@pytest.mark.usefixtures("filled")
def test_holes_in_the_depth_do_not_hide_the_pose(bench, robot):

    def torn(crop):
        depth = crop.depth_m.copy()
        depth[::2], depth[1::4] = np.nan, np.inf
        return Frame(depth, crop.intrinsics, crop.rgb, crop.mask, crop.x0, crop.y0)

    recognition = robot.recognise(changed(bench, bench.BOX, torn))["recognition"]
    json.dumps(recognition, allow_nan=False)
    assert recognition["pose_accepted"]


@pytest.mark.slow
@pytest.mark.usefixtures("filled")
def test_a_million_points_without_a_picture_have_grasps_and_no_pose(bench, robot):
    frame = bench.look(bench.BOX, bench.Eye(target=(*bench.BOX.position, bench.TABLE)))
    points = frame.points()[frame.mask]
    many = points[np.arange(1_000_000) % len(points)]
    many = many + np.random.default_rng(0).normal(0, 2e-4, many.shape)
    dense = {**bench.sight(bench.BOX), "data": to_wire(encode_cloud(many.astype(np.float32)))}
    answer = robot.recognise(dense)
    assert answer["grasps"]
    assert answer["recognition"]["pose"] is None


@pytest.mark.slow
def test_two_identical_objects_in_one_scene_have_each_its_pose(bench, robot, filled):
    places = ((0.12, -0.06), (0.22, 0.02))
    for x, y in places:
        answer = robot.recognise(bench.sight(bench.BOX.at(x, y, 0.5)))
        assert answer["object"] == filled
        pose = matrix_from_message(answer["recognition"]["pose"]["frame_from_object"])
        assert np.hypot(pose[0, 3] - x, pose[1, 3] - y) < 0.006


@pytest.mark.slow
def test_a_thing_without_any_print_is_stored_and_has_a_model(bench, engine, robot):
    done, plain = cv2.imencode(".png", np.full((60, 80, 3), 128, np.uint8))
    assert done

    def bare(crop):
        return Frame(crop.depth_m, crop.intrinsics, np.full_like(crop.rgb, 128), crop.mask,
                     crop.x0, crop.y0)  # fmt: skip

    seen = changed(bench, bench.CAN, bare)
    told = robot.insert(seen)["objects"][0]
    assert told["features"] <= 3
    assert model_of(engine, told["object"])[1].sources[0][0] == told["view"]
    only_picture = robot.insert(
        {**seen, "image": base64.b64encode(plain.tobytes()).decode()}, merge=False
    )["objects"][0]
    assert engine.models.of(iri(only_picture["object"])) is None
