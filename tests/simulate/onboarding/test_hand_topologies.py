"""Hands of every build are recognised in generated URDF files, and what is no hand is not."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import trimesh

from rtask.errors import RobotError
from simulate.onboarding.guess import NoHandError, guess_robot
from simulate.onboarding.hands import find_hands, hand_between
from simulate.robots.robot_files import bare_robot


@dataclass
class Builder:
    """A URDF of boxes, joint by joint."""

    parts: list[str] = field(default_factory=list)

    def link(self, name: str, *boxes: tuple[str, str], kind: str = "collision") -> Builder:
        """Add a link with boxes: size and middle, m."""
        shapes = "".join(
            f'<{kind}><origin xyz="{middle}"/><geometry><box size="{size}"/></geometry></{kind}>'
            for size, middle in boxes
        )
        self.parts.append(f'<link name="{name}">{shapes}</link>')
        return self

    def joint(
        self, parent: str, child: str, at: str, axis: str, low: float, high: float,
        kind: str = "revolute", mimic: str = "", name: str = "",
    ) -> Builder:  # fmt: skip
        """Add a joint called after its child, or ``name``."""
        follows = f"<mimic {mimic}/>" if mimic else ""
        self.parts.append(
            f'<joint name="{name or f"{child}_joint"}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{at}"/><axis xyz="{axis}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="2" effort="20"/>{follows}</joint>'
        )
        return self

    def arm(self, count: int = 4) -> Builder:
        """Add ``count`` joints that end in the link ``a<count>``, along z."""
        self.link("a0", ("0.1 0.1 0.1", "0 0 0.05"))
        axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
        for i in range(count):
            if i + 1 < count:  # the last link is the hand's
                self.link(f"a{i + 1}", ("0.04 0.04 0.16", "0 0 0.08"))
            self.joint(f"a{i}", f"a{i + 1}", "0 0 0.17", axes[i], -2.5, 2.5)
        return self

    def write(self, folder: Path, name: str = "robot") -> Path:
        """Write the file."""
        path = folder / f"{name}.urdf"
        path.write_text(f'<robot name="{name}">{"".join(self.parts)}</robot>', "utf-8")
        return path


def found(folder: Path, built: Builder, name: str = "robot"):
    return find_hands(bare_robot(built.write(folder, name), name=name)[0])


PALM = ("0.05 0.08 0.05", "0 0 0.025")


def turning_jaw(wrist: str) -> Builder:
    """A jaw that turns about x against a plate that is part of the wrist link."""
    built = Builder() if wrist == "a0" else Builder().arm(int(wrist[1:]))
    return (
        built.link(wrist, PALM, ("0.02 0.006 0.09", "0 -0.01 0.095"))
        .link("part", ("0.02 0.006 0.085", "0 0.003 0.0425"))
        .joint(wrist, "part", "0 0.012 0.055", "1 0 0", -1.7, 0.15)
    )


def sliding_fingers(wrist: str, *, kind: str = "collision", follows: bool = False) -> Builder:
    built = Builder() if wrist == "a0" else Builder().arm(int(wrist[1:]))
    built.link(wrist, PALM)
    for name, sign in (("p1", 1), ("p2", -1)):
        built.link(name, ("0.02 0.01 0.06", f"0 {sign * 0.005} 0.03"), kind=kind)
        mimic = 'joint="p1_joint"' if follows and name == "p2" else ""
        built.joint(wrist, name, "0 0 0.05", f"0 {sign} 0", 0, 0.03, "prismatic", mimic)
    return built


def linkage(wrist: str) -> Builder:
    """Four bars on each side, one motor: outer knuckle, upright finger, inner knuckle."""
    built = Builder().arm(int(wrist[1:])).link(wrist, PALM)
    for side, sign in (("left", 1), ("right", -1)):
        drive = 'joint="left_bar_joint" multiplier="{}"'
        built.link(f"{side}_bar", ("0.01 0.01 0.04", f"0 {sign * 0.03} 0.02"))
        built.link(f"{side}_pad", ("0.02 0.01 0.05", f"0 {sign * -0.004} 0.025"))
        built.link(f"{side}_in", ("0.01 0.008 0.045", f"0 {sign * 0.02} 0.02"))
        own, axis = "" if side == "left" else drive.format(1), f"{sign} 0 0"
        built.joint(wrist, f"{side}_bar", f"0 {sign * 0.02} 0.05", axis, 0, 0.8, mimic=own)
        built.joint(f"{side}_bar", f"{side}_pad", f"0 {sign * 0.035} 0.04", axis, -0.9, 0.9,
                    mimic=drive.format(-1))  # fmt: skip
        built.joint(wrist, f"{side}_in", f"0 {sign * 0.01} 0.05", axis, 0, 0.8,
                    mimic=drive.format(1))  # fmt: skip
    return built


def mimic_chain(wrist: str) -> Builder:
    """Two fingers of three links; each joint follows the one before it."""
    built = Builder().arm(int(wrist[1:])).link(wrist, PALM)
    for side, sign in (("l", 1), ("r", -1)):
        parent, source = wrist, ""
        for i in range(3):
            child = f"{side}{i}"
            at = f"0 {sign * 0.035} 0.05" if i == 0 else "0 0 0.03"
            built.link(child, ("0.015 0.01 0.03", "0 0 0.015"))
            mimic = f'joint="{source}" multiplier="{0.7 if i else 1}"' if source else ""
            built.joint(parent, child, at, f"{sign} 0 0", 0, 0.6, mimic=mimic)
            parent, source = child, f"{child}_joint"
            if i == 0 and side == "r":
                built.parts[-1] = built.parts[-1].replace("</joint>",
                    '<mimic joint="l0_joint"/></joint>')  # fmt: skip
    return built


def five_fingers(wrist: str) -> Builder:
    """A thumb of three joints against four fingers of two."""
    built = Builder().arm(int(wrist[1:])).link(wrist, ("0.09 0.03 0.08", "0 0 0.04"))
    for i, x in enumerate((-0.033, -0.011, 0.011, 0.033)):
        first, second = f"f{i}a", f"f{i}b"
        built.link(first, ("0.016 0.016 0.045", "0 0 0.0225"))
        built.link(second, ("0.014 0.014 0.04", "0 0 0.02"))
        built.joint(wrist, first, f"{x} 0 0.085", "-1 0 0", 0, 1.6)
        built.joint(first, second, "0 0 0.047", "-1 0 0", 0, 1.6)
    built.link("t0", ("0.016 0.016 0.02", "0 0.02 0"))
    built.link("t1", ("0.016 0.016 0.04", "0 0 0.02")).link("t2", ("0.014 0.014 0.03", "0 0 0.015"))
    built.joint(wrist, "t0", "0.03 0.02 0.03", "0 0 1", -0.5, 0.8)
    built.joint("t0", "t1", "0 0.03 0", "1 0 0", -0.4, 0.9)
    return built.joint("t1", "t2", "0 0 0.042", "1 0 0", 0, 1.2)


def three_fingers(wrist: str) -> Builder:
    built = Builder().arm(int(wrist[1:])).link(wrist, ("0.09 0.09 0.05", "0 0 0.025"))
    for i, angle in enumerate(np.deg2rad((0, 120, 240))):
        x, y = 0.04 * np.cos(angle), 0.04 * np.sin(angle)
        built.link(f"t{i}", ("0.014 0.014 0.08", "0 0 0.04"))
        axis = f"{np.sin(angle):.6f} {-np.cos(angle):.6f} 0"
        mimic = 'joint="t0_joint"' if i else ""
        built.joint(wrist, f"t{i}", f"{x:.6f} {y:.6f} 0.05", axis, -0.5, 0.45, mimic=mimic)
    return built


@pytest.mark.parametrize(
    "built",
    [
        turning_jaw("a4"), turning_jaw("a5"), sliding_fingers("a4"),
        sliding_fingers("a6", follows=True), sliding_fingers("a5", kind="visual"), linkage("a6"),
        mimic_chain("a6"), five_fingers("a6"), three_fingers("a6"),
    ],
    ids=[
        "turning jaw, 4", "turning jaw, 5", "sliding", "sliding, mimic", "visual only", "linkage",
        "mimic chain", "five fingers", "three fingers",
    ],
)  # fmt: skip
def test_a_hand_is_recognised_by_its_shapes_alone(tmp_path, built):
    (hand,) = found(tmp_path, built)
    assert hand.wrist.startswith("a")
    assert hand.stroke > 0.02
    assert hand.approach[2] > (0.2 if "f0a_joint" in "".join(built.parts) else 0.9)


def test_a_single_jaw_closes_on_the_link_that_carries_it(tmp_path):
    (hand,) = found(tmp_path, turning_jaw("a5"))
    assert (hand.is_single, [joint.child for joint in hand.fingers]) == (True, ["part"])
    np.testing.assert_allclose(hand.approach, (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(hand.closing, (0, 1, 0), atol=0.03)  # from the fixed to the other
    assert abs(hand.closed_gap) < 0.02
    # The face of the fixed jaw, at y = -7 mm, is where the opening ends.
    assert hand.tcp[1] - hand.stroke / 2 == pytest.approx(-0.007, abs=1e-6)


def test_a_jaw_with_its_motor_about_the_hinge_is_not_taken_for_a_wrist(tmp_path):
    """The mean of its points lies near the axis, as a motor has many more of them than a jaw."""
    motor = [("0.02 0.02 0.001", f"0 0 {0.0002 * k:.4f}") for k in range(-50, 51)]
    jaw = ("0.02 0.006 0.085", "0 0.003 0.0425")
    built = turning_jaw("a5")
    built.parts = [part for part in built.parts if 'link name="part"' not in part]
    (hand,) = found(tmp_path, built.link("part", jaw, *motor))
    assert (hand.is_single, [joint.child for joint in hand.fingers]) == (True, ["part"])
    np.testing.assert_allclose(hand.approach, (0, 0, 1), atol=1e-6)


def test_a_linkage_closes_with_all_that_follows_its_motor(tmp_path):
    (hand,) = found(tmp_path, linkage("a6"))
    assert len(hand.fingers) == 6
    ends = zip(hand.closed, hand.opened, strict=True)
    by_name = dict(zip((joint.name for joint in hand.fingers), ends, strict=True))
    for name in ("right_bar_joint", "right_in_joint"):
        assert by_name[name] == by_name["left_bar_joint"]
    np.testing.assert_allclose(np.abs(hand.closing), (0, 1, 0), atol=1e-6)


def test_of_five_fingers_the_thumb_opposes_one_and_the_rest_is_named(tmp_path):
    (hand,) = found(tmp_path, five_fingers("a6"))
    used = {joint.child for joint in hand.fingers}
    assert used & {"t1", "t2"}
    assert len({name[:2] for name in used if name.startswith("f")}) == 1
    assert not hand.is_triple
    assert len(hand.rest) >= 6
    assert {*(joint.child for joint in hand.fingers)}.isdisjoint(
        name.removesuffix("_joint") for name in hand.rest
    )


def test_three_turning_fingers_are_no_pair_of_jaws(tmp_path):
    built = three_fingers("a6")
    (hand,) = found(tmp_path, built)
    assert hand.is_triple
    path = built.write(tmp_path)
    with pytest.raises(NoHandError, match="three equal fingers") as refused:
        guess_robot(path, "three")
    assert {"t0", "t1", "t2"} <= set(refused.value.links)


@pytest.mark.parametrize("name", ["robot", "gripper_alone"])
def test_a_gripper_without_an_arm_is_recognised(tmp_path, name):
    (hand,) = found(tmp_path, sliding_fingers("a0"), name)
    assert hand.joints == ()
    assert hand.stroke == pytest.approx(0.06, abs=1e-6)
    with pytest.raises(RobotError, match=rf"no arm.*'a0' is a gripper.*--gripper .*{name}.urdf"):
        guess_robot(tmp_path / f"{name}.urdf", "alone")


@pytest.mark.parametrize("yaw", [0.0, 0.5])
@pytest.mark.parametrize("is_turning", [False, True])
def test_fingers_on_a_bracket_that_leads_aside_approach_along_themselves(tmp_path, yaw, is_turning):
    built = Builder().arm(5).link("a5", ("0.05 0.05 0.03", "0 0 0.015")).link("palm", PALM)
    # The way from the wrist to the tips is 17 degrees off.
    built.parts.append(
        '<joint name="bracket" type="fixed"><parent link="a5"/><child link="palm"/>'
        f'<origin xyz="0 0 0.03" rpy="0 1.570796 {yaw}"/></joint>'
    )
    for name, sign in (("p1", 1), ("p2", -1)):
        built.link(name, ("0.02 0.01 0.06", "0 0 0.03"))
        if is_turning:
            built.joint("palm", name, f"0 {sign * 0.03} 0.05", f"{sign} 0 0", -0.6, 0.4)
        else:
            built.joint("palm", name, f"0 {sign * 0.005} 0.05", f"0 {sign} 0", 0, 0.03, "prismatic")
    (hand,) = found(tmp_path, built)
    np.testing.assert_allclose(hand.approach, [np.cos(yaw), np.sin(yaw), 0], atol=0.01)


def no_hands() -> dict[str, Builder]:
    bare = Builder().arm(6).link("a6", ("0.05 0.05 0.02", "0 0 0.01"))
    legs = Builder().link("trunk", ("0.3 0.2 0.08", "0 0 0"))
    for i, (x, y) in enumerate(((0.12, 0.1), (0.12, -0.1), (-0.12, 0.1), (-0.12, -0.1))):
        for k, (axis, at) in enumerate((("1 0 0", f"{x} {y} 0"), ("0 1 0", "0 0 0"),
                                        ("0 1 0", "0 0 -0.15"))):  # fmt: skip
            child = f"leg{i}_{k}"
            legs.link(child, ("0.03 0.03 0.14", "0 0 -0.07"))
            legs.joint("trunk" if k == 0 else f"leg{i}_{k - 1}", child, at, axis, -1, 1)
    folding = Builder().arm(3).link("a3", ("0.04 0.04 0.2", "0 0 0.1"))
    folding.link("fore", ("0.04 0.04 0.2", "0 0 0.1"))
    folding.joint("a3", "fore", "0 0 0.2", "0 1 0", -3.0, 3.0)
    return {"bare arm": bare, "legs": legs, "folding arm": folding}


@pytest.mark.parametrize("kind", sorted(no_hands()))
def test_what_is_no_hand_is_not_taken_for_one(tmp_path, kind):
    assert found(tmp_path, no_hands()[kind]) == []


def test_links_that_somebody_names_are_jaws_where_none_are_found(tmp_path):
    built = three_fingers("a6")
    path = built.write(tmp_path)
    robot, _ = bare_robot(path, name="three")
    hand = hand_between(robot, ("t0", "t1"))
    assert {joint.child for joint in hand.fingers} >= {"t0", "t1"}
    single, _ = bare_robot(turning_jaw("a5").write(tmp_path, "jaw"), name="jaw")
    assert hand_between(single, ("part", "a5")) == find_hands(single)[0]
    for links, says in (
        (("t0", "t9"), "no link 't9'"),
        (("t0", "t0"), "one rigid part"),
        (("t0", "a2"), "no pair of jaws"),
    ):
        with pytest.raises(RobotError, match=says):
            hand_between(robot, links)


def test_a_jaw_whose_hinge_lies_aside_closes_midway_between_both_jaws(tmp_path):
    # By the way from the hinge to the jaw's middle, the hand came in 25 degrees aslant.
    built = (
        Builder()
        .arm(4)
        .link("a4", PALM, ("0.02 0.006 0.09", "0 -0.01 0.095"))
        .link("part", ("0.02 0.006 0.085", "0 -0.047 0.0425"), ("0.02 0.05 0.01", "0 -0.02 0"))
        .joint("a4", "part", "0 0.045 0.055", "1 0 0", -1.2, 0.05)
    )
    [hand] = found(tmp_path, built)
    assert hand.is_single
    assert np.degrees(np.arccos(hand.approach[2])) < 8


def test_the_tip_of_a_finger_is_the_link_farthest_from_its_own_root(tmp_path):
    # A platform's frame lies far above: its fingers bend back towards it.
    built = Builder().link("base", ("0.3 0.3 0.02", "0 0 0.3"))
    for k in range(3):
        angle = 2 * np.pi * k / 3
        x, y = 0.06 * np.cos(angle), 0.06 * np.sin(angle)
        upper, middle, lower = (f"finger_{part}_link_{k}" for part in ("upper", "middle", "lower"))
        built.link(upper, ("0.02 0.02 0.03", "0 0 -0.01"))
        built.link(middle, ("0.02 0.02 0.16", "0 0 -0.08"))
        built.link(lower, ("0.016 0.016 0.16", "0 0 -0.08"))
        axis = f"{-np.sin(angle)} {np.cos(angle)} 0"
        built.joint("base", upper, f"{x} {y} 0.29", f"{np.cos(angle)} {np.sin(angle)} 0", -0.3, 0.3)
        built.joint(upper, middle, "0 0 -0.02", axis, -1.2, 0.6)
        built.joint(middle, lower, "0 0 -0.16", axis, 0.0, 1.6)
    [hand] = found(tmp_path, built)
    assert {joint.child.split("_")[1] for joint in hand.fingers} >= {"middle", "lower"}


def test_a_jaw_of_a_few_triangles_points_where_one_of_boxes_does(tmp_path):
    """Convex parts have vertices at their ends alone, which do not show where a jaw points."""
    built = turning_jaw("a4")
    # A hinge aside of both jaws, so that the way to their middles is not where they point.
    built.parts = [
        part.replace("0 0.012 0.055", "0 0.032 0.055").replace("0 0.003 0.0425", "0 -0.017 0.0425")
        for part in built.parts
    ]
    (of_boxes,) = found(tmp_path, built, "boxes")
    sizes = {size for part in built.parts for size in re.findall(r'<box size="([^"]*)"/>', part)}
    for number, size in enumerate(sorted(sizes)):
        mesh = trimesh.creation.box([float(side) for side in size.split()])
        mesh.export(tmp_path / f"{number}.stl")
        built.parts = [
            part.replace(f'<box size="{size}"/>', f'<mesh filename="{number}.stl"/>')
            for part in built.parts
        ]
    (of_meshes,) = found(tmp_path, built, "meshes")
    assert np.dot(of_meshes.approach, of_boxes.approach) > np.cos(0.02)
    assert np.dot(of_meshes.closing, of_boxes.closing) > np.cos(0.02)
