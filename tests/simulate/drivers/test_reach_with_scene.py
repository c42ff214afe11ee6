"""A motion planned around MoveIt's planning scene, which a stand-in for rclpy hands out."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.errors import RobotError, UsageError
from rtask.interop.ros.convert import fill, make_message
from simulate.act.reach import plan_reach
from simulate.drivers.scene import obstacles_of, scene_of
from simulate.grasping.executor import Workcell
from simulate.motion.collision import Obstacle, Surroundings
from tests.rtask.ros2.standin import World, install

pytest.importorskip("rosbags")

GOAL = (0.15, -0.1, 0.3)
WALL = (0.19, -0.22, 0.34)
"""In the way of the right arm: its plan of an empty table goes through here."""
SIDES = (0.02, 0.02, 0.14)
BOX, SPHERE, CYLINDER = 1, 2, 3


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World(engine_schema())
    install(made, lambda name, module: monkeypatch.setitem(sys.modules, name, module))
    return made


def primitive(name: str, kind: int, sides: Any, place: Any, frame: str = "base_footprint") -> Any:
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    given = {
        "id": name, "header": {"frame_id": frame},
        "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": turn},
        "primitives": [{"type": kind, "dimensions": [float(each) for each in sides]}],
        "primitive_poses": [
            {"position": dict(zip("xyz", map(float, place), strict=True)), "orientation": turn}
        ],
    }  # fmt: skip
    return fill(make_message("moveit_msgs/CollisionObject"), given, make_message)


def offer(world: World, *objects: Any) -> None:
    scene = make_message("moveit_msgs/PlanningScene")
    scene.world.collision_objects = list(objects)
    world.planning_scene = scene


def around(node: Any, said: list[str]) -> list[Any]:
    scene = scene_of(node, "base_footprint")
    assert scene is not None
    return obstacles_of(scene, 0.27, GOAL, said.append)


@pytest.fixture
def node(world: World) -> Any:
    return sys.modules["rclpy.lifecycle"].LifecycleNode("reach")


def deepest(cell: Workcell, plan: Any, box: Obstacle) -> float:
    """Return the least distance of the arm to a box on its way, m."""
    space = cell.executor.space_of(plan.stance)
    spheres, alone = space.spheres(plan.arm, plan.opening), Surroundings((box,))
    ways = np.concatenate([part.positions for part in (plan.free, plan.approach)])
    return float(spheres.clearances(ways, alone, np.zeros((1, len(spheres.radii)))).min())


def test_without_a_move_group_there_is_no_scene(node):
    assert scene_of(node, "base_footprint") is None


def test_the_table_and_what_is_reached_for_are_no_obstacles(world, node):
    offer(
        world,
        primitive("table", BOX, (1, 1, 0.02), (0.3, 0, 0.26)),
        primitive("cup", CYLINDER, (0.08, 0.03), GOAL),
        primitive("rtask/lamp", SPHERE, (0.05,), (0.3, 0.2, 0.4)),
        primitive("wall", BOX, SIDES, WALL),
    )
    said: list[str] = []
    ball, wall = around(node, said)
    assert (ball.name, ball.radius) == ("rtask/lamp", 0.05)
    assert wall.half.tolist() == [0.01, 0.01, 0.07]
    assert said == ["MoveIt's planning scene: cup is at the goal, and is what is reached for"]


def test_a_scene_that_cannot_be_placed_stops_the_motion(world, node, monkeypatch):
    monkeypatch.setattr("simulate.drivers.scene._WAIT_S", 0.05)
    offer(world, primitive("shelf", BOX, SIDES, WALL, frame="shelf_link"))
    with pytest.raises(UsageError, match="shelf: no transform from shelf_link"):
        around(node, [])
    offer(world)
    world.planning_scene.world.collision_objects = [plane("wall", (1.0, 0.0, 0.0, -0.5))]
    with pytest.raises(RobotError, match="wall of MoveIt's planning scene is a plane"):
        around(node, [])
    offer(world, plane("floor", (0.0, 0.0, 1.0, 0.0)))
    assert around(node, []) == []


def plane(name: str, coefficients: tuple[float, ...]) -> Any:
    made = primitive(name, BOX, SIDES, WALL)
    made.primitives, made.primitive_poses = [], []
    shape = make_message("shape_msgs/Plane")
    shape.coef = np.array(coefficients)
    made.planes, made.plane_poses = [shape], [make_message("geometry_msgs/Pose")]
    return made


def test_the_plan_goes_around_what_stands_in_its_way(world, node):
    offer(world, primitive("wall", BOX, SIDES, WALL))
    obstacles = around(node, [])
    with Workcell("nao", "fast") as cell:
        through = plan_reach(cell, GOAL, 0.0, 0)
        past = plan_reach(cell, GOAL, 0.0, 0, obstacles)
        assert through.arm == past.arm
        assert deepest(cell, through, obstacles[0]) < 0
        assert deepest(cell, past, obstacles[0]) >= 0
