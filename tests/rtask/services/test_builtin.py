"""Services that come with the product: segmentation, and what is segmented put to the engine."""

from __future__ import annotations

import base64
from collections.abc import Iterator

import numpy as np
import pytest

import rtask
from features.codec import decode, encode_frame
from features.geometry import Frame
from features.perception import perceive
from grasp.messages import pose_message
from rtask.engine import Engine
from rtask.errors import ServiceError
from rtask.interop.ros.looking import Look
from rtask.services import ServiceHost
from rtask.services.offered import open_host
from tests.features.segmentation.test_segmentation import CAMERA, THREE, _scene
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA
from tests.rtask.interop.ros.scene import view as scene_view

pytestmark = pytest.mark.slow  # starts an engine


@pytest.fixture(scope="module")
def host() -> Iterator[ServiceHost]:
    with (
        rtask.open(":memory:", reason=False) as kb,
        Engine(kb) as engine,
        open_host(engine) as opened,
    ):
        yield opened


@pytest.fixture(scope="module")
def view() -> bytes:
    grey = np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8)
    return encode_frame(Frame(_scene(*THREE)[..., 2].astype(np.float32), CAMERA, grey))


def test_a_view_is_cut_into_objects_each_with_its_crop(host, view):
    found = host.connect("rtask/Segmentation").segment(view)
    assert found.status == "ok"
    assert len(found.objects) == 3
    for one in found.objects:
        crop = decode(one.cloud)
        assert isinstance(crop, Frame)
        assert crop.mask is not None
        # Missing depth and the mask's border differ by a few pixels.
        assert abs(int(crop.mask.sum()) - one.points) <= 0.05 * one.points
    assert np.linalg.norm(found.table[:3]) == pytest.approx(1.0)


def test_views_of_several_cameras_are_cut_together(host):
    frame, pose = scene_view(), pose_message(BASE_FROM_CAMERA)
    views = [{"cloud": encode_frame(frame), "sensor_pose": pose}] * 2
    one = host.call("rtask/Segmentation", "segment_views", {"views": views[:1]}).as_json()
    both = host.call("rtask/Segmentation", "segment_views", {"views": views}).as_json()
    assert both["table_height"] == pytest.approx(
        perceive(frame, BASE_FROM_CAMERA).table_height, abs=0.002
    )
    assert len(both["objects"]) == len(one["objects"]) == 2
    for alone, joined in zip(one["objects"], both["objects"], strict=True):
        assert joined["points"] == pytest.approx(2 * alone["points"], rel=0.1)
        assert sorted(each["view"] for each in joined["seen"]) == [0, 1]
        crop = decode(base64.b64decode(joined["seen"][0]["cloud"]))
        assert isinstance(crop, Frame)
        cloud = decode(base64.b64decode(joined["cloud"]))
        assert cloud.points().mean(axis=0) == pytest.approx(joined["centroid"], abs=0.002)
    with pytest.raises(ServiceError, match=r"views\[1\]\.cloud"):
        host.call("rtask/Segmentation", "segment_views", {
            "views": [views[0], {"cloud": b"none", "sensor_pose": pose}]
        })  # fmt: skip


def test_a_cloud_message_and_depth_with_colour_are_perceived_alike(host):
    frame = scene_view()
    pose = pose_message(BASE_FROM_CAMERA)
    by_cloud = host.call(
        "rtask/Segmentation", "perceive", {"cloud": encode_frame(frame), "sensor_pose": pose}
    ).as_json()
    camera = frame.intrinsics
    info = {"width": camera.width, "height": camera.height, "d": [],
            "k": [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]}  # fmt: skip
    size = {"width": camera.width, "height": camera.height, "is_bigendian": 0}

    def packed(pixels):
        return base64.b64encode(np.ascontiguousarray(pixels).tobytes()).decode()

    depth = {**size, "encoding": "32FC1", "step": 4 * camera.width, "data": packed(frame.depth_m)}
    image = {**size, "encoding": "rgb8", "step": 3 * camera.width, "data": packed(frame.rgb)}
    given = {"depth": depth, "image": image, "camera_info": info, "sensor_pose": pose}
    by_depth = host.call("rtask/Segmentation", "perceive", {**given, "points": True}).as_json()
    expected = perceive(frame, BASE_FROM_CAMERA)
    for answer in (by_cloud, by_depth):
        assert (answer["status"], len(answer["objects"])) == ("ok", 2)
        assert answer["table_height"] == pytest.approx(expected.table_height, abs=1e-3)
        for one, seen in zip(answer["objects"], expected.objects, strict=True):
            sides = (seen.shape.length, seen.shape.width, seen.shape.height)
            assert one["size"] == pytest.approx(sides, abs=2e-3)
            assert isinstance(decode(base64.b64decode(one["cloud"])), Frame)
        assert min(answer["table"]["size"][:2]) > 0.3
    assert by_cloud["objects"][0]["points"] is None
    assert len(base64.b64decode(by_depth["objects"][0]["points"])) > 16 * 500


