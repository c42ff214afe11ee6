"""An arm takes the tool to a full pose, or says that it cannot; seen points are obstacles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulate.grasping.planning import GraspPlanner
from simulate.grasping.rules import GraspRequest
from simulate.motion.arm_space import ArmSpace
from simulate.motion.collision import Obstacle, PointField, Surroundings
from simulate.robots import describe

DOWN = np.diag([1.0, -1.0, -1.0])


def pose_at(place, tilt=0.0, yaw=0.0):
    pose = np.eye(4)
    turn = Rotation.from_euler("zy", [yaw, tilt]).as_matrix()
    pose[:3, :3], pose[:3, 3] = turn @ DOWN, place
    return pose


def cube(centre, half=0.02, step=0.005):
    side = np.arange(-half, half + 1e-9, step)
    return np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3) + centre


@pytest.fixture(scope="module")
def panda():
    return GraspPlanner(ArmSpace(describe("panda")))


def test_a_field_is_as_far_as_the_nearest_point_to_within_a_cell():
    points = cube((0.4, 0.1, 0.3))
    field = PointField.of("neighbour", points)
    rng = np.random.default_rng(0)
    for scale in (0.05, 0.3):  # inside and outside the grid
        asked = np.array([0.4, 0.1, 0.3]) + rng.uniform(-scale, scale, (200, 3))
        exact = np.linalg.norm(asked[:, None] - points[None], axis=2).min(axis=1)
        found = field.distances(asked)
        assert np.all(found <= exact + field.cell)
        if scale == 0.05:
            assert np.all(found >= exact - 2 * field.cell)


def test_a_field_reaches_down_to_the_floor_where_asked():
    over = PointField.of("neighbour", cube((0.4, 0.1, 0.3)), floor=0.2)
    below = np.array([[0.4, 0.1, 0.22]])
    assert over.distances(below)[0] < 0
    assert PointField.of("neighbour", cube((0.4, 0.1, 0.3))).distances(below)[0] > 0.05


def test_a_field_of_points_far_apart_is_refused():
    with pytest.raises(ValueError, match="cut the scene"):
        PointField.of("neighbour", np.array([[0, 0, 0], [9.0, 9.0, 9.0]]))
    with pytest.raises(ValueError, match="shape"):
        PointField.of("neighbour", np.empty((0, 3)))


def test_surroundings_name_boxes_and_fields_in_the_order_of_their_distances():
    around = Surroundings((Obstacle.box("table", (0, 0, 0), (1, 1, 0.1)),)).with_obstacles(
        [PointField.of("neighbour", cube((0, 0, 0.3)))]
    )
    assert around.names == ("table", "neighbour")
    at_cube = around.distances(np.array([[0.0, 0.0, 0.3]]))[:, 0]
    assert at_cube[0] > 0.2
    assert at_cube[1] < 0.01


@pytest.mark.slow
def test_the_tool_arrives_in_the_asked_pose(panda):
    for tilt, yaw in ((0.0, 0.4), (0.5, 0.0), (0.5, 2.5)):
        pose = pose_at((0.46, 0.05, 0.26), tilt, yaw)
        own = cube((0.46, 0.05, 0.23))
        request = GraspRequest.at_pose(pose, 0.04, 0.06, own, 0.2)
        plan = panda.plan(request, [], seed=0)
        assert not isinstance(plan, str), plan
        rotation, position = panda.space.chains[plan.arm].tool_poses(plan.posture[None])
        assert position[0] == pytest.approx(pose[:3, 3], abs=0.0015)
        assert rotation[0][:, 2] @ pose[:3, 2] > np.cos(0.03)
        assert abs(rotation[0][:, 0] @ pose[:3, 0]) > np.cos(0.03)


@pytest.mark.slow
def test_the_approach_is_straight_along_the_tool(panda):
    pose = pose_at((0.46, 0.05, 0.26), 0.4)
    plan = panda.plan(
        GraspRequest.at_pose(pose, 0.04, 0.06, cube((0.46, 0.05, 0.23)), 0.2), [], seed=0
    )
    chain = panda.space.chains[plan.arm]
    _, way = chain.tool_poses(plan.approach.positions)
    along = (way - pose[:3, 3]) @ pose[:3, 2]
    aside = np.linalg.norm(way - pose[:3, 3] - along[:, None] * pose[:3, 2], axis=1)
    assert along[0] < -0.045
    assert aside.max() < 0.004  # the line's tolerance is 2.5 mm, the spline's a little more


def test_points_in_the_way_of_the_hand_refuse_the_pose(panda):
    pose = pose_at((0.46, 0.05, 0.26))
    own = cube((0.46, 0.05, 0.23))
    wall = cube((0.46, 0.05, 0.42), half=0.06, step=0.01)
    request = GraspRequest.at_pose(pose, 0.04, 0.06, own, 0.2)
    answer = panda.plan(request, [PointField.of("neighbour", wall)], seed=0)
    assert answer in ("grasp_collision", "approach_collision", "pregrasp_collision")


def test_an_arm_of_five_joints_says_which_tilt_it_cannot_reach():
    nao = GraspPlanner(ArmSpace(describe("nao")))
    for arm in ("left", "right"):
        place = (0.15, 0.10 if arm == "left" else -0.10, 0.32)
        request = GraspRequest.at_pose(pose_at(place), 0.03, 0.05, cube(place, 0.01), 0.27)
        assert nao.plan(request, [], seed=0) == "unreachable_tilt"


def test_a_place_out_of_reach_is_told_from_a_tilt_out_of_reach(panda):
    request = GraspRequest.at_pose(pose_at((1.6, 0, 0.3)), 0.03, 0.05, cube((1.6, 0, 0.3)), 0.2)
    assert panda.plan(request, [], seed=0) == "ik"


def test_a_pose_that_is_none_is_refused():
    own = cube((0.4, 0, 0.3))
    with pytest.raises(ValueError, match="rigid transform"):
        GraspRequest.at_pose(np.diag([1.0, 1.0, 2.0, 1.0]), 0.03, 0.05, own, 0.2)
    with pytest.raises(ValueError, match="rigid transform"):
        GraspRequest.at_pose(np.diag([1.0, 1.0, -1.0, 1.0]), 0.03, 0.05, own, 0.2)
    with pytest.raises(ValueError, match=r"\(n, 3\)"):
        GraspRequest.at_pose(np.eye(4), 0.03, 0.05, np.empty((0, 3)), 0.2)


def test_what_lies_on_something_is_placed_by_its_own_bottom():
    on_top = GraspRequest.at_pose(pose_at((0.46, 0, 0.32)), 0.03, 0.05, cube((0.46, 0, 0.3)), 0.2)
    assert on_top.base_height == pytest.approx(0.28)
    assert GraspRequest(0.4, 0.0, 0.0, table_height=0.2).base_height == 0.2
