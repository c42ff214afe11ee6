"""Planar grasps as poses and as messages, there and back."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasp.messages import (
    empty_grasp_message,
    grasp_message,
    matrix_from_message,
    planar_from_message,
    pose_message,
)
from grasp.spatial.frames import (
    matrix_from_pose,
    planar_from_pose,
    pose_from_planar,
    surface_from_object,
    tilt,
    wrap_2pi,
    wrap_axis,
    yaw_of,
)
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import PlanarGrasp

HAND = ParallelGripper("RHand", "nao_hand", 0.0, 0.05)


@pytest.mark.parametrize("theta", np.linspace(0, 2 * np.pi, 17)[:-1])
def test_planar_pose_round_trip(theta):
    pose = pose_from_planar(0.1, -0.2, 0.3, theta)
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(pose[:3, 2], [0, 0, -1])
    assert planar_from_pose(pose) == pytest.approx((0.1, -0.2, 0.3, theta))
    half = Rotation.from_quat([np.cos(theta / 2), np.sin(theta / 2), 0, 0]).as_matrix()
    assert np.allclose(pose[:3, :3], half)


def test_a_slanted_approach_is_no_planar_grasp():
    pose = pose_from_planar(0, 0, 0, 0)
    pose[:3, :3] = Rotation.from_euler("y", 30, degrees=True).as_matrix() @ pose[:3, :3]
    with pytest.raises(ValueError, match="30 deg off the vertical"):
        planar_from_pose(pose)


def test_wrapping_never_returns_the_open_end():
    for angle in (0.0, -1e-18, 2 * np.pi, -np.pi, 7.0):
        assert 0 <= wrap_2pi(angle) < 2 * np.pi
        assert 0 <= wrap_axis(angle) < np.pi


def test_yaw_and_tilt_of_an_upright_thing():
    pose = surface_from_object(1.0, 2.0, 3.0, 0.8)
    assert yaw_of(pose) == pytest.approx(0.8)
    assert tilt(pose) == pytest.approx(0.0)


def test_quaternions_agree_with_scipy_and_bad_ones_are_refused():
    rng = np.random.default_rng(1)
    for quaternion in Rotation.random(10, random_state=rng).as_quat():
        ours = matrix_from_pose(np.zeros(3), quaternion)
        assert np.allclose(ours[:3, :3], Rotation.from_quat(quaternion).as_matrix())
    with pytest.raises(ValueError, match="unit quaternion"):
        matrix_from_pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 0.5]))


def test_grasp_message_round_trip_also_for_a_wrist():
    wrist_from_tcp = surface_from_object(0.083, 0.0, -0.024, 0.4)
    there = PlanarGrasp(0.15, -0.1, 0.03, 2.5, 0.031, 0.05, 0.9)
    for parent in (None, wrist_from_tcp):
        message = json.loads(json.dumps(grasp_message(there, HAND, "base", 0.27, parent)))
        back = planar_from_message(message, 0.27, parent)
        for name in ("x", "y", "z", "theta", "width", "opening", "quality"):
            assert getattr(back, name) == pytest.approx(getattr(there, name), abs=1e-9)


def test_message_poses_stand_in_a_named_frame_with_positive_w():
    message = grasp_message(PlanarGrasp(0, 0, 0, 3.0, 0.03, 0.05, 0.9), HAND, "base")
    assert message["grasp_pose"]["header"]["frame_id"] == "base"
    assert message["grasp_pose"]["pose"]["orientation"]["w"] >= 0
    with pytest.raises(ValueError, match="frame"):
        grasp_message(PlanarGrasp(0, 0, 0, 3.0, 0.03, 0.05, 0.9), HAND, "")


def test_the_empty_message_has_every_field_of_a_full_one():
    full = grasp_message(PlanarGrasp(0, 0, 0, 0, 0.03, 0.05, 0.9), HAND, "base")
    empty = empty_grasp_message("base")
    assert empty.keys() == full.keys()
    assert empty["grasp_pose"]["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert empty["grasp_posture"]["points"] == []


def test_pose_message_errors_say_what_is_missing():
    whole = pose_message(np.eye(4))
    assert np.allclose(matrix_from_message(whole), np.eye(4))
    with pytest.raises(ValueError, match="position"):
        matrix_from_message({"orientation": whole["orientation"]})
    with pytest.raises(ValueError, match="finite"):
        matrix_from_message({**whole, "position": {"x": "nan", "y": 0, "z": 0}})
