"""Faults of a URDF that leave it readable: each is said before any search, or read as it is meant.

Every case is one change of the same whole robot, of which nothing is said.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from rtask.errors import RobotError
from simulate.onboarding import guess
from simulate.onboarding.commands import robot
from simulate.robots.mesh_files import load_mesh
from simulate.robots.robot_files import bare_robot
from simulate.robots.urdf_reader import read_urdf
from simulate.world.world import World

LENGTHS_M = (0.1, 0.17, 0.25, 0.2, 0.1, 0.08)
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
LINKS = ("base", "shoulder", "upper", "fore", "wrist", "roll", "palm")
FINGER_M = (0.02, 0.01, 0.06)


def _link(name: str, mass: float, size: float, shape: str, at: str) -> str:
    moment = mass * size * size / 6
    parts = "".join(
        f'<{kind}><origin xyz="{at}"/><geometry>{shape}</geometry></{kind}>'
        for kind in ("visual", "collision")
    )
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 0.05"/><mass value="{mass}"/>'
        f'<inertia ixx="{moment:.6f}" iyy="{moment:.6f}" izz="{moment:.6f}" ixy="0" ixz="0" '
        f'iyz="0"/></inertial>{parts}</link>'
    )


def _joint(name: str, kind: str, ends: tuple[str, str], up: float, axis: str, limit: str) -> str:
    parent, child = ends
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {up}" rpy="0 0 0"/><axis xyz="{axis}"/><limit {limit}/></joint>'
    )


def whole_robot() -> str:
    """Return an arm of six joints with two fingers, the second of which follows."""
    parts = [_link("base", 4, 0.1, '<box size="0.1 0.1 0.1"/>', "0 0 0.05")]
    for i, (axis, up) in enumerate(zip(AXES, LENGTHS_M, strict=True)):
        shape = '<box size="0.05 0.05 0.06"/>' if i < 5 else '<box size="0.04 0.08 0.04"/>'
        parts += [
            _link(LINKS[i + 1], 1 if i < 5 else 0.5, 0.08, shape, "0 0 0.03"),
            _joint(f"j{i}", "revolute", LINKS[i : i + 2], up, axis,
                   'lower="-2.5" upper="2.5" velocity="2" effort="60"'),
        ]  # fmt: skip
    for side, sign in (("left", 1), ("right", -1)):
        finger = _link(f"{side}_finger", 0.05, 0.02, '<mesh filename="finger.stl"/>',
                       f"0 {sign * 0.005} 0.03")  # fmt: skip
        limit = 'lower="0" upper="0.04" velocity="0.2" effort="20"'
        ends = ("palm", f"{side}_finger")
        slide = _joint(f"{side}_slide", "prismatic", ends, 0.04, f"0 {sign} 0", limit)
        if side == "right":
            slide = slide.replace("</joint>", '<mimic joint="left_slide" multiplier="1"/></joint>')
        parts += [finger, slide]
    return f'<robot name="arm">{"".join(parts)}</robot>'


def write(folder: Path, text: str) -> Path:
    trimesh.creation.box(FINGER_M).export(folder / "finger.stl")
    trimesh.creation.box((100, 100, 100)).export(folder / "base_mm.stl")
    flat = trimesh.creation.box(FINGER_M)
    flat.vertices[:, 1] = 0.0
    flat.export(folder / "flat.stl")
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


BASE_BOX = '<geometry><box size="0.1 0.1 0.1"/></geometry>'
CASES = {
    "a base in millimetres": (
        BASE_BOX, '<geometry><mesh filename="base_mm.stl"/></geometry>',
        "'base', which does not move, is 100 m large on a robot that spans 0.98 m: millimetres?",
    ),
    "pads of nothing": (
        'filename="finger.stl"', 'filename="finger.stl" scale=".001 .001 .001"',
        "'left_finger' is 0.06 mm large on a robot that spans 0.98 m: a scale too much?",
    ),
    "a finger in inches": (
        'filename="finger.stl"', 'filename="finger.stl" scale="39.4 39.4 39.4"',
        "'left_finger' is 2.36 m large on a robot that spans 0.98 m: centimetres or inches?",
    ),
    "few degrees": (
        'lower="-2.5" upper="2.5"', 'lower="-10" upper="10"',
        "'j0' turns from -10 to 10 rad: degrees?",
    ),
    "an origin turned by few degrees": (
        'xyz="0 0 0.25" rpy="0 0 0"', 'xyz="0 0 0.25" rpy="0 0 5"', "has the rpy 0 0 5 rad",
    ),
    "a slide in centimetres": (
        'upper="0.04"', 'upper="4"', "'left_slide' slides by 4 m at the end of an arm of 0.9 m",
    ),
    "one origin in centimetres": (
        "0 0 0.25", "0 0 25", "'j2' lies 25 m from its parent, all others of its chain 0.27 m",
    ),
    "a still link of negative mass": ('mass value="4"', 'mass value="-4"', "weighs -4 kg"),
    "moments in g mm2": ('ixx="0.001067"', 'ixx="1.067e-12"', ""),
    "an effort in thousandths": (
        'effort="60"', 'effort="60000"', "'j0' (and 5 more) has an effort of 60000 N m",
    ),
    "a finger without force": ('effort="20"', 'effort=".0001"', "which moves nothing"),
    "a joint that stands": ('velocity="2"', 'velocity=".0001"', "takes many minutes"),
    "a follower of the wrong sign": (
        'multiplier="1"', 'multiplier="-1"',
        "'right_slide' follows 'left_slide' from -0.04 to 0, outside of its limits 0 .. 0.04",
    ),
    "an offset in millimetres": (
        'multiplier="1"', 'multiplier="1" offset="40"', "from 40 to 40, outside of its limits",
    ),
    "a base that is only seen": (
        f'<collision><origin xyz="0 0 0.05"/>{BASE_BOX}</collision>', "",
        "link 'base' stands still, and neither it nor what is fixed to it has a collision shape",
    ),
    "two origins": (
        '<origin xyz="0 0 0.25" rpy="0 0 0"/>', '<origin xyz="0 0 0.25"/><origin xyz="0 0 0.9"/>',
        "joint 'j2' has 2 <origin>; the first is taken",
    ),
    "a misspelt origin": (
        '<origin xyz="0 0 0.25"', '<origin xzy="0 0 0.25"',
        "joint 'j2' has an <origin> with 'xzy' and without 'xyz': misspelt?",
    ),
    "a misspelt limit": ('upper="2.5"', 'uper="2.5"', "with 'uper' and without 'upper'"),
    "one limit alone": (
        'lower="-2.5" upper="2.5"', 'lower="-2.5"', "'j0' states lower and no upper limit",
    ),
    "a joint without a parent": (
        "</robot>", '<joint name="loose" type="fixed"><child link="palm"/></joint></robot>',
        "joint 'loose' has no parent; left out",
    ),
    "a joint without a name": ('name="j2" ', "", "a joint has no name"),
    "softer limits": (
        'effort="60"/>', 'effort="60"/><safety_controller soft_lower_limit="-.5" '
        'soft_upper_limit=".5"/>', "kept within -0.5 .. 0.5 by its safety_controller",
    ),
    "an axis as an attribute": (
        'name="j2" type', 'name="j2" axis="0 1 0" type', "joint 'j2' has an attribute 'axis'",
    ),
    "an axis within an origin": (
        'xyz="0 0 0.25" rpy="0 0 0"/><axis xyz="0 1 0"/>',
        'xyz="0 0 0.25" rpy="0 0 0"><axis xyz="0 1 0"/></origin>',
        "joint 'j2' has <axis> in <origin>",
    ),
    "a misspelt element": (
        '<mimic joint="left_slide"', '<mimics joint="left_slide"',
        "joint 'right_slide' has <mimics> and no <mimic>: misspelt?",
    ),
    "flat fingers": (
        'filename="finger.stl"', 'filename="flat.stl"', "has a shape without thickness",
    ),
    "axes all one way": (
        '<axis xyz="0 1 0"/><limit lower="-2.5"', '<axis xyz="0 0 1"/><limit lower="-2.5"',
        "the 6 joints j0, j1, j2, j3, j4, j5 all turn about one direction",
    ),
    "a centre of mass of elsewhere": (
        '<origin xyz="0 0 0.05"/><mass value="1"/>', '<origin xyz="0 0.8 0"/><mass value="1"/>',
        "'shoulder' has its centre of mass 0.775 m outside of its shape",
    ),
}  # fmt: skip


def test_nothing_is_said_of_the_whole_robot(tmp_path):
    assert bare_robot(write(tmp_path, whole_robot()), name="arm")[1] == ()


@pytest.mark.parametrize("case", CASES)
def test_each_fault_is_said_by_the_reader_alone(tmp_path, case):
    before, after, says = CASES[case]
    text = whole_robot()
    assert before in text
    changed = text.replace(before, after)
    if case == "moments in g mm2":
        changed = re.sub(r'(i..)="(0\.0[0-9]+)"', lambda m: f'{m[1]}="{m[2]}e-9"', text)
        says = "g mm2?"
    warnings = bare_robot(write(tmp_path, changed), name="arm")[1]
    assert [warning for warning in warnings if says in warning], warnings


def test_vertices_that_are_no_numbers_and_pointers_are_named(tmp_path):
    path = write(tmp_path, whole_robot())
    mesh = tmp_path / "finger.stl"
    content = bytearray(mesh.read_bytes())
    content[96:100] = struct.pack("<f", float("nan"))
    mesh.write_bytes(content)
    assert "vertices that are no numbers" in read_urdf(path, strict=False).warnings[0]
    mesh.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    assert "git lfs pull" in read_urdf(path, strict=False).warnings[0]


@pytest.mark.parametrize("written", ["meshes\\finger.stl", "package://arm\\meshes\\finger.stl"])
def test_paths_of_windows_are_read(tmp_path, written):
    folder = tmp_path / "arm"
    (folder / "meshes").mkdir(parents=True)
    path = write(folder, whole_robot().replace("finger.stl", written))
    (folder / "finger.stl").rename(folder / "meshes" / "finger.stl")
    assert read_urdf(path).warnings == ()


def test_a_document_with_a_namespace_is_read(tmp_path):
    text = whole_robot().replace("<robot ", '<robot xmlns="http://www.ros.org" ')
    assert len(read_urdf(write(tmp_path, text)).joints) == 8


@pytest.mark.parametrize("unit", ["0.01", "1"])
def test_a_collada_mesh_is_as_large_as_its_unit_says(tmp_path, unit):
    """The physics engine multiplies by the unit; planning saw another robot until it did, too."""
    import pybullet

    path = tmp_path / f"unit{unit}.dae"
    trimesh.creation.box((2, 1, 6)).export(path)
    text = re.sub(r"(<created>)", rf'<unit name="u" meter="{unit}"/>\1', path.read_text(), count=1)
    path.write_text(text)
    size = np.ptp(np.asarray(load_mesh(path).vertices), axis=0)
    assert size == pytest.approx(float(unit) * np.array([2, 1, 6]))
    urdf = tmp_path / f"unit{unit}.urdf"
    urdf.write_text(
        f'<robot name="a"><link name="a"><collision><geometry><mesh filename="{path}"/></geometry>'
        "</collision></link></robot>"
    )
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(urdf), physicsClientId=client)
        low, high = pybullet.getAABB(body, physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    assert np.subtract(high, low) == pytest.approx(size, abs=0.01)


@pytest.mark.parametrize("format", ["stl_ascii", "stl", "ply", "glb", "off", "obj"])
def test_every_mesh_that_planning_reads_has_its_size_in_physics_too(tmp_path, format):
    """The engine made a shape of no size of an STL in text, and refused robots with a PLY."""
    mesh = trimesh.creation.box(FINGER_M)
    path = tmp_path / f"pad.{format.partition('_')[0]}"
    mesh.export(path, file_type=format)
    text = whole_robot().replace('filename="finger.stl"', f'filename="{path.name}"')
    read, _ = bare_robot(write(tmp_path, text), name="arm")
    with World("fast") as world:
        body = world.load_urdf(read, np.eye(4))
        client = world.client
        names = [
            client.getJointInfo(body, k)[12].decode() for k in range(client.getNumJoints(body))
        ]
        low, high = client.getAABB(body, names.index("left_finger"))
    assert np.subtract(high, low) == pytest.approx(FINGER_M, abs=0.012)
    assert min(np.subtract(high, low)) > 0.009


def test_faults_are_said_before_a_search_that_fails(tmp_path, monkeypatch):
    def search(*_: object) -> None:
        raise RobotError("arm: no posture is free of collisions")

    monkeypatch.setattr(guess, "place_robot", search)
    monkeypatch.setenv("RTASK_ROBOTS", str(tmp_path / "robots"))
    path = write(tmp_path, whole_robot().replace('lower="-2.5"', 'lower="-143"'))
    done = CliRunner().invoke(robot, ["add", str(path), "--name", "mine"])
    assert "no posture" in str(done.exception)
    assert "; of the file: joint 'j0' turns from -143" in str(done.exception)
    assert "(and 5 more)" in str(done.exception)
    assert done.stderr.startswith("warning: joint 'j0' turns from -143")
