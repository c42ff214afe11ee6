"""The NAO's description keeps the published facts, in the URDF and in the simulated body."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from simulate.motion.kinematics import Chain
from simulate.robots import describe_nao, urdf_text
from simulate.robots.facts_nao import HEAD_PITCH_LIMITS_DEG, TORSO_HEIGHT, TOTAL_MASS
from simulate.robots.nao import CAMERA_MASS, head_pitch_limits

MIRROR = np.diag([1.0, -1.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize(("legs", "moving"), [("joints", 40), ("fixed", 28)])
def test_urdf_has_the_published_joints_and_mass(legs, moving):
    root = ET.fromstring(urdf_text(describe_nao(legs=legs)))
    kinds = [joint.get("type") for joint in root.findall("joint")]
    assert kinds.count("revolute") == moving
    mass = sum(float(m.get("value")) for m in root.iterfind("link/inertial/mass"))
    # The table of masses is rounded to 1e-5 kg, its sum is given to 1e-4 kg.
    assert mass - CAMERA_MASS == pytest.approx(TOTAL_MASS, abs=1e-4)


def test_urdf_is_a_tree_of_portable_primitives():
    root = ET.fromstring(urdf_text(describe_nao(legs="joints"), frames=True))
    links = {link.get("name") for link in root.findall("link")}
    children = [joint.find("child").get("link") for joint in root.findall("joint")]
    parents = {joint.find("parent").get("link") for joint in root.findall("joint")}
    assert len(children) == len(set(children)) == len(links) - 1
    assert links - set(children) == {"torso"}
    assert parents <= links
    shapes = {shape.tag for shape in root.iterfind(".//geometry/*")}
    assert shapes == {"box", "sphere", "cylinder"}
    assert "camera_depth_optical_frame" in links


def test_every_inertia_is_one_of_a_rigid_body():
    for symmetric in (True, False):
        for link in describe_nao(symmetric=symmetric).links:
            principal = np.linalg.eigvalsh(link.inertial.tensor)
            assert principal[0] > 0, link.name
            assert principal[2] <= principal[0] + principal[1] + 1e-12, link.name


def test_limits_and_fingers_follow_the_mirror_rule():
    robot = describe_nao()
    for name in ("ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw"):
        left, right = robot.joint("L" + name), robot.joint("R" + name)
        assert (right.lower, right.upper) == (-left.upper, -left.lower)
    assert robot.joint("RShoulderPitch").lower == robot.joint("LShoulderPitch").lower
    assert robot.joint("RFinger11").pose == robot.joint("LFinger11").pose
    assert robot.joint("RHipYawPitch").mimic is None  # welded legs mimic nothing
    assert describe_nao(legs="joints").joint("RHipYawPitch").mimic == ("LHipYawPitch", 1.0)


def test_arms_are_mirror_images():
    robot = describe_nao()
    left, right = Chain.of(robot, "left_arm"), Chain.of(robot, "right_arm")
    q = left.lower + np.random.default_rng(3).random((50, 5)) * (left.upper - left.lower)
    signs = np.array([1.0, -1.0, -1.0, -1.0, -1.0])
    rotation, position = left.tool_poses(q)
    mirrored_rotation, mirrored_position = right.tool_poses(q * signs)
    np.testing.assert_allclose(mirrored_position, position @ MIRROR, atol=1e-12)
    # The y axis of the tool points to the other side of the mirrored hand.
    np.testing.assert_allclose(mirrored_rotation, MIRROR @ rotation @ MIRROR, atol=1e-12)


def test_straight_arm_has_the_published_length():
    chain = Chain.of(describe_nao(), "left_arm")
    _, position = chain.tool_poses(np.zeros((1, 5)))
    assert position[0] == pytest.approx(
        [0.105 + 0.05595 + 0.083, 0.098 + 0.015, TORSO_HEIGHT + 0.100 - 0.024], abs=1e-9
    )


def test_head_pitch_limits_are_the_table_and_even_in_yaw():
    for yaw, low, high in HEAD_PITCH_LIMITS_DEG:
        for sign in (1, -1):
            found = head_pitch_limits(sign * math.radians(yaw))
            assert np.degrees(found) == pytest.approx((low, high), abs=1e-9)
    between = head_pitch_limits(math.radians((27.85 + 43.32) / 2))
    assert np.degrees(between) == pytest.approx((-34.95, 22.69), abs=1e-6)


def test_looking_at_either_side_keeps_the_head_within_its_table():
    camera = describe_nao().cameras["CameraDepth3"]
    for side, (yaw, pitch) in camera.look.items():
        low, high = head_pitch_limits(yaw)
        assert low <= pitch <= high, side


def test_welding_keeps_mass_centre_and_kinematics():
    robot = describe_nao()
    welded = robot.welded()
    assert all(joint.kind != "fixed" for joint in welded.joints)
    assert len(welded.joints) == 28
    assert sum(link.inertial.mass for link in welded.links) == pytest.approx(
        sum(link.inertial.mass for link in robot.links)
    )
    q = np.array([[0.3, 0.4, -0.5, -0.6, 0.7]])
    for before, after in zip(
        Chain.of(robot, "left_arm").tool_poses(q),
        Chain.of(welded, "left_arm").tool_poses(q),
        strict=True,
    ):
        np.testing.assert_allclose(after, before, atol=1e-12)


def test_welding_two_boxes_gives_the_inertia_of_the_whole():
    from simulate.robots.description import Inertial, transform_from

    def box(mass, x, y, z):
        return Inertial(
            mass, (0, 0, 0), (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12,
                              mass * (x * x + y * y) / 12),
        )  # fmt: skip

    half = box(1.0, 0.1, 0.04, 0.06)
    turned = transform_from((0.1, 0.0, 0.0), (math.pi, 0.0, 0.0))
    whole = half.joined(half, turned)
    np.testing.assert_allclose(whole.tensor, box(2.0, 0.2, 0.04, 0.06).tensor, atol=1e-12)
    assert whole.centre == pytest.approx((0.05, 0.0, 0.0))
