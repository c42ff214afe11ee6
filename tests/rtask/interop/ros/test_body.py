"""The robot's own body in a view."""

from __future__ import annotations

import numpy as np
import pytest

from features.perception import perceive
from rtask.errors import UsageError
from rtask.interop.ros.robot.body import body_of_json, body_pixels
from rtask.interop.ros.robot.model import RobotModel
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, urdf_of, view


def objects(urdf: str, **places: tuple[float, float, float]) -> list[float]:
    """Return y of what is seen beside a model whose links stand at places, m, base frame."""
    frame = view()

    def lookup(link: str) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, 3] = places[link.replace("/", "_")]
        return pose

    shapes, unplaced = RobotModel(urdf).placed(lookup, "r/base_footprint")
    assert not unplaced
    body = body_pixels(frame.points(), BASE_FROM_CAMERA, body_of_json(shapes))
    return [
        float(each.position[1]) for each in perceive(frame, BASE_FROM_CAMERA, body=body).objects
    ]


def test_a_part_of_the_robot_on_the_table_is_no_object():
    assert sorted(round(y, 2) for y in objects(urdf_of("bin"), r_bin=(0.0, 0.0, 1.0))) == [
        -0.09,
        0.09,
    ]
    assert [round(y, 2) for y in objects(urdf_of("bin"), r_bin=(0.27, 0.09, 0.31))] == [-0.09]


def test_a_table_in_the_model_stays_the_table():
    table = urdf_of("table", size="2 2 0.1")
    assert len(objects(table, r_table=(0.3, 0.0, 0.22))) == 2


def test_each_shape_is_where_its_origin_says():
    text = (
        "<robot><link name='a'><collision><origin xyz='1 0 0' rpy='0 1.5707963 0'/><geometry>"
        "<cylinder radius='0.1' length='2'/></geometry></collision><collision><geometry>"
        "<mesh filename='package://a.stl'/></geometry></collision></link></robot>"
    )
    model = RobotModel(text)
    [note] = model.notes
    assert note.startswith("the shape of a is not known: package://a.stl is not in this")
    shapes, _ = model.placed(lambda frame: np.eye(4), "base")
    points = np.array([[[1.9, 0.0, 0.0], [1.0, 0.0, 0.9], [0.1, 0.1, 0.0], [np.nan] * 3]])
    on_body = body_pixels(points, np.eye(4), body_of_json(shapes))
    assert on_body.tolist() == [[True, False, True, False]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot", "no XML"),
        ("<sdf/>", "no URDF, but <sdf>"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><robot/>", "declares entities"),
        (urdf_of("a", size="1 2"), "box of [1.0, 2.0]"),
        (urdf_of("a", size="1 2 nan"), "expected a box"),
        (urdf_of("a", size="1 2 x"), "could not convert"),
        (urdf_of("a").replace("<box size", "<capsule radius='1' size"), "capsule of [1.0]"),
    ],
)  # fmt: skip
def test_a_model_that_cannot_be_used_is_refused_with_the_reason(text, words):
    with pytest.raises(UsageError) as caught:
        RobotModel(text)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "shape",
    [{}, {"kind": "box", "size": [1, 1, 1], "pose": [0] * 15}, {"kind": "box", "size": "x"},
     {"kind": "box", "size": [1, 1, 1], "pose": [2.0] * 16}],
)  # fmt: skip
def test_a_request_with_another_shape_is_refused(shape):
    with pytest.raises(UsageError, match="shape 0 of the body"):
        body_of_json([shape])
