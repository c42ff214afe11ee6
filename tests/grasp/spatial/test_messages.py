"""Grasps in space as moveit_msgs/Grasp and as planar grasps, there and back."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp.messages import candidate_from_message, spatial_grasp_message
from grasp.spatial.candidate import GraspCandidate, to_planar
from grasp.spatial.frames import pose_from_planar
from grasp.spatial.gripper import nao_hand, panda_hand, parallel_jaw
from grasp.spatial.gripper_files import gripper_named

HANDS = [nao_hand(), panda_hand(), parallel_jaw(0.06)]


def _candidate(rotation: np.ndarray, position: object, width: float) -> GraspCandidate:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return GraspCandidate(pose, width, opening=width + 0.01, scores={"confidence": 0.8125})


def _numbers(value: object) -> list[float]:
    """Return every number of a message in order."""
    if isinstance(value, dict):
        return [n for key in sorted(value) for n in _numbers(value[key])]
    if isinstance(value, list):
        return [n for item in value for n in _numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    st.floats(0.001, 0.039),
    st.sampled_from(HANDS),
)
def test_message_candidate_message_is_exact(quaternion, position, width, hand) -> None:
    there = _candidate(Rotation.from_quat(quaternion).as_matrix(), position, width)
    message = spatial_grasp_message(there, hand, "table", grasp_id="g", allowed=["mug"])
    back = candidate_from_message(json.loads(json.dumps(message)), hand)
    assert np.allclose(back.frame_from_gripper, there.frame_from_gripper, atol=1e-9)
    assert back.width == pytest.approx(width, abs=1e-9)
    again = spatial_grasp_message(back, hand, "table", grasp_id="g", allowed=["mug"])
    assert _numbers(again) == pytest.approx(_numbers(message), abs=1e-9)
    assert message["grasp_pose"]["pose"]["orientation"]["w"] >= 0


def test_the_pose_is_that_of_the_parent_link() -> None:
    message = spatial_grasp_message(
        GraspCandidate(pose_from_planar(0.4, 0.1, 0.05, 0.0), 0.03), panda_hand(), "panda_link0"
    )
    position = message["grasp_pose"]["pose"]["position"]
    # The hand's frame is 103.4 mm over its fingertips when it points down.
    assert (position["x"], position["y"]) == pytest.approx((0.4, 0.1))
    assert position["z"] == pytest.approx(0.05 + 0.1034)
    into = message["pre_grasp_approach"]
    assert list(into["direction"]["vector"].values()) == pytest.approx([0, 0, -1])
    assert (into["desired_distance"], into["min_distance"]) == (0.10, 0.05)
    assert message["post_grasp_retreat"]["direction"]["vector"]["z"] == 1.0


def test_postures_speak_in_the_joints_of_the_hand() -> None:
    there = GraspCandidate(np.eye(4), 0.03)
    panda = spatial_grasp_message(there, panda_hand(), "f")
    before, after = panda["pre_grasp_posture"], panda["grasp_posture"]
    assert before["joint_names"] == ["panda_finger_joint1", "panda_finger_joint2"]
    assert before["points"][0]["positions"] == pytest.approx([0.025, 0.025])  # 2 cm to spare
    assert before["points"][0]["effort"] == []
    assert after["points"][0]["positions"] == pytest.approx([0.015, 0.015])
    assert after["points"][0]["effort"] == [20.0, 20.0]
    nao = spatial_grasp_message(GraspCandidate(np.eye(4), 0.04), nao_hand("nao_left_hand"), "f")
    assert nao["pre_grasp_posture"]["joint_names"] == ["LHand"]
    assert nao["pre_grasp_posture"]["points"][0]["positions"] == [1.0]  # capped at the stroke


def test_what_is_no_grasp_message_is_refused() -> None:
    message = spatial_grasp_message(GraspCandidate(np.eye(4), 0.03), panda_hand(), "f")
    with pytest.raises(ValueError, match="name of its frame"):
        spatial_grasp_message(GraspCandidate(np.eye(4), 0.03), panda_hand(), "")
    with pytest.raises(ValueError, match="panda_finger_joint1"):
        candidate_from_message({**message, "grasp_posture": {
            "joint_names": ["other"], "points": [{"positions": [0.1]}]}}, panda_hand())  # fmt: skip
    with pytest.raises(ValueError, match="missing"):
        candidate_from_message({k: v for k, v in message.items() if k != "grasp_pose"},
                               panda_hand())  # fmt: skip
    with pytest.raises(ValueError, match="finite"):
        candidate_from_message({**message, "grasp_quality": float("nan")}, panda_hand())


@pytest.mark.parametrize("tilt_deg", [0.0, 15.0, 19.0])
def test_grasps_nearly_from_above_are_planar(tilt_deg: float) -> None:
    pose = pose_from_planar(0.1, -0.2, 0.3, 0.7)
    tilted = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    pose[:3, :3] = tilted @ pose[:3, :3]
    planar = to_planar(GraspCandidate(pose, 0.03, opening=0.05), support_height=0.25)
    assert (planar.x, planar.y, planar.z) == pytest.approx((0.1, -0.2, 0.05))
    expected = np.arctan2(pose[1, 0], pose[0, 0])
    assert planar.theta == pytest.approx(expected)
    assert (planar.width, planar.opening) == (0.03, 0.05)


def test_grasps_from_the_side_are_not_planar() -> None:
    with pytest.raises(ValueError, match="off the vertical"):
        to_planar(GraspCandidate(np.eye(4), 0.03))


@pytest.mark.parametrize("text", ["nao", "panda", "jaw:0.05"])
def test_grippers_by_name(text: str) -> None:
    hand = gripper_named(text)
    boxes = hand.boxes(hand.max_opening, sweep_m=0.05)
    assert (boxes[:, 1] > boxes[:, 0]).all()
    # The fingers stand left and right of the opening, the palm behind both.
    assert boxes[0, 1, 0] == pytest.approx(-hand.max_opening / 2)
    assert boxes[1, 0, 0] == pytest.approx(hand.max_opening / 2)
    assert boxes[2, 1, 2] == pytest.approx(boxes[0, 0, 2] + 0.05)
    assert hand.opening_at(next(iter(hand.joint_positions(0.02).values()))) == pytest.approx(0.02)


@pytest.mark.parametrize("text", ["jaw:-1", "jaw:x", "jaw", "robotiq", ""])
def test_unknown_grippers_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"stroke|panda"):
        gripper_named(text)


def test_the_nao_hand_is_where_its_description_puts_it() -> None:
    from simulate.robots.nao import describe_nao

    arm = describe_nao().arm("right_arm")
    frame = nao_hand().parent_from_gripper
    assert frame is not None
    assert frame[:3, 3] == pytest.approx(arm.tcp)
    assert frame[:3, 2] == pytest.approx(arm.approach)
    assert frame[:3, 0] == pytest.approx(arm.closing)
    assert nao_hand().max_opening == arm.mouth
