"""Shape beside colours: what it tells apart, and that it decides nothing alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.geometry import Intrinsics
from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.confidence import ConfidenceParams, Evidence, confidences, likeness
from features.recognition.views.shape import SHAPE_SIZE, shape_histogram

SIDE_PX = 200
CAMERA = Intrinsics(SIDE_PX, SIDE_PX, 460.0, 460.0, 99.5, 99.5)
GREY, BLUE = (150, 150, 155), (40, 60, 170)


def surface(size_m: tuple[float, float, float], count: int = 4000) -> NDArray[np.float64]:
    """Return points of the top and two sides of a box, evenly, from a seed."""
    rng = np.random.default_rng(3)
    x, y, z = size_m
    areas = np.array([x * y, y * z, x * z])
    face = rng.choice(3, count, p=areas / areas.sum())
    points = rng.random((count, 3)) * size_m
    for number, axis in enumerate((2, 0, 1)):
        points[face == number, axis] = size_m[axis]
    return points


def histogram(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the shape of enough points."""
    found = shape_histogram(points)
    assert found is not None
    return found


def outline(kind: str) -> NDArray[np.int32]:
    """Return a polygon, px, about 100 px long: a bar with a head, or with a hook."""
    shapes = {
        "spoon": [(0, 22), (60, 22), (66, 10), (90, 10), (100, 30), (90, 50), (66, 50), (60, 36),
                  (0, 36)],
        "hook": [(0, 0), (14, 0), (14, 44), (86, 44), (86, 0), (100, 0), (100, 58), (0, 58)],
    }  # fmt: skip
    return np.array(shapes[kind], np.int32)


def plain(kind: str, colour: tuple[int, int, int], turn: float, seed: int) -> ViewFeatures:
    """Return a flat thing without print, 25 cm below the camera, turned on its table by rad."""
    rng = np.random.default_rng(seed)
    centred = outline(kind) - (50, 29)
    cosine, sine = np.cos(turn), np.sin(turn)
    corners = centred @ np.array([[cosine, sine], [-sine, cosine]]) + 100
    mask = cv2.fillPoly(np.zeros((SIDE_PX, SIDE_PX), np.uint8), [np.rint(corners).astype(int)], 1)
    inside = mask > 0
    image = np.where(inside[..., None], colour, 245) + rng.normal(0, 2, (SIDE_PX, SIDE_PX, 3))
    depth = np.where(inside, 0.25 + rng.normal(0, 0.0008, inside.shape), 0.0)
    rgb = np.clip(image, 0, 255).astype(np.uint8)
    return describe_view(rgb, inside, depth.astype(np.float32), CAMERA)


def stocked() -> RecognitionIndex:
    """Return an index with two turns of a grey spoon, and of a blue hook."""
    index = RecognitionIndex()
    for k, turn in enumerate((0.2, 1.4)):
        index.add(f"view:s{k}", "spoon", "class:tool", plain("spoon", GREY, turn, k))
        index.add(f"view:h{k}", "hook", "class:tool", plain("hook", BLUE, turn, 10 + k))
    return index


def test_the_histogram_is_free_of_frame_and_order() -> None:
    points = surface((0.12, 0.05, 0.03))
    moved = Rotation.from_euler("xyz", [0.4, 1.1, -2.0]).apply(points)
    moved += np.array([0.3, -0.2, 0.9])
    shuffled = moved[np.random.default_rng(0).permutation(len(moved))]
    first, second = histogram(points), histogram(shuffled)
    # Voxels fall elsewhere after a rotation, which costs about .01.
    assert first @ second > 0.985
    assert first @ histogram(surface((0.132, 0.05, 0.03))) < first @ second


def test_size_and_bend_tell_shapes_apart() -> None:
    block = histogram(surface((0.12, 0.05, 0.03)))
    assert block @ histogram(surface((0.06, 0.025, 0.015))) < 0.9
    assert block @ histogram(surface((0.12, 0.05, 0.001))) < 0.95


def test_too_few_points_have_no_shape() -> None:
    points = surface((0.1, 0.1, 0.1), 99)
    assert shape_histogram(points) is None
    assert shape_histogram(np.vstack([points, np.full((50, 3), np.nan)])) is None


