"""Forward and inverse kinematics of the NAO's arms."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.motion.kinematics import Chain, Goal, IkOptions, follow_line, solve_ik
from simulate.robots import describe_nao
from simulate.world.robot_body import RobotBody
from simulate.world.world import World


@pytest.fixture(scope="module")
def chain():
    return Chain.of(describe_nao(), "right_arm")


def random_postures(chain, n, seed=0, margin=0.1):
    low, high = chain.lower + margin, chain.upper - margin
    return low + np.random.default_rng(seed).random((n, chain.dof)) * (high - low)


@pytest.mark.parametrize("arm", ["left_arm", "right_arm"])
def test_forward_kinematics_agree_with_the_physics_engine(arm):
    with World() as world:
        robot = RobotBody(world, describe_nao())
        chain = robot.chains[arm]
        index = robot.link_index[robot.arms[arm].wrist]
        for q in random_postures(chain, 25, seed=1):
            robot.reset_arm(arm, q)
            state = world.client.getLinkState(robot.body, index, computeForwardKinematics=True)
            rotation, position = chain.link_frames(q[None])
            turned = np.array(world.client.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            # The engine keeps single precision in its URDF reader.
            np.testing.assert_allclose(state[4], position[0, -1], atol=1e-6)
            np.testing.assert_allclose(turned, rotation[0, -1], atol=1e-6)


def test_jacobian_is_the_derivative_of_the_pose(chain):
    step = 1e-6
    for q in random_postures(chain, 5, seed=2):
        _, position, jacobian = chain.jacobian(q[None])
        rotation, _ = chain.tool_poses(q[None])
        for joint in range(chain.dof):
            moved = q.copy()
            moved[joint] += step
            rotation_2, position_2 = chain.tool_poses(moved[None])
            linear = (position_2 - position)[0] / step
            spin = (rotation_2[0] @ rotation[0].T - np.eye(3)) / step
            angular = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            np.testing.assert_allclose(jacobian[0, :3, joint], linear, atol=1e-5)
            np.testing.assert_allclose(jacobian[0, 3:, joint], angular, atol=1e-5)


def test_inverse_kinematics_find_what_the_arm_can_reach(chain):
    found = 0
    options = IkOptions(starts=24, position_tolerance=0.002, angle_tolerance=0.05)
    for q in random_postures(chain, 40, seed=3, margin=0.3):
        rotation, position = chain.tool_poses(q[None])
        goal = Goal(position[0], rotation[0, :, 0])
        solutions = solve_ik(chain, goal, np.random.default_rng(0), options)
        if len(solutions):
            found += 1
            reached_rotation, reached = chain.tool_poses(solutions)
            assert np.linalg.norm(reached - position[0], axis=1).max() <= 0.002
            assert np.abs(reached_rotation[:, :, 0] @ goal.closing).min() >= np.cos(0.05)
            assert (solutions >= chain.lower).all()
            assert (solutions <= chain.upper).all()
    assert found >= 39  # the reference solved all of 60


def test_all_distinct_solutions_are_returned_for_a_round_object(chain):
    goal = Goal(np.array([0.15, -0.12, 0.31]))
    solutions = solve_ik(chain, goal, np.random.default_rng(0))
    assert len(solutions) >= 4
    rotation, _ = chain.tool_poses(solutions)
    assert np.abs(rotation[:, 2, 0]).max() <= np.sin(0.15) + 1e-9  # closing axes are level
    gaps = np.abs(solutions[:, None] - solutions[None]).max(axis=2)
    assert (gaps[~np.eye(len(gaps), dtype=bool)] >= IkOptions().distinct).all()


def test_out_of_reach_is_an_empty_answer(chain):
    solutions = solve_ik(chain, Goal(np.array([0.6, 0.0, 0.3])), np.random.default_rng(0))
    assert solutions.shape == (0, 5)


def test_same_seed_same_solutions(chain):
    goal = Goal(np.array([0.15, -0.1, 0.31]), np.array([1.0, 0.0, 0.0]))
    first, second = (solve_ik(chain, goal, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_line_is_straight_and_the_closing_axis_stays(chain):
    starts = solve_ik(chain, Goal(np.array([0.15, -0.12, 0.30])), np.random.default_rng(0))
    lines = [follow_line(chain, start, np.array([0.0, 0.0, 0.05])) for start in starts]
    found = [line for line in lines if line is not None]
    assert len(found) >= len(starts) / 2
    for line in found:
        rotation, position = chain.tool_poses(line)
        wanted = position[0] + np.linspace(0, 1, len(line))[:, None] * [0.0, 0.0, 0.05]
        assert np.linalg.norm(position - wanted, axis=1).max() <= 0.0025
        assert (rotation[:, :, 0] @ rotation[0, :, 0]).min() > np.cos(0.02)


def test_a_line_out_of_the_arms_reach_is_given_up(chain):
    start = solve_ik(chain, Goal(np.array([0.15, -0.12, 0.30])), np.random.default_rng(0))[0]
    assert follow_line(chain, start, np.array([0.4, 0.0, 0.0])) is None


def test_wrong_shapes_are_named(chain):
    with pytest.raises(ValueError, match=r"\(b, 5\) rad, got \(1, 4\)"):
        chain.tool_poses(np.zeros((1, 4)))
