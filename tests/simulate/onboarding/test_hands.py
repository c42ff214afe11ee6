"""Hands are found in a tree of links, and what was found is what is known of those hands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rtask.errors import RobotError
from simulate.motion.collision import link_poses
from simulate.onboarding.guess import guess_robot
from simulate.onboarding.hands import arm_ends, find_hands, hand_of
from simulate.robots import describe
from simulate.robots.attaching import jaw_gripper
from simulate.robots.description import RobotDescription
from simulate.robots.robot_files import bare_robot


def data(name: str) -> Path:
    import pybullet_data

    return Path(pybullet_data.getDataPath()) / name


def robot(name: str, **options) -> RobotDescription:
    return bare_robot(data(name), name="robot", **options)[0]


def test_the_hand_of_a_panda_is_found_as_it_was_written_by_hand():
    (hand,) = find_hands(robot("franka_panda/panda.urdf"))
    known = describe("panda").arm("panda_arm")
    assert (hand.wrist, [j.name for j in hand.joints]) == (known.wrist, list(known.joints))
    assert hand.stroke == pytest.approx(known.mouth, abs=0.002)
    np.testing.assert_allclose(hand.approach, known.approach, atol=1e-6)
    assert abs(np.dot(hand.closing, known.closing)) == pytest.approx(1.0, abs=1e-4)
    # The tool point is the tips' middle less 9 mm; that of the maker's hand is a little elsewhere.
    np.testing.assert_allclose(hand.tcp, known.tcp, atol=0.004)


def test_a_linkage_that_opens_at_its_lower_limit_is_found():
    (hand,) = find_hands(robot("xarm/xarm6_with_gripper.urdf"))
    assert len(hand.fingers) == 6
    assert set(hand.closed) == {0.85}
    assert set(hand.opened) == {0.0}
    assert hand.stroke == pytest.approx(0.087, abs=0.004)
    np.testing.assert_allclose(hand.approach, (0, 0, 1), atol=1e-6)


@pytest.mark.parametrize("stroke", [0.05, 0.085, 0.14])
def test_plain_jaws_are_measured_exactly(stroke):
    (hand,) = find_hands(robot("kuka_iiwa/model.urdf", gripper=f"jaw:{stroke}"))
    assert hand.stroke == pytest.approx(stroke, abs=1e-6)
    assert hand.wrist == "lbr_iiwa_link_7"
    assert len(hand.joints) == 7
    np.testing.assert_allclose(np.abs(hand.closing), (0, 1, 0), atol=1e-6)


def test_a_tree_of_legs_shows_no_hand_but_chains():
    legs = robot("a1/a1.urdf")
    assert find_hands(legs) == []
    assert len(arm_ends(legs)) == 4


def test_a_gripper_alone_is_a_hand_without_an_arm():
    jaws = jaw_gripper(0.08)
    alone = RobotDescription(
        name="jaws", root=jaws.root, links=jaws.links, joints=jaws.joints, arms={}, cameras={}
    )
    (hand,) = find_hands(alone)
    assert hand == hand_of(alone, "jaw_palm")
    assert (hand.joints, hand.stroke) == ((), pytest.approx(0.08))


def test_joints_held_still_keep_the_rest_where_it_was():
    whole = robot("kuka_iiwa/model.urdf")
    held = robot("kuka_iiwa/model.urdf", rest={"lbr_iiwa_joint_3": 0.4})
    names = [joint.name for joint in whole.joints]
    q = np.linspace(-0.5, 0.7, len(names))
    q[names.index("lbr_iiwa_joint_3")] = 0.4
    tip = "lbr_iiwa_link_7"
    first = _position(whole, tip, dict(zip(names, q, strict=True)))
    second = _position(held, tip, dict(zip(names, q, strict=True)))
    np.testing.assert_allclose(first, second, atol=1e-9)


def _position(description: RobotDescription, link: str, values: dict[str, float]) -> np.ndarray:
    return link_poses(description.root, description.joints, values)[link]


_INERTIAL = '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ' \
    'ixy="0" ixz="0" iyz="0"/></inertial>'  # fmt: skip


def write_two_fingers(path: Path, finger: str) -> Path:
    """Write an arm of three joints; on fixed links a propeller between two sliding fingers."""

    def link(name: str, shape: str = "") -> str:
        part = f"<collision><geometry>{shape}</geometry></collision>" if shape else ""
        return f'<link name="{name}">{_INERTIAL}{part}</link>'

    def joint(kind: str, parent: str, child: str, axis: str, xyz: str, rest: str = "") -> str:
        return (
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{axis}"/><origin xyz="{xyz}"/>{rest}</joint>'
        )

    turns = '<limit lower="-2" upper="2" velocity="1" effort="20"/>'
    slides = '<limit lower="{}" upper="{}" velocity="1" effort="10"/>'
    rod = '<cylinder radius="0.03" length="0.2"/>'
    parts = [
        link("base", rod), link("upper", rod), link("fore", rod), link("wrist", rod),
        link("bar"), link("prop", finger), link("left", finger), link("right", finger),
        joint("revolute", "base", "upper", "0 0 1", "0 0 0.1", turns),
        joint("revolute", "upper", "fore", "0 1 0", "0 0 0.3", turns),
        joint("revolute", "fore", "wrist", "1 0 0", "0.3 0 0", turns),
        joint("fixed", "wrist", "bar", "1 0 0", "0.05 0 0"),
        joint("continuous", "bar", "prop", "1 0 0", "0.0 0 0", turns),
        joint("prismatic", "bar", "left", "0 1 0", "0.1 0 0", slides.format(0.021, 0.057)),
        joint("prismatic", "bar", "right", "0 1 0", "0.1 0 0",
              slides.format(-0.057, -0.021) + '<mimic joint="to_left" multiplier="-1"/>'),
    ]  # fmt: skip
    path.write_text(f'<robot name="two">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def test_two_sliding_fingers_beside_a_propeller_are_a_hand(tmp_path):
    path = write_two_fingers(tmp_path / "two.urdf", '<box size="0.06 0.01 0.02"/>')
    (hand,) = find_hands(bare_robot(path, name="two")[0])
    assert [joint.name for joint in hand.fingers] == ["to_left", "to_right"]
    # Middles of the pads 2 * 57 mm apart, less the thickness of a pad.
    assert hand.stroke == pytest.approx(2 * 0.057 - 0.01, abs=1e-9)


def test_frozen_slides_that_follow_a_motor_without_limits_are_fingers(tmp_path):
    """Some files fix both fingers, name the propeller as their source, and give it no limits."""
    path = write_two_fingers(tmp_path / "two.urdf", '<box size="0.06 0.01 0.02"/>')
    text = path.read_text()
    for frozen in ("left", "right"):
        text = text.replace(
            f'name="to_{frozen}" type="prismatic"', f'name="to_{frozen}" type="fixed"'
        )
    text = text.replace('name="to_prop" type="continuous"', 'name="to_prop" type="revolute"')
    first, prop = text.split('name="to_prop"')
    text = first + 'name="to_prop"' + prop.replace('lower="-2" upper="2" ', "", 1)
    first, left = text.split('name="to_left"')
    source = '<mimic joint="to_prop" multiplier="-1" offset="0.021"/></joint>'
    path.write_text(first + 'name="to_left"' + left.replace("</joint>", source, 1))
    robot, warnings = bare_robot(path, name="two")
    kinds = {joint.name: joint.kind for joint in robot.joints}
    assert (kinds["to_left"], kinds["to_right"]) == ("prismatic", "prismatic")
    (hand,) = find_hands(robot)
    assert [joint.name for joint in hand.fingers] == ["to_left", "to_right"]
    assert hand.stroke == pytest.approx(2 * 0.057 - 0.01, abs=1e-6)
    says = "joint 'to_left' follows 'to_prop', which has no limits; moves by itself"
    assert says in warnings


def test_slides_on_one_motor_without_limits_stay_geared(tmp_path):
    """Of two that follow it, the second follows the first: at .01 and .02 m a radian, twice."""
    path = write_two_fingers(tmp_path / "two.urdf", '<box size="0.06 0.01 0.02"/>')
    first, right = path.read_text().split('<mimic joint="to_left" multiplier="-1"/>')
    first, left = first.split('name="to_left"')
    motor = '<mimic joint="to_prop" multiplier="{}" offset="{}"/>'
    left = left.replace("</joint>", motor.format(0.01, 0.03) + "</joint>", 1)
    path.write_text(f'{first}name="to_left"{left}{motor.format(-0.02, -0.05)}{right}')
    joints = {joint.name: joint for joint in bare_robot(path, name="two")[0].joints}
    assert joints["to_left"].mimic is None
    assert joints["to_right"].mimic == ("to_left", -2.0)
    assert joints["to_right"].mimic_offset == pytest.approx(-0.05 + 2 * 0.03)


def test_fingers_whose_meshes_are_not_there_are_named_with_the_mesh(tmp_path):
    path = write_two_fingers(tmp_path / "two.urdf", '<mesh filename="meshes/pad.stl"/>')
    with pytest.raises(RobotError) as refused:
        guess_robot(path, "two")
    says = str(refused.value)
    assert "prop, left, right may be fingers" in says
    assert "'meshes/pad.stl', which is not there" in says
    path = write_two_fingers(tmp_path / "two.urdf", "")
    with pytest.raises(RobotError, match="the file gives them none"):
        guess_robot(path, "two")
