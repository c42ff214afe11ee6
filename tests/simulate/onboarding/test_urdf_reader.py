"""URDF files with gaps are read, and say what was put in; strict reading refuses them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rtask.errors import RobotError
from simulate.onboarding.survey import survey_files
from simulate.robots.srdf import read_srdf
from simulate.robots.urdf_reader import read_urdf

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="3"/>'
ENDS = '<parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>'
BOX = '<collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>'


def urdf(folder: Path, tip: str = INERTIAL, joint: str = ENDS + LIMIT, kind: str = "revolute"):
    path = folder / "robot.urdf"
    path.write_text(
        f'<robot name="r"><link name="base"/><link name="tip">{tip}</link>'
        f'<joint name="turn" type="{kind}">{joint}</joint></robot>'
    )
    return path


def test_a_whole_file_gives_no_warning(tmp_path):
    read = read_urdf(urdf(tmp_path))
    assert read == read_urdf(urdf(tmp_path), strict=False)
    assert read.warnings == ()
    assert (read.joints[0].lower, read.joints[0].velocity, read.joints[0].effort) == (-1, 2, 3)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"tip": BOX}, "no <inertial>"),
        ({"tip": BOX + '<inertial><mass value="0"/></inertial>'}, "weighs 0 kg"),
        ({"tip": BOX + '<inertial><mass value="2"/></inertial>'}, "no <inertia>"),
        ({"tip": BOX + INERTIAL.replace('izz=".1"', 'izz="9"')}, "impossible inertia"),
        ({"joint": ENDS}, "no <limit>"),
        ({"joint": ENDS + LIMIT, "kind": "continuous"}, "'continuous'"),
        ({"joint": ENDS + LIMIT, "kind": "floating"}, "'floating'"),
        ({"joint": ENDS + LIMIT, "kind": "planar"}, "'planar'"),
        ({"joint": ENDS.replace("0 0 1", "0 0 0") + LIMIT}, "axis 0 0 0"),
        ({"joint": ENDS + LIMIT.replace('lower="-1"', 'lower="4"')}, "limits 4 .. 1"),
        (
            {
                "tip": INERTIAL
                + '<collision><geometry><mesh filename="no.stl"/></geometry></collision>'
            },
            "'no.stl', which is not there",
        ),
        (
            {"tip": INERTIAL + "<collision><geometry><cone/></geometry></collision>"},
            "a shape of 'cone'",
        ),
    ],
)
def test_each_gap_is_filled_with_a_warning_or_refused(tmp_path, change, says):
    path = urdf(tmp_path, **change)
    read = read_urdf(path, strict=False)
    assert says in read.warnings[0]
    with pytest.raises(RobotError) as refused:
        read_urdf(path)
    assert says in str(refused.value)
    assert str(path) in str(refused.value)
    tip = next(link for link in read.links if link.name == "tip")
    if read.joints[0].kind != "fixed":
        assert tip.inertial.mass > 0
        moments = np.linalg.eigvalsh(tip.inertial.tensor)
        assert 0 < moments[2] <= moments[0] + moments[1] + 1e-12
        assert read.joints[0].lower <= read.joints[0].upper


def test_an_estimated_mass_is_that_of_water_of_the_same_shape(tmp_path):
    read = read_urdf(urdf(tmp_path, tip=BOX), strict=False)
    inertial = read.links[1].inertial
    assert inertial.mass == pytest.approx(6.0)
    assert inertial.diagonal[0] == pytest.approx(6.0 * (0.2**2 + 0.3**2) / 12)


def test_joints_without_speed_or_effort_get_the_documented_ones(tmp_path):
    limit = '<limit lower="-1" upper="1"/>'
    joint = read_urdf(urdf(tmp_path, joint=ENDS + limit), strict=False).joints[0]
    assert (joint.velocity, joint.effort) == (1.0, 100.0)
    endless = read_urdf(urdf(tmp_path, joint=ENDS, kind="continuous"), strict=False).joints[0]
    assert (endless.kind, endless.lower, endless.upper) == ("revolute", -math.pi, math.pi)


def test_documents_of_common_writers_that_are_not_quite_xml_are_read(tmp_path):
    text = urdf(tmp_path).read_text()
    (tmp_path / "late.urdf").write_text(f'<!-- by a tool -->\n<?xml version="1.0"?>{text}')
    (tmp_path / "prefix.urdf").write_text(text.replace("<limit ", '<limit drake:speed="1" '))
    for name in ("late.urdf", "prefix.urdf"):
        assert len(read_urdf(tmp_path / name, strict=False).joints) == 1
        with pytest.raises(RobotError, match="not XML"):
            read_urdf(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "not XML"),
        ("<sdf/>", "expected <robot>"),
        ('<robot><link name="a"/><link name="b"/></robot>', "one root link"),
        ('<robot><link name="a"/><link name="a"/></robot>', "two links"),
    ],
)
def test_what_cannot_be_a_robot_is_an_error(tmp_path, text, says):
    (tmp_path / "x.urdf").write_text(text)
    with pytest.raises(RobotError, match=says):
        read_urdf(tmp_path / "x.urdf", strict=False)


@pytest.mark.parametrize("encoding", ["no-such", "utf-7", "base64", "idna"])
@pytest.mark.parametrize("read", [read_urdf, read_srdf])
def test_a_document_whose_encoding_cannot_be_read_is_an_error(tmp_path, read, encoding):
    (tmp_path / "x.urdf").write_text(f'<?xml version="1.0" encoding="{encoding}"?><robot/>')
    with pytest.raises(RobotError, match="not XML"):
        read(tmp_path / "x.urdf")


def test_rings_and_lost_links_are_errors(tmp_path):
    joint = '<joint name="{0}" type="fixed"><parent link="{1}"/><child link="{2}"/></joint>'
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    ring = joint.format("j", "b", "c") + joint.format("k", "c", "b")
    (tmp_path / "ring.urdf").write_text(f"<robot>{links}{ring}</robot>")
    with pytest.raises(RobotError, match="hangs on itself"):
        read_urdf(tmp_path / "ring.urdf", strict=False)
    twice = joint.format("j", "a", "c") + joint.format("k", "b", "c") + joint.format("l", "a", "b")
    (tmp_path / "twice.urdf").write_text(f"<robot>{links}{twice}</robot>")
    with pytest.raises(RobotError, match="hangs on two joints"):
        read_urdf(tmp_path / "twice.urdf", strict=False)


def test_joints_come_parents_first_whatever_the_order_in_the_file(tmp_path):
    joint = '<joint name="{0}" type="fixed"><parent link="{1}"/><child link="{2}"/></joint>'
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    text = joint.format("second", "b", "c") + joint.format("first", "a", "b")
    (tmp_path / "x.urdf").write_text(f"<robot>{links}{text}</robot>")
    assert [j.name for j in read_urdf(tmp_path / "x.urdf").joints] == ["first", "second"]


def test_meshes_of_packages_are_searched_upwards_and_in_the_ros_path(tmp_path, monkeypatch):
    (tmp_path / "arm_description" / "urdf").mkdir(parents=True)
    (tmp_path / "elsewhere" / "other_description").mkdir(parents=True)
    stl = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    stl += "endloop\nendfacet\nendsolid x\n"
    (tmp_path / "arm_description" / "a.stl").write_text(stl)
    (tmp_path / "elsewhere" / "other_description" / "b.stl").write_text(stl)
    for package, name in (("arm_description", "a.stl"), ("other_description", "b.stl")):
        mesh = f'<collision><geometry><mesh filename="package://{package}/{name}"/>'
        path = urdf(
            tmp_path / "arm_description" / "urdf", f"{INERTIAL}{mesh}</geometry></collision>"
        )
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
        (shape,) = read_urdf(path).links[1].shapes
        assert shape.path.endswith(f"{package}/{name}")


def test_of_the_robots_that_pybullet_brings_nine_in_ten_are_read():
    import pybullet_data

    folder = Path(pybullet_data.getDataPath())
    files = [p for p in sorted(folder.rglob("*.urdf")) if "random_urdfs" not in p.parts]
    rows = list(survey_files(files))
    assert len(rows) >= 90
    read = [row for row in rows if not row.error]
    assert len(read) >= 0.9 * len(rows)
    assert all(str(folder) in row.error for row in rows if row.error)
