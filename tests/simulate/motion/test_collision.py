"""Clearances are true distances, and the spheres cover the arm that the physics engine has."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from simulate.motion.collision import (
    ArmSpheres,
    Obstacle,
    Surroundings,
    _rounded,
    body_obstacles,
)
from simulate.robots import describe_nao
from simulate.robots.description import Pose, Shape
from simulate.robots.mesh_cover import hull_boxes
from simulate.world.robot_body import RobotBody
from simulate.world.world import World


def distance(obstacle, point):
    return float(Surroundings((obstacle,)).distances(np.array([point], dtype=float))[0, 0])


@pytest.mark.parametrize(
    ("point", "expected"),
    [((0, 0, 0), -0.1), ((0.5, 0, 0), 0.3), ((0.5, 0.5, 0), 0.5), ((0.1, 0, 0), -0.1)],
)
def test_distance_to_a_box(point, expected):
    box = Obstacle.box("b", (0, 0, 0), (0.4, 0.2, 0.6))
    assert distance(box, point) == pytest.approx(expected)


def test_distance_follows_the_boxs_yaw():
    box = Obstacle.box("b", (1.0, 0, 0), (0.4, 0.2, 0.6), yaw=np.pi / 2)
    assert distance(box, (1.0, 0.3, 0)) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("point", "expected"),
    [((0.05, 0, 0.05), 0.03), ((0, 0, 0.13), 0.03), ((0.05, 0, 0.14), 0.05), ((0, 0, 0.05), -0.02)],
)
def test_distance_to_an_upright_can_knows_the_rim(point, expected):
    can = Obstacle.upright("c", 0.0, 0.0, 0.0, (0.04, 0.10))
    assert distance(can, point) == pytest.approx(expected)


def test_as_high_as_wide_is_a_ball():
    ball = Obstacle.upright("c", 0.0, 0.0, 0.0, (0.04, 0.042))
    assert distance(ball, (0.03, 0.04, 0.021)) == pytest.approx(0.03)


def test_prism_around_points_is_the_smallest_and_reaches_the_table():
    rng = np.random.default_rng(0)
    local = rng.uniform([-0.06, -0.01, 0.30], [0.06, 0.01, 0.32], (500, 3))
    angle = np.deg2rad(35)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = local.copy()
    points[:, :2] = local[:, :2] @ turn.T + [0.15, -0.1]
    points = np.concatenate([points, [[np.nan] * 3]])
    prism = Obstacle.around("n", points, floor=0.27, margin=0.002)
    assert sorted(2 * prism.half[:2]) == pytest.approx([0.024, 0.124], abs=0.002)
    assert prism.centre[2] - prism.half[2] == pytest.approx(0.27)
    assert prism.centre[2] + prism.half[2] == pytest.approx(0.322, abs=0.001)
    inside = points[:-1].copy()
    assert (Surroundings((prism,)).distances(inside) <= 0).all()


def test_points_of_a_wrong_shape_are_named():
    with pytest.raises(ValueError, match=r"\(n, 3\) in m, got \(4, 2\)"):
        Obstacle.around("n", np.zeros((4, 2)), 0.27)


@pytest.fixture(scope="module")
def arm_and_world():
    description = describe_nao()
    with World() as world:
        robot = RobotBody(world, description)
        yield ArmSpheres.of(description, description.arm("right_arm"), 1.0), robot, world


def test_clearance_agrees_with_the_physics_engine(arm_and_world):
    """Spheres bulge 4 mm over a flat palm and lack 3 mm at its corners; else they are exact."""
    spheres, robot, world = arm_and_world
    wall = Obstacle.box("wall", (0.16, -0.12, 0.33), (0.05, 0.04, 0.10))
    body = world.add_wall(wall.centre, 2 * wall.half)
    links = {robot.link_index[name] for name in spheres.chain.links} | set(
        robot.hand_links["right_arm"]
    )
    around = Surroundings((wall,))
    chain = spheres.chain
    low, high = chain.lower, chain.upper
    rng = np.random.default_rng(5)
    near = 0
    for q in low + rng.random((150, 5)) * (high - low):
        ours = spheres.clearances(q[None], around, spheres.slack(around, {}))[0]
        robot.reset_arm("right_arm", q)
        found = world.client.getClosestPoints(robot.body, body, 0.10)
        theirs = min((p[8] for p in found if p[3] in links), default=0.10)
        if 0 < theirs < 0.09:
            near += 1
            assert -0.006 < ours - theirs < 0.004
        elif theirs <= 0:
            assert ours < 0.004
    assert near >= 15


def test_home_is_free_of_body_and_table(arm_and_world):
    spheres, robot, _ = arm_and_world
    description = robot.description
    homes = dict(zip(description.arm("left_arm").joints, robot.home("left"), strict=True))
    table = Obstacle.box("table", (0.34, 0, 0.22), (0.5, 0.8, 0.10))
    around = Surroundings(
        (*body_obstacles(description, description.arm("right_arm"), homes), table)
    )
    slack = spheres.slack(around, {("trunk", "upper"): np.inf})
    assert spheres.clearances(robot.home("right")[None], around, slack)[0] > 0.02


def test_folding_the_arm_into_the_chest_is_a_collision(arm_and_world):
    spheres, robot, _ = arm_and_world
    around = Surroundings(body_obstacles(robot.description, robot.description.arm("right_arm"), {}))
    slack = spheres.slack(around, {("trunk", "upper"): np.inf})
    folded = np.array([1.4, 0.3, 0.6, 1.54, 0.0])
    assert spheres.clearances(folded[None], around, slack)[0] < 0
    assert spheres.nearest(folded, around, slack)[0] == "trunk"


def test_a_load_moves_with_the_hand(arm_and_world):
    spheres, robot, _ = arm_and_world
    q = robot.home("right")
    rotation, position = spheres.chain.link_frames(q[None])
    there = rotation[0, -1] @ [0.1, 0.0, -0.1] + position[0, -1]
    wall = Surroundings((Obstacle.box("wall", there, (0.01, 0.01, 0.01)),))
    free = spheres.clearances(q[None], wall, spheres.slack(wall, {}))[0]
    loaded = spheres.carrying(np.array([[0.1, 0.0, -0.1]]), np.array([0.02]))
    assert free > 0 > loaded.clearances(q[None], wall, loaded.slack(wall, {}))[0]
    ignored = loaded.slack(wall, {("wall", "load"): np.inf})
    assert loaded.clearances(q[None], wall, ignored)[0] == pytest.approx(free)


def test_a_large_body_of_little_detail_is_covered_by_boxes_no_farther_than_its_hull(tmp_path):
    """One sphere around a pedestal reached over the robot's whole table."""
    rng = np.random.default_rng(3)
    foot, top = rng.uniform(-1, 1, (20, 2)) * 0.4, rng.uniform(-1, 1, (20, 2)) * 0.1
    mesh = trimesh.convex.convex_hull(
        np.vstack([np.c_[foot, np.zeros(20)], np.c_[top, np.full(20, 0.9)]])
    )
    path = tmp_path / "pedestal.obj"
    mesh.export(path)
    centres, halves = hull_boxes(str(path), (1.0, 1.0, 1.0))
    surface = mesh.sample(2000, seed=0)
    off = np.abs(surface[:, None] - centres) - halves
    assert (off.max(axis=2).min(axis=1) < 1e-6).all()
    above = np.array([[0.3, 0.3, 0.85]])  # free beside the column
    assert (np.abs(above[:, None] - centres) - halves).max(axis=2).min() > 0.1
    assert np.prod(2 * halves, axis=1).sum() < 2.5 * mesh.volume
    shape = Shape("mesh", (1.0, 1.0, 1.0), Pose(), str(path))
    assert {o.radius for o in _rounded("trunk", shape, np.eye(4))} == {0.0}
    small = Shape("mesh", (0.1, 0.1, 0.1), Pose(), str(path))
    assert all(o.radius > 0 for o in _rounded("trunk", small, np.eye(4)))
