"""Vectors of a tiny network made here."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from features.embedding.embedder import Embedder, vector_from_bytes, vector_to_bytes
from features.embedding.index import VectorIndex


def network(path, channels_last=False, side=16, offset=0.0):
    """Write a network whose vector is the mean colour of 4 x 4 fields: it sees colour and place."""
    shape = [1, side, side, 3] if channels_last else [1, 3, side, side]
    nodes = []
    name = "image"
    if channels_last:
        nodes.append(helper.make_node("Transpose", [name], ["first"], perm=[0, 3, 1, 2]))
        name = "first"
    nodes += [
        helper.make_node("AveragePool", [name], ["fields"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("Flatten", ["fields"], ["flat"]),
        helper.make_node("Add", ["flat", "offset"], ["vector"]),
    ]
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("vector", TensorProto.FLOAT, [1, 3 * (side // 4) ** 2])],
        [helper.make_tensor("offset", TensorProto.FLOAT, [1], [offset])],
    )  # fmt: skip
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    model.ir_version = 8
    onnx.save(model, str(path))
    return path


def picture(colour, shape=(40, 60)):
    return np.full((*shape, 3), colour, np.uint8)


def test_a_vector_has_unit_length_and_depends_on_what_is_seen(tmp_path):
    embedder = Embedder(network(tmp_path / "tiny.onnx"))
    red, again, blue = (
        embedder.embed(picture(c)) for c in ((200, 30, 20), (190, 35, 25), (20, 30, 200))
    )
    assert red.shape == (48,)
    assert np.linalg.norm(red) == pytest.approx(1.0, abs=1e-5)
    assert red @ again > 0.99 > red @ blue
    assert np.array_equal(red, embedder.embed(picture((200, 30, 20))))


def test_what_lies_beside_the_mask_does_not_count(tmp_path):
    embedder = Embedder(network(tmp_path / "tiny.onnx"))
    mask = np.zeros((40, 60), bool)
    mask[:, 20:40] = True
    first, second = picture((10, 200, 10)), picture((250, 0, 250))
    first[mask] = second[mask] = (90, 60, 30)
    assert np.allclose(embedder.embed(first, mask), embedder.embed(second, mask))


def test_either_order_of_channels_gives_the_same_vector(tmp_path):
    first = Embedder(network(tmp_path / "first.onnx"))
    last = Embedder(network(tmp_path / "last.onnx", channels_last=True))
    image = np.random.default_rng(0).integers(0, 255, (50, 50, 3)).astype(np.uint8)
    assert np.allclose(first.embed(image), last.embed(image), atol=1e-6)
    assert first.digest != last.digest


def test_files_that_are_no_network_and_vectors_of_another_are_refused(tmp_path):
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(ValueError, match="not a network"):
        Embedder(broken)
    data = vector_to_bytes(np.array([0.6, 0.8], np.float32), "a" * 64)
    assert vector_from_bytes(data, "a" * 64).tolist() == pytest.approx([0.6, 0.8])
    with pytest.raises(ValueError, match="of network aaaa"):
        vector_from_bytes(data, "b" * 64)
    with pytest.raises(ValueError, match="no vector"):
        vector_from_bytes(b"PK", "a" * 64)


def test_the_index_answers_with_objects_and_forgets_views():
    rng = np.random.default_rng(0)
    index = VectorIndex()
    vectors = rng.normal(size=(30, 8)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    for k, vector in enumerate(vectors):
        index.add(f"view:{k}", f"object:{k // 3}", "class:x", vector)
    near = index.nearest(vectors[7], 3)
    assert near[0].view_iri == "view:7"
    assert near[0].cosine == pytest.approx(1.0, abs=1e-5)
    assert len({one.object_iri for one in near}) == 3
    index.remove("view:7")
    index.remove("view:unknown")
    assert index.nearest(vectors[7], 1)[0].view_iri != "view:7"
    index.relabel("view:6", "object:other", "class:y")
    assert index.nearest(vectors[6], 1)[0].object_iri == "object:other"
    with pytest.raises(ValueError, match="the others have 8"):
        index.add("view:new", "object:new", "class:x", np.ones(3, np.float32))
