"""A gripper described by a file or a URDF plans like one that is built in."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, plan_on_mesh
from grasp.spatial.gripper import nao_hand, panda_hand
from grasp.spatial.gripper_files import (
    gripper_from_data,
    gripper_named,
    gripper_to_data,
    read_gripper,
)
from grasp.spatial.gripper_urdf import gripper_from_urdf
from grasp.spatial.meshes.shapes import box_mesh

FINGER = """
<link name="{name}"><collision><origin xyz="{x} 0 0.03"/><geometry>
  <box size="0.012 0.02 0.06"/></geometry></collision></link>
<joint name="{name}_joint" type="prismatic"><parent link="{palm}"/><child link="{name}"/>
  <origin xyz="0 0 0.05"/><axis xyz="{axis} 0 0"/>
  <limit lower="0" upper="0.05" effort="35" velocity="1"/></joint>"""


def urdf(*fingers: str, palm: str = "palm") -> str:
    base = (
        f'<robot name="wide"><link name="{palm}"><collision><origin xyz="0 0 0.02"/><geometry>'
        '<box size="0.16 0.06 0.05"/></geometry></collision></link>'
    )
    return base + "".join(fingers) + "</robot>"


def finger(name: str, side: int, palm: str = "palm") -> str:
    return FINGER.format(name=name, x=0.006 * side, axis=side, palm=palm)


WIDE = urdf(finger("left", -1), finger("right", 1))


@pytest.fixture
def wide(tmp_path: Path) -> Path:
    path = tmp_path / "wide.urdf"
    path.write_text(WIDE)
    return path


def test_a_urdf_gives_stroke_pads_force_and_pose(wide: Path) -> None:
    hand = read_gripper(wide)
    assert hand.min_opening == pytest.approx(0.0, abs=1e-9)
    assert hand.max_opening == pytest.approx(0.10)
    assert hand.finger_width == pytest.approx(0.02)
    assert hand.thickness == pytest.approx(0.012)
    assert hand.finger_length == pytest.approx(0.11 - 0.045)  # tip of the fingers, top of the palm
    assert hand.max_force == 35
    assert hand.palm == pytest.approx((0.16, 0.06, 0.05))
    tip = hand.parent_from_gripper @ [0, 0, hand.fingertip, 1]
    assert tip[:3] == pytest.approx([0, 0, 0.11])
    assert hand.joint_positions(0.10) == pytest.approx({"left_joint": 0.05, "right_joint": 0.05})
    left = hand.boxes(0.10)[0]
    assert left[1, 0] == pytest.approx(-0.05)


def test_a_gripper_of_a_urdf_plans_on_meshes_and_clouds(wide: Path) -> None:
    hand, box = read_gripper(wide), box_mesh((0.04, 0.12, 0.1))
    few = SpatialOptions(tries=300, samples=20)
    best = plan_on_mesh(box, hand, Surroundings(Support(-0.05)), few)[0]
    assert best.width == pytest.approx(0.04, abs=0.002)
    assert best.scores["carry"] > 0.5
    points, _ = box.sample(3000, np.random.default_rng(0))
    assert plan_on_cloud(points, hand, Support(-0.05), options=few)


@pytest.mark.slow
def test_the_pandas_own_urdf_agrees_with_the_hand_that_is_built_in() -> None:
    found = importlib.util.find_spec("pybullet_data")
    if found is None or found.origin is None:
        pytest.skip("needs pybullet_data")
    read = read_gripper(Path(found.origin).parent / "franka_panda" / "panda.urdf")
    ours = panda_hand()
    assert read.max_opening == pytest.approx(ours.max_opening, abs=0.001)
    assert read.max_force == ours.max_force
    # Pads of the mesh are round at the ends, ours are boxes.
    assert read.finger_width == pytest.approx(ours.finger_width, abs=0.003)
    # The same up to half a turn about the approach: both jaws are alike.
    np.testing.assert_allclose(
        np.abs(read.parent_from_gripper), np.abs(ours.parent_from_gripper), atol=0.002
    )
    np.testing.assert_allclose(read.palm[:2], ours.palm[:2], atol=0.002)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (urdf(finger("left", -1)), "one pair"),
        (urdf(finger("left", 1), finger("right", 1)), "one pair"),
        ("<robot", "no XML"),
        ("<model/>", "no URDF"),
        ('<!DOCTYPE robot [<!ENTITY a "b">]><robot/>', "document type"),
        (WIDE.replace('"0.05" effort', '"0" effort'), "no stroke"),
        (WIDE.replace("box size", "cone size"), "no shape"),
        (WIDE.replace('size="0.012', 'size="a'), "numbers"),
    ],
)  # fmt: skip
def test_a_urdf_without_a_gripper_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "odd.urdf"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        read_gripper(path)


def test_joints_can_be_named_where_there_are_several_pairs(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(
        urdf(*(finger(f"{name}{k}", side) for k in (1, 2) for name, side in (("l", -1), ("r", 1))))
    )
    with pytest.raises(ValueError, match="l1_joint and r1_joint"):
        read_gripper(path)
    hand = gripper_from_urdf(path, ("l2_joint", "r2_joint"), friction=0.8)
    assert hand.joints == ("l2_joint", "r2_joint")
    assert hand.friction == 0.8
    with pytest.raises(ValueError, match="no prismatic joint"):
        gripper_from_urdf(path, ("l2_joint", "thumb"))


@pytest.mark.parametrize("hand", [panda_hand(), nao_hand()], ids=["panda", "nao"])
def test_a_gripper_survives_a_file(tmp_path: Path, hand) -> None:
    path = tmp_path / "hand.json"
    path.write_text(json.dumps(gripper_to_data(hand)))
    again = gripper_named(str(path))
    assert again == hand
    np.testing.assert_array_equal(again.parent_from_gripper, hand.parent_from_gripper)


def test_toml_describes_a_gripper(tmp_path: Path) -> None:
    path = tmp_path / "hand.toml"
    path.write_text('name = "slim"\nmax_opening = 0.05\npalm = [0.08, 0.04, 0.05]\n')
    hand = read_gripper(path)
    assert (hand.gripper_type, hand.max_opening, hand.palm) == ("slim", 0.05, (0.08, 0.04, 0.05))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"name": "a", "max_opening": 0.1, "max_openning": 1}, "did you mean 'max_opening'"),
        ({"name": "a"}, "max_opening is missing"),
        ({"max_opening": 0.1}, "missing"),
        ({"name": "a", "max_opening": "wide"}, "expected a number"),
        ({"name": "a", "max_opening": True}, "expected a number"),
        ({"name": "a", "max_opening": float("nan")}, "expected a number"),
        ({"name": "a", "max_opening": 0.1, "palm": [1, 2]}, r"shape \(3,\)"),
        ({"name": 5, "max_opening": 0.1}, "expected a text"),
        ({"name": "a", "max_opening": 0.1, "symmetric": 1}, "true or false"),
        ({"name": "a", "max_opening": 0.1, "joints": "j"}, "list of names"),
        ({"name": "a", "max_opening": -0.1}, "openings"),
        ({"name": "a", "max_opening": 10**400}, "expected a number"),
        ({"name": "a", "max_opening": 0.1, "palm": [-1, 1, 1]}, "at least 0 m"),
        ({"name": "a", "max_opening": 0.1, "parent_from_gripper": [[0] * 4] * 4}, "rigid"),
    ],
)
def test_a_field_of_the_wrong_kind_is_named(data, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        gripper_from_data(data)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [("a.json", "{", "no JSON"), ("a.toml", "=", "no TOML"), ("a.json", "[1]", "an object"),
     ("a.json", '{"name": 1}', "a.json: "), ("a.json", "[" * 200_000, "no JSON")],
)  # fmt: skip
def test_a_file_that_is_none_is_named(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=words):
        read_gripper(tmp_path / name)
