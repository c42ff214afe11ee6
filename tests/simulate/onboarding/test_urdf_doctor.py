"""Numbers of a URDF that cannot be meant as written are named before any work begins."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rtask.errors import RobotError
from simulate.onboarding import guess
from simulate.robots.description import Pose, Shape
from simulate.robots.mass import estimated_inertial
from simulate.robots.robot_files import bare_robot
from simulate.robots.urdf_reader import read_urdf

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
LIMIT = '<limit lower="{}" upper="{}" velocity="2" effort="3"/>'
TRIANGLES = (
    "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex {0} 0 0\nvertex 0 {0} 0\n"
    "endloop\nendfacet\nfacet normal 0 1 0\nouter loop\nvertex 0 0 0\nvertex {0} 0 0\n"
    "vertex 0 0 {0}\nendloop\nendfacet\nendsolid x\n"
)


def box(size: str) -> str:
    return f'<collision><geometry><box size="{size}"/></geometry></collision>'


def arm(
    folder: Path, shape: str = "", limit: tuple[float, float] = (-1, 1), rest: str = ""
) -> Path:
    """Write three links in a row, 0.3 m apart; the last has a shape, the last joint the rest."""
    names = ("base", "upper", "fore")
    links = "".join(
        f'<link name="{name}">{INERTIAL}{shape if name == "fore" else ""}</link>' for name in names
    )
    joints = "".join(
        f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>{LIMIT.format(*limit)}'
        f"{rest if child == 'fore' else ''}</joint>"
        for parent, child in pairwise(names)
    )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{links}{joints}</robot>')
    return path


@pytest.fixture
def no_search(monkeypatch):
    """Fail as soon as the search for a workplace begins."""

    def search(*_: object) -> None:
        raise AssertionError("the search began")

    monkeypatch.setattr(guess, "place_robot", search)


@pytest.mark.parametrize("shape", ["box", "mesh"])
def test_shapes_in_millimetres_are_named_before_the_search(tmp_path, no_search, shape):
    (tmp_path / "pad.stl").write_text(TRIANGLES.format(40))
    mesh = '<collision><geometry><mesh filename="pad.stl"/></geometry></collision>'
    path = arm(tmp_path, box("40 10 20") if shape == "box" else mesh)
    says = "link 'fore' is 40 m large on a robot that spans 0.6 m: millimetres? --scale 0.001"
    with pytest.raises(RobotError, match=re.escape(says)):
        guess.guess_robot(path, "arm")
    assert any(says in warning for warning in bare_robot(path, name="arm")[1])
    robot, warnings = bare_robot(path, name="arm", scale=0.001)
    assert warnings == ()
    assert max(robot.link("fore").shapes[0].size) == pytest.approx(
        0.04 if shape == "box" else 0.001
    )


def test_a_scale_that_nothing_needs_or_that_is_none_is_refused(tmp_path):
    path = arm(tmp_path, box("0.04 0.01 0.02"))
    with pytest.raises(RobotError, match="there are none"):
        bare_robot(path, name="arm", scale=0.001)
    with pytest.raises(RobotError, match="positive number"):
        bare_robot(path, name="arm", scale=float("nan"))


def test_joints_in_millimetres_are_refused(tmp_path):
    path = arm(tmp_path)
    path.write_text(path.read_text().replace("0 0 0.3", "0 0 300"))
    with pytest.raises(RobotError, match="span 600 m: a URDF states lengths in m"):
        bare_robot(path, name="arm")


def test_a_floor_that_does_not_move_is_no_shape_in_millimetres(tmp_path):
    path = arm(tmp_path)
    floor = f'<link name="base">{INERTIAL}{box("100 100 0.1")}'
    path.write_text(path.read_text().replace(f'<link name="base">{INERTIAL}', floor))
    assert bare_robot(path, name="arm")[1] == ()


def test_limits_in_degrees_are_doubted_and_full_turns_are_not(tmp_path):
    warnings = read_urdf(arm(tmp_path, limit=(-143, 143))).warnings
    assert len(warnings) == 2
    assert "'to_upper' turns from -143 to 143 rad: degrees?" in warnings[0]
    assert "-2.5 and 2.5" in warnings[0]
    assert read_urdf(arm(tmp_path, limit=(-6.2832, 6.2832))).warnings == ()


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("nobody", "follows 'nobody', which is no joint of the file"),
        ("to_fore", "follows 'to_fore', which follows it in turn"),
        ("stiff", "follows 'stiff', which does not move"),
    ],
)
def test_a_joint_that_can_follow_none_moves_by_itself(tmp_path, source, says):
    path = arm(tmp_path, rest=f'<mimic joint="{source}" multiplier="-1"/>')
    stiff = (
        f'<link name="cap">{INERTIAL}</link><joint name="stiff" type="fixed">'
        '<parent link="base"/><child link="cap"/></joint></robot>'
    )
    path.write_text(path.read_text().replace("</robot>", stiff))
    read = read_urdf(path, strict=False)
    assert read.warnings == (f"joint 'to_fore' {says}; moves by itself",)
    assert all(joint.mimic is None for joint in read.joints)
    with pytest.raises(RobotError, match=re.escape(says)):
        read_urdf(path)


@pytest.mark.parametrize("written", ["package://my_arm/pad%20a.stl", "pad%20a.stl", "pad a.stl"])
def test_mesh_paths_are_decoded(tmp_path, written):
    folder = tmp_path / "my_arm"
    folder.mkdir()
    (folder / "pad a.stl").write_text(TRIANGLES.format(0.04))
    mesh = f'<collision><geometry><mesh filename="{written}"/></geometry></collision>'
    read = read_urdf(arm(folder, mesh))
    assert [Path(s.path).name for link in read.links for s in link.shapes] == ["pad a.stl"]


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="0 0 0"/>', '<box size="0.1 0.1 -0.1"/>', '<sphere radius="0"/>',
        '<cylinder radius="0.1" length="0"/>', '<mesh filename="a.stl" scale="0 0 0"/>',
    ],
)  # fmt: skip
def test_shapes_without_volume_are_left_out_and_masses_stay_numbers(tmp_path, shape):
    path = arm(tmp_path, f"<collision><geometry>{shape}</geometry></collision>")
    path.write_text(path.read_text().replace(f'<link name="fore">{INERTIAL}', '<link name="fore">'))
    read = read_urdf(path, strict=False)
    assert "left out" in read.warnings[0]
    (fore,) = (link for link in read.links if link.name == "fore")
    assert fore.shapes == ()
    assert np.isfinite(fore.inertial.mass)
    assert np.isfinite(fore.inertial.tensor).all()


def test_space_that_shapes_share_weighs_once():
    cube = Shape("box", (0.1, 0.1, 0.1))
    half = Shape("box", (0.1, 0.1, 0.1), Pose((0.05, 0.0, 0.0)))
    apart = Shape("box", (0.1, 0.1, 0.1), Pose((0.3, 0.0, 0.0)))
    assert estimated_inertial([cube, cube]).mass == pytest.approx(1.0)
    assert estimated_inertial([cube, half]).mass == pytest.approx(1.5)
    assert estimated_inertial([cube, apart]).mass == pytest.approx(2.0)
    joined = estimated_inertial([cube, half])
    assert joined.centre[0] == pytest.approx(0.025, abs=0.01)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('xyz="0 0 0.3"/>', 'xyz="0 0 0.3" rpy="0 90 0"/>'), "has the rpy 0 90 0 rad: degrees?"),
        (('mass value="1"', 'mass value="850"'), "weighs 850 kg, 1 kg if its shape were of water"),
        (('izz=".1"', 'izz="900"'), "no body has the principal moments"),
        (('ixx=".1" iyy=".1" izz', 'ixx="900" iyy="900" izz'), "many metres wide: kg mm2?"),
        (('lower="-1" upper="1"', 'lower="-inf" upper="inf"'), "limits without end; taken as +-pi"),
    ],
)  # fmt: skip
def test_turns_masses_moments_and_limits_in_other_units_are_doubted(tmp_path, change, says):
    path = arm(tmp_path, shape=box("0.1 0.1 0.1"))
    assert not [word for word in bare_robot(path, name="arm")[1] if says in word]
    path.write_text(path.read_text().replace(*change))
    robot, warnings = bare_robot(path, name="arm")
    assert [word for word in warnings if says in word], warnings
    assert all(np.isfinite([joint.lower, joint.upper]).all() for joint in robot.joints)


def test_a_wrong_inertia_is_replaced_by_that_of_the_shape(tmp_path):
    path = arm(tmp_path, shape=box("0.1 0.1 0.1"))
    path.write_text(
        path.read_text().replace('ixx=".1" iyy=".1" izz=".1"', 'ixx="9e2" iyy="9e2" izz="9e2"')
    )
    fore = next(link for link in read_urdf(path, strict=False).links if link.name == "fore")
    assert fore.inertial.mass == 1.0
    assert max(fore.inertial.diagonal) < 0.01


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('name="to_fore"', 'name="to_upper"'), "two joints are called 'to_upper'"),
        (('xyz="0 0 0.3"', 'xyz="0 0 0,3"'), "'0 0 0,3' has decimal commas; URDF writes 0.5"),
        (('xyz="0 0 0.3"', 'xyz="0 0 ${len}"'), "is not three numbers; expand it first: xacro"),
        (('upper="1"', 'upper="${max}"'), "is not a number; expand it first: xacro"),
    ],
)  # fmt: skip
def test_what_would_end_the_process_or_be_read_as_something_else_is_refused(tmp_path, change, says):
    path = arm(tmp_path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(RobotError) as told:
        bare_robot(path, name="arm")
    assert says in str(told.value)


@pytest.mark.parametrize(("shape", "reads"), [("", True), (box("1 1 1"), False)])
def test_ways_of_a_base_that_drives_are_no_lengths_of_the_robot(tmp_path, shape, reads):
    """Files of mobile robots and floating hands slide a link without a shape by +-20 m first."""
    path = arm(tmp_path, box("0.1 0.1 0.1"))
    slide = "".join(
        f'<joint name="{a}" type="prismatic"><parent link="{a}"/><child link="{b}"/>'
        f'<axis xyz="1 0 0"/>{LIMIT.format(-20, 20)}</joint>'
        for a, b in (("world", "along"), ("along", "base"))
    )
    world = f'<link name="world">{shape}</link><link name="along"/>'
    path.write_text(path.read_text().replace("</robot>", f"{world}{slide}</robot>"))
    if reads:
        assert len(bare_robot(path, name="arm")[0].joints) == 4
        return
    with pytest.raises(RobotError, match=r"span 80\.6 m: a URDF states lengths in m"):
        bare_robot(path, name="arm")


@pytest.mark.parametrize("strict", [False, True])
def test_a_frozen_joint_that_states_whom_it_follows_moves_with_it(tmp_path, strict):
    """Reduced models fix the joints of linkages for libraries that know none that follow."""
    path = arm(tmp_path, box("0.1 0.1 0.1"), rest='<mimic joint="to_upper" multiplier="-1"/>')
    first, fixed = path.read_text().split('name="to_fore" type="revolute"')
    path.write_text(f'{first}name="to_fore" type="fixed"{fixed}')
    read = read_urdf(path, strict=strict)
    fore = next(joint for joint in read.joints if joint.name == "to_fore")
    assert fore.kind == ("fixed" if strict else "revolute")
    assert fore.mimic == (None if strict else ("to_upper", -1.0))
    says = "joint 'to_fore' is fixed, but follows 'to_upper'; moves with it"
    assert (says in read.warnings) is not strict


def test_a_fixed_joint_without_a_range_stays_fixed(tmp_path):
    path = arm(tmp_path, box("0.1 0.1 0.1"), (0, 0), rest='<mimic joint="to_upper"/>')
    first, fixed = path.read_text().split('name="to_fore" type="revolute"')
    path.write_text(f'{first}name="to_fore" type="fixed"{fixed}')
    assert {j.name: j.kind for j in read_urdf(path).joints}["to_fore"] == "fixed"


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ('lower="-1" upper="1"', 'lower="0" upper="0"', "0 .. 0: it cannot move"),
        ('velocity="2"', 'velocity="180"', "180 rad/s: degrees? (that would be 3.14)"),
        ("<inertial>", '<inertial><origin xyz="120 0 0"/>', "centre of mass 120 m beside it"),
        ("<collision>", '<collision><origin xyz="0 0 150"/>', "its shape 150 m beside it"),
        ("<collision>", '<collision><origin rpy="0 90 0"/>', "turned by more than a turn"),
        (".04 .04 .04", "4 4 4", "4 m large on a robot that spans 0.6 m: centimetres or inches?"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 2 0"/>', "an axis of length 2; taken as 1"),
        ("</robot>", '<robot name="other"/></robot>', "<robot name='other'> inside: left out"),
    ],
)
def test_what_cannot_be_meant_is_read_as_it_stands_and_said(tmp_path, before, after, says):
    path = arm(tmp_path, box(".04 .04 .04"))
    assert not read_urdf(path).warnings
    path.write_text(path.read_text().replace(before, after))
    assert any(says in warning for warning in read_urdf(path).warnings)


@pytest.mark.parametrize(
    ("mimic", "says"),
    [
        ('multiplier="0"', "by a multiplier of 0: it stands still"),
        ('multiplier="1" offset="90"', "an offset of 90 rad: degrees?"),
        ('multiplier="57.3"', "leads far out of its limits -1 .. 1"),
    ],
)
def test_a_follower_that_follows_as_none_can_is_said(tmp_path, mimic, says):
    path = arm(tmp_path, rest=f'<mimic joint="to_upper" {mimic}/>')
    assert any(says in warning for warning in read_urdf(path).warnings)


def test_a_slide_along_a_longer_axis_goes_as_far_as_it_says(tmp_path):
    path = arm(tmp_path)
    text = path.read_text().replace('type="revolute"', 'type="prismatic"')
    path.write_text(text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 2 0"/>'))
    assert {joint.axis for joint in read_urdf(path).joints} == {(0.0, 1.0, 0.0)}


def test_a_slide_in_millimetres_is_said(tmp_path):
    path = arm(tmp_path, limit=(0, 40))
    path.write_text(path.read_text().replace('type="revolute"', 'type="prismatic"'))
    warnings = read_urdf(path).warnings
    assert any("slides from 0 to 40 m: millimetres?" in warning for warning in warnings)
