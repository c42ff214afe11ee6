"""A robot leans for what it cannot reach otherwise, stays on its feet, and stands up again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rtask.errors import RobotError
from simulate.grasping.executor import GraspRequest, Workcell
from simulate.grasping.planning import GraspPlanner
from simulate.motion.arm_space import ArmSpace
from simulate.motion.collision import link_poses
from simulate.motion.stance import balance_margin, centre_of_mass, standing
from simulate.robots import describe
from simulate.world.objects import product

CAN = product("can", 3)
FAR = (0.24, -0.07)
STANCE = "lean 0.2"


@pytest.fixture(scope="module")
def cell():
    with Workcell("nao") as made:
        yield made


def far_can(**changes):
    diameter, height = CAN.dims
    request = GraspRequest(
        *FAR, 0.0, width=diameter, length=diameter, height=height, round=True, table_height=0.27
    )
    return replace(request, **changes)


def thighs(robot):
    """Return where physics has the parts below the hips, which carry the feet: (2, 7)."""
    client = robot.world.client
    states = [
        client.getLinkState(robot.body, robot.link_index[name], computeForwardKinematics=True)
        for name in ("LThigh", "RThigh")
    ]
    return np.array([[*state[4], *state[5]] for state in states])


def test_the_torso_leans_over_feet_that_stay_and_planning_knows_where_the_hand_is(cell):
    robot = cell.robot
    robot.take_stance(STANCE, seconds=0.1)
    described = standing(describe("nao"), STANCE)
    poses = link_poses(described.root, described.joints, {})
    stood = describe("nao")
    upright = link_poses(stood.root, stood.joints, {})
    for side, found in zip("LR", thighs(robot), strict=True):
        foot = described.base_from_root.matrix @ poses[f"{side}Thigh"]
        np.testing.assert_allclose(foot, stood.base_from_root.matrix @ upright[f"{side}Thigh"],
                                   atol=1e-9)  # fmt: skip
        np.testing.assert_allclose(found[:3], foot[:3, 3], atol=1e-5)
        assert abs(found[6]) == pytest.approx(1.0, abs=1e-6)  # not turned
    chain, index = robot.chains["left_arm"], robot.link_index["l_wrist"]
    state = robot.world.client.getLinkState(robot.body, index, computeForwardKinematics=True)
    _, positions = chain.link_frames(robot.arm_joints("left_arm")[None])
    np.testing.assert_allclose(state[4], positions[0, -1], atol=1e-5)
    robot.take_stance("", seconds=0.1)
    assert robot.base_from_camera(np.zeros(2))[:3, 3] == pytest.approx(describe_camera(), abs=1e-9)
    with pytest.raises(RobotError, match=r"no stance 'bow'; it has lean 0.2, lean 0.4"):
        robot.take_stance("bow")


def describe_camera():
    """Return where the camera of an upright Nao looking ahead is, m."""
    with Workcell("nao", preset="fast") as other:
        return other.robot.base_from_camera(np.zeros(2))[:3, 3]


@pytest.mark.slow
def test_what_is_out_of_reach_is_reached_by_leaning(cell):
    assert isinstance(cell.executor.plan(far_can(stances="own"), seed=1), str)
    assert cell.executor.plan(far_can(), seed=1).stance == STANCE


@pytest.mark.deep
@pytest.mark.slow
def test_what_is_out_of_reach_is_held_by_leaning_and_placed(cell):
    body = cell.world.spawn(CAN, FAR)
    cell.world.step(0.3)
    record = cell.executor.execute(cell.executor.plan(far_can(), seed=1))
    assert (record.reason, record.place_reason) == ("ok", "ok")
    assert cell.robot.stance == ""
    cell.world.remove(body)


@pytest.mark.slow
def test_what_is_in_reach_needs_no_lean(cell):
    near = far_can(x=0.15, y=-0.10)
    assert cell.executor.plan(near, seed=1).stance == ""
    assert isinstance(cell.executor.plan(far_can(x=0.45, stances="other"), seed=1), str)


def test_the_centre_of_mass_stays_over_the_feet():
    robot = describe("nao")
    ahead = {"LShoulderPitch": 0.3, "RShoulderPitch": 0.3}
    margins = [balance_margin(standing(robot, name), ahead) for name in ("", *robot.stances)]
    assert margins == sorted(margins, reverse=True)
    assert margins[-1] > 0
    far = np.array([0.3, 0.0, 0.3])
    assert balance_margin(standing(robot, "lean 0.4"), ahead, 1.0, far) < 0  # 1 kg tips it over
    assert balance_margin(describe("panda"), {}) == np.inf
    # Published masses: an upright Nao's centre of mass is between its hips and its shoulders.
    assert centre_of_mass(robot, {})[2] == pytest.approx(0.3, abs=0.05)


def test_a_plan_in_which_the_robot_would_fall_is_none():
    leaning = standing(describe("nao"), STANCE)
    assert not isinstance(GraspPlanner(ArmSpace(leaning), STANCE).plan(far_can(), [], 1), str)
    on_heels = replace(leaning, support=tuple((x - 0.05, y) for x, y in leaning.support))
    assert GraspPlanner(ArmSpace(on_heels), STANCE).plan(far_can(), [], 1) == "tilt"
