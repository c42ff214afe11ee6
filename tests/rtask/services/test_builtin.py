"""Services that come with the product: segmentation, and what is segmented put to the engine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import rtask
from features.codec import decode, encode_frame
from features.geometry import Frame
from rtask.engine import Engine
from rtask.errors import ServiceError
from rtask.services import ServiceHost
from rtask.services.offered import open_host
from tests.features.segmentation.test_segmentation import CAMERA, THREE, _scene

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