def test_what_is_doubtful_of_a_live_view_comes_with_the_answer(host):
    frame = scene_view()
    camera, pose = frame.intrinsics, pose_message(BASE_FROM_CAMERA)
    info = {"width": camera.width, "height": camera.height, "d": [],
            "k": [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1],
            "header": {"frame_id": "other_optical_frame"}}  # fmt: skip
    size = {"width": camera.width, "height": camera.height, "is_bigendian": 0, "step": 0,
            "header": {"frame_id": "optical_frame"}}  # fmt: skip

    def packed(pixels):
        return base64.b64encode(np.ascontiguousarray(pixels).tobytes()).decode()

    image = {**size, "encoding": "rgb8", "data": packed(frame.rgb)}
    depth = {**size, "encoding": "32FC1", "data": packed(frame.depth_m)}
    given = {"image": image, "depth": depth, "camera_info": info, "sensor_pose": pose}
    answer = host.call("rtask/Segmentation", "perceive", given).as_json()
    assert answer["status"] == "ok"
    assert ["other_optical_frame" in doubt for doubt in answer["doubts"]] == [True]
    look = Look.from_json(answer, None, pose)
    assert look.doubts == tuple(answer["doubts"])
    own = {**given, "camera_info": {**info, "header": {"frame_id": "optical_frame"}}}
    assert host.call("rtask/Segmentation", "perceive", own).as_json()["doubts"] == []


def test_perceiving_without_a_view_says_what_is_missing(host):
    pose = pose_message(BASE_FROM_CAMERA)
    with pytest.raises(ServiceError, match="so is depth with image and camera_info"):
        host.call("rtask/Segmentation", "perceive", {"sensor_pose": pose, "depth": {}})


def test_an_empty_view_has_no_table_and_no_objects(host):
    far = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    view = encode_frame(Frame(far, CAMERA, None))
    answer = host.call("rtask/Segmentation", "segment", {"cloud": view}).as_json()
    assert answer["status"] != "ok"
    assert (answer["objects"], answer["table"]) == ([], None)


def test_what_is_no_cloud_is_refused_in_words(host):
    with pytest.raises(ServiceError, match="cloud:"):
        host.connect("rtask/Segmentation").segment(b"no cloud")


def test_a_pipeline_cuts_a_view_and_asks_the_engine_for_each_object(host, view):
    answer = host.call(
        "rtask/Pipeline",
        "run",
        {
            "inputs": {"view": view},
            "steps": [
                {
                    "id": "parts",
                    "call": "rtask/Segmentation@1.*/segment",
                    "inputs": {"cloud": {"$input": "view"}},
                },
                {
                    "id": "names",
                    "call": "rtask/Engine/search_object",
                    "each": {"$ref": "parts.objects"},
                    "inputs": {"data": {"$ref": "item.cloud"}},
                },
            ],
            "output": {"names": {"$ref": "names"}, "labels": {"$ref": "parts.objects.0.label"}},
        },
    )
    assert [one["similar_objects"] for one in answer["output"]["names"]] == [[], [], []]
    assert answer["output"]["labels"] == 1
    # The crops stay where they are: what comes back is smaller than the smallest of them.
    crops = [len(one.cloud) for one in host.connect("rtask/Segmentation").segment(view).objects]
    assert len(crops) == 3
    assert len(answer.to_json()) < min(crops)
