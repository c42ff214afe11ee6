"""A user's network beside SIFT: its vectors are stored, propose objects, and never decide."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

import rtask
from features.recognition.recogniser import Match, Recognition
from rtask.engine import Engine
from rtask.engine.perception.observation import Look, observe
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.wire.message import read

pytestmark = pytest.mark.slow


@pytest.fixture
def network(tmp_path):
    """Write a network whose vector is the mean colour of 4 x 4 fields."""
    nodes = [
        helper.make_node("AveragePool", ["image"], ["fields"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("Flatten", ["fields"], ["vector"]),
    ]
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, 16, 16])],
        [helper.make_tensor_value_info("vector", TensorProto.FLOAT, [1, 48])],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    model.ir_version = 8
    path = tmp_path / "tiny.onnx"
    onnx.save(model, str(path))
    return path


def plain(colour):
    """Return a picture of a thing without print, as JPEG, and its box."""
    image = np.full((240, 240, 3), 128, np.uint8)
    image[40:200, 50:190] = colour
    return {"image": cv2.imencode(".jpg", image[..., ::-1])[1].tobytes(), "box": [50, 40, 140, 160]}


@pytest.mark.slow
def test_where_print_is_missing_the_network_proposes_and_nothing_is_accepted(tmp_path, network):
    store = tmp_path / "store"
    with rtask.open(store, reason=False) as kb, Engine(kb, embedder=network) as engine:
        things = {}
        for name, colour in (("red cup", (200, 40, 30)), ("blue cup", (30, 40, 200))):
            item = {**plain(colour), "name": name, "merge": False}
            things[name] = engine.call("insert_object", {"objects": [item]})["objects"][0]
        found = engine.call("search_object", plain((190, 50, 40)))
        assert found["similar_objects"][0]["label"] == "red cup"
        assert not found["accepted"]
        embeddings, seen = (
            engine.context.views.embeddings,
            observe(read(Look, plain((30, 50, 190)))),
        )
        nothing = Recognition("null", False, ())
        proposed = embeddings.propose(nothing, seen, 5, engine.policy.suggestion)
        assert not proposed.accepted
        assert proposed.matches[0].object_iri == things["blue cup"]["object"]
        assert 0.4 < proposed.matches[0].confidence <= engine.policy.suggestion
        printed = Match("object:1", "class:1", 0.3, 8, (), 0.5, None, None, "view:1")
        found = replace(nothing, matches=(printed,))
        assert embeddings.propose(found, seen, 5, 0.5) is found  # print was matched
        rows = kb.select(
            f"{PREFIXES} SELECT ?n WHERE {{ ?c a rt:DescriptorSet ; rt:descriptorLength ?n "
            'FILTER(CONTAINS(STR(?c), "/embedding-")) }'
        )
        assert [int(row["n"].value) for row in rows] == [48, 48]
        again = engine.call("insert_object", {"objects": [plain((195, 45, 35))]})
        assert again["objects"][0]["new"]  # a proposal is no recognition
        engine.call("curate_object", {"operation": "forget", "object": things["red cup"]["object"]})
        found = engine.call("search_object", plain((200, 40, 30)))
        assert "red cup" not in [one["label"] for one in found["similar_objects"]]
    with rtask.open(store, reason=False) as kb, Engine(kb, embedder=network) as engine:
        found = engine.call("search_object", plain((40, 50, 190)))
        assert found["similar_objects"][0]["label"] == "blue cup"
    with rtask.open(store, reason=False) as kb, Engine(kb) as engine:
        assert engine.context.views.embeddings is None


def test_a_file_that_is_no_network_is_refused_by_its_name(tmp_path, kb):
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(UsageError, match=r"broken\.onnx: not a network"):
        Engine(kb, embedder=broken)
    with pytest.raises(UsageError, match="No such file"):
        Engine(kb, embedder=tmp_path / "missing.onnx")