def test_a_view_keeps_its_shape_and_a_cut_or_flat_one_has_none() -> None:
    view = plain("spoon", GREY, 0.0, 0)
    again = ViewFeatures.from_bytes(view.to_bytes())
    assert view.shape is not None
    assert again.shape is not None
    assert view.shape.shape == (SHAPE_SIZE,)
    assert np.array_equal(again.shape, view.shape)
    grey = np.full((40, 60, 3), 90, np.uint8)
    depth = np.full((40, 60), 0.3, np.float32)
    assert describe_view(grey, np.ones((40, 60), bool), depth, CAMERA).shape is None
    mask = np.zeros((40, 60), bool)
    mask[5:35, 5:55] = True
    assert describe_view(grey, mask).shape is None
    with pytest.raises(ValueError, match="shape must have shape"):
        replace(view, shape=np.zeros(7, np.float32))


def test_another_thing_of_the_same_colours_is_not_accepted() -> None:
    recogniser = Recogniser(stocked())
    spoon = recogniser.recognise(plain("spoon", GREY, 2.4, 20))
    assert spoon.accepts("spoon")
    assert not recogniser.recognise(plain("hook", GREY, 2.4, 21)).accepted


def test_another_thing_of_the_same_shape_is_not_accepted() -> None:
    recogniser = Recogniser(stocked())
    assert not recogniser.recognise(plain("spoon", (40, 160, 60), 2.4, 22)).accepted
    assert not recogniser.recognise(plain("spoon", BLUE, 2.4, 23)).accepted


def test_without_depth_nothing_changes() -> None:
    """Shapes that are stored have no part in the answer to a picture alone."""
    bare = RecognitionIndex()
    for k, turn in enumerate((0.2, 1.4)):
        for name, colour, seed in (("spoon", GREY, k), ("hook", BLUE, 10 + k)):
            view = replace(plain(name, colour, turn, seed), shape=None)
            bare.add(f"view:{name[0]}{k}", name, "class:tool", view)
    query = plain("spoon", GREY, 2.4, 20)
    unknown = np.full_like(query.points3d, np.nan)
    flat = replace(query, points3d=unknown, size_m=float("nan"), surface=None, shape=None)
    with_shapes, without = (Recogniser(one).recognise(flat) for one in (stocked(), bare))
    assert [m.confidence for m in with_shapes.matches] == [m.confidence for m in without.matches]


def test_an_object_without_a_stored_shape_is_judged_by_its_look(tmp_path: Path) -> None:
    """An index from before shapes were kept opens, and answers as if the query had none."""
    query = plain("spoon", GREY, 2.4, 20)
    with RecognitionIndex(tmp_path / "index") as index:
        for k, turn in enumerate((0.2, 1.4)):
            index.add(f"view:{k}", "spoon", "class:tool", plain("spoon", GREY, turn, k))
        index.save()
    (meta,) = tmp_path.glob("index/seg-*/meta.json")
    known = json.loads(meta.read_text())
    del known["crc32"]["shape.f32"]
    meta.write_text(json.dumps(known))
    (meta.parent / "shape.f32").unlink()
    with RecognitionIndex(tmp_path / "index") as index:
        recogniser = Recogniser(index)
        old = recogniser.recognise(query).matches[0].confidence
        assert old == recogniser.recognise(replace(query, shape=None)).matches[0].confidence


def test_the_less_alike_of_colours_and_shape_counts() -> None:
    params = ConfidenceParams()

    def of(colour: float, shape: float) -> float:
        return float(likeness(np.array([colour]), np.array([shape]), params)[0])

    assert of(0.99, 0.7) == of(0.8, 0.7) < of(0.8, 0.99)
    assert of(0.7, 0.99) == of(0.7, 1.0)
    assert of(0.9, -1.0) == of(0.9, 1.0)


def test_likeness_replaces_the_look_and_its_gates_stay() -> None:
    alike = Evidence(
        inliers=0, rival_inliers=0, appearance=0.6, appearance_lead=-0.2, colour=0.7, size_ok=True,
        size_gap=0.1, is_plain=True, likeness=3.4, likeness_lead=1.4,
    )  # fmt: skip
    assert confidences([alike])[0] > 0.7
    for changed in (
        replace(alike, likeness=None),
        replace(alike, likeness=2.0, likeness_lead=-0.1),
        replace(alike, likeness_lead=0.3),
        replace(alike, size_ok=False),
        replace(alike, is_plain=False, has_print=True),
    ):
        assert confidences([changed])[0] < 0.7, changed
