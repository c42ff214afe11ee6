"""A table in physics at which several robots work, each with its own arms, hands and cameras.

Positions of the bench are in the frame of its world; each robot plans in its own base frame. One
arm moves at a time: the others hold still, and stand in its way as its own furniture does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from features.geometry import FloatArray
from rtask.errors import UsageError
from simulate.grasping.executor import Executor, GraspRequest
from simulate.motion.collision import Obstacle, body_obstacles
from simulate.robots import describe
from simulate.robots.cameras import camera_pose
from simulate.robots.description import (
    CameraMount,
    Floats,
    Pose,
    Range,
    RobotDescription,
    Workplace,
)
from simulate.world.camera import Lighting
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise
from simulate.world.objects import ObjectSpec
from simulate.world.robot_body import RobotBody
from simulate.world.scene import PlacedObject, Placement, lay
from simulate.world.world import PlaceBox, World, box_message, surface_message

__all__ = ["OTHER_ROBOT", "Area", "Bench", "Layout", "Post", "Station", "moved_obstacle"]


@dataclass(frozen=True)
class Area:
    """A rectangle of the table that things stand on, or an open box.

    Parameters
    ----------
    name
        As people call it.
    x, y
        Ranges (low, high), m, frame of the bench.
    is_box
        Whether walls stand around it.
    """

    name: str
    x: Range
    y: Range
    is_box: bool = False

    def holds(self, x: float, y: float) -> bool:
        """Tell whether a point, m, frame of the bench, is within."""
        return self.x[0] <= x <= self.x[1] and self.y[0] <= y <= self.y[1]

    def distance(self, x: float, y: float) -> float:
        """Return how far a point, m, frame of the bench, is outside; 0 within."""
        return float(
            np.hypot(max(self.x[0] - x, x - self.x[1], 0.0), max(self.y[0] - y, y - self.y[1], 0.0))
        )


@dataclass(frozen=True)
class Post:
    """Where a robot stands at a bench, and what its hands get to.

    Parameters
    ----------
    robot
        Its name.
    kind
        One of :func:`simulate.robots.known_robots`.
    reach
        Names of the areas that each of its arms, by name, gets to. Arms without any rest.
    at : (x, y)
        Of its base, m, frame of the bench.
    is_opposite
        Whether it faces the other way, along -x.
    cameras
        Places (x, y), m, base frame, that cameras on stands look at, by name, beside those of its
        kind.
    """

    robot: str
    kind: str
    reach: Mapping[str, tuple[str, ...]]
    at: tuple[float, float] = (0.0, 0.0)
    is_opposite: bool = False
    cameras: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Layout:
    """A table, its areas, and the robots around it.

    Parameters
    ----------
    table
        Height, near edge and size of the table, frame of the bench; heights of boxes, and the
        viewpoint of pictures.
    areas, posts
        Of the table; each name once.
    """

    table: Workplace
    areas: tuple[Area, ...]
    posts: tuple[Post, ...]

    def area(self, name: str) -> Area:
        """Return the area of a name."""
        for area in self.areas:
            if area.name == name:
                return area
        raise UsageError(f"the table has no area {name!r}")

    def area_at(self, x: float, y: float) -> str:
        """Return the name of the area that a point of the table belongs to; empty for none.

        Around areas without walls it is the nearest. What fell over and rolled aside lies a finger
        beyond a line that nobody sees: for people it is still there, and hands get to it.

        Parameters
        ----------
        x, y
            m, frame of the bench.
        """
        inside = next((area.name for area in self.areas if area.holds(x, y)), "")
        (x0, x1), (y0, y1) = self.table.table_x, self.table.table_y
        if inside or not (x0 <= x <= x1 and y0 <= y <= y1):
            return inside
        around = [(area.distance(x, y), area.name) for area in self.areas if not area.is_box]
        near, name = min(around, default=(np.inf, ""))
        return name if near < _AROUND_M else ""


class Bench:
    """Robots around a table, and things on it.

    Parameters
    ----------
    layout
        Of the table.
    placements
        The things, frame of the bench.
    assets
        Folder for meshes and prints.
    preset, lighting, noise_seed
        Of the physics and the cameras.
    """

    def __init__(
        self,
        layout: Layout,
        placements: Sequence[Placement],
        assets: Path,
        preset: str = "faithful",
        lighting: Lighting | None = None,
        noise_seed: tuple[int, ...] = (0,),
    ) -> None:
        self.layout = layout
        self.world = World(preset, workplace=layout.table)
        self.world.add_table()
        self.boxes = {
            area.name: _box_of(area, layout.table) for area in layout.areas if area.is_box
        }
        for box in self.boxes.values():
            self.world.add_box(box)
        lighting = lighting or Lighting()
        self.stations = {
            post.robot: Station(self, post, lighting, (*noise_seed, number))
            for number, post in enumerate(layout.posts)
        }
        self.laid: list[PlacedObject] = lay(self.world, placements, assets)

    def close(self) -> None:
        """End the physics."""
        self.world.close()

    def put(self, body: int, x: float, y: float) -> None:
        """Put a thing somewhere on the table by hand, as a person does, and let it settle."""
        spec = self.world.objects[body]
        height = self.world.table_height + spec.rest_height
        self.world.put(body, (x, y, height), (0.0, 0.0, 0.0, 1.0))
        self.world.step(_SETTLE_S)

    def product_at(self, station: Station, position: Floats) -> ObjectSpec | None:
        """Return the product that a robot points at, (2,) m, its base frame, as people know it."""
        at = (station.world_from_base @ [*position[:2], 0.0, 1.0])[:2]
        nearest, product = _NEAR_M, None
        for body, spec in self.world.objects.items():
            pose = self.world.object_pose(body)
            away = float(np.hypot(pose.x - at[0], pose.y - at[1]))
            if away < nearest:
                nearest, product = away, spec
        return product

    def area_of(self, body: int) -> str:
        """Return the name of the area in which a thing truly lies; empty for none. For scoring."""
        pose = self.world.object_pose(body)
        above = pose.z - self.world.table_height
        return self.layout.area_at(pose.x, pose.y) if -_LOW_M < above < _LOW_M else ""


class Station:
    """A robot at its post: its executor, its cameras, and the areas in its own frame.

    Parameters
    ----------
    bench, post
        Where it stands.
    lighting, noise_seed
        Of its cameras.
    """

    def __init__(
        self, bench: Bench, post: Post, lighting: Lighting, noise_seed: tuple[int, ...]
    ) -> None:
        self.bench, self.post = bench, post
        self.description = _at_bench(describe(post.kind), post, bench.layout.table)
        lift = bench.layout.table.table_height - self.description.workplace.table_height
        self.world_from_base = _standing(post, lift)
        self.robot = RobotBody(bench.world, self.description, self.world_from_base)
        self.eyes = Eyes(self.robot, lighting, SensorNoise(), noise_seed)
        own = {name for names in post.reach.values() for name in names}
        boxes = {name: self.seen(box) for name, box in bench.boxes.items()}
        self.boxes = {name: box for name, box in boxes.items() if name in own}
        self.executor = Executor(
            bench.world, self.robot, self.eyes,
            boxes={box.side: box for box in self.boxes.values()},
            furniture=[box for name, box in boxes.items() if name not in own],
        )  # fmt: skip

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms that work here."""
        return tuple(self.post.reach)

    def seen(self, box: PlaceBox) -> PlaceBox:
        """Return a box of the bench in the frame of this robot."""
        x, y = self._ranges(box.x_range, box.y_range)
        lift = float(self.world_from_base[2, 3])
        side = "left" if sum(y) > 0 else "right"
        return PlaceBox(side, x, y, box.floor - lift, box.rim - lift, box.wall)

    def places(self) -> list[dict[str, Any]]:
        """Return the areas and boxes that its hands get to, as it registers them."""
        return [
            box_message(name, self.boxes[name]) if name in self.boxes
            else surface_message(name, *self.ranges(name), self.description.workplace.table_height)
            for name in dict.fromkeys(n for names in self.post.reach.values() for n in names)
        ]  # fmt: skip

    def ranges(self, name: str) -> tuple[Range, Range]:
        """Return the ranges of x and y of an area, m, base frame of this robot."""
        area = self.bench.layout.area(name)
        return self._ranges(area.x, area.y)

    def area_at(self, position: Floats) -> str:
        """Return the name of the area that a point (3,), m, base frame, belongs to; or empty."""
        x, y = (self.world_from_base @ [*position[:2], 0.0, 1.0])[:2]
        return self.bench.layout.area_at(float(x), float(y))

    def _ranges(self, x: Range, y: Range) -> tuple[Range, Range]:
        base_from_world = np.linalg.inv(self.world_from_base)
        corners = np.array([[x[0], y[0], 0.0, 1.0], [x[1], y[1], 0.0, 1.0]]) @ base_from_world.T
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))

    def gets_to(
        self, arm: str, at: Floats, request: GraspRequest, angle: float,
        beside: Sequence[Obstacle] = (),
    ) -> bool:  # fmt: skip
        """Return whether an arm gets its hand around something that another robot holds now.

        Parameters
        ----------
        at : (4,) float, m
            Where it is to stand, frame of the bench, homogeneous.
        request
            The grasp by which it is held.
        angle
            Closing direction about the vertical, rad, frame of the bench.
        beside
            What stands around it, frame of the bench.
        """
        base_from_world = np.linalg.inv(self.world_from_base)
        x, y = (base_from_world @ at)[:2]
        angle += float(np.arctan2(base_from_world[1, 0], base_from_world[0, 0]))
        asked = GraspRequest(
            float(x), float(y), angle, width=request.width, height=request.height,
            length=request.length, round=request.round, arm=arm, only_theta=True,
            table_height=self.description.workplace.table_height,
        )  # fmt: skip
        there = [moved_obstacle(obstacle, base_from_world) for obstacle in beside]
        return self.executor.planner.gets_to(arm, asked, _ASKED_SEED, there)

    def others(self) -> list[Obstacle]:
        """Return the other robots as they stand now, base frame of this one.

        Robots at one table know the joints of each other, as tf tells them.
        """
        base_from_world = np.linalg.inv(self.world_from_base)
        return [
            moved_obstacle(replace(obstacle, name=OTHER_ROBOT), pose)
            for other in self.bench.stations.values()
            if other is not self
            for pose in [base_from_world @ other.world_from_base]
            for obstacle in other.solids()
        ]

    def solids(self) -> list[Obstacle]:
        """Return the robot as it stands now, base frame: one arm by its links, the rest by shapes.

        Of a link, the box around the spheres that cover it is taken: few solids are quick to avoid.
        """
        arm, *_ = self.robot.arms.values()
        solids = list(body_obstacles(self.robot.description, arm, self.robot.joint_values()))
        spheres = self.executor.space_of(self.robot.stance).spheres(arm.name, _OPEN)
        middles = spheres.places(self.robot.arm_joints(arm.name)[None])[0]
        radii = np.asarray(spheres.radii)[:, None]
        for link in np.unique(spheres.link):
            of_link = spheres.link == link
            low = (middles - radii)[of_link].min(axis=0)
            high = (middles + radii)[of_link].max(axis=0)
            solids.append(Obstacle.box(OTHER_ROBOT, (low + high) / 2, high - low))
        return solids


def moved_obstacle(obstacle: Obstacle, pose: FloatArray) -> Obstacle:
    """Return an obstacle in another frame, given the pose (4, 4) of its frame in that, m."""
    centre = pose[:3, :3] @ obstacle.centre + pose[:3, 3]
    return replace(obstacle, centre=centre, rotation=pose[:3, :3] @ obstacle.rotation)


OTHER_ROBOT = "other robot"
"""Name of the obstacles that are other robots."""
_SETTLE_S = 0.5
_ASKED_SEED = 0
_NEAR_M = 0.06
_LOW_M = 0.15
"""Above or below the table: what is higher is held by a hand, and what is lower fell off."""
_AROUND_M = 0.05
"""Around an area, what still belongs to it."""
_OPEN = 0.95
_CAMERA_OFFSET_M = np.array([-0.12, 0.0, 0.42])
"""From what a camera on a stand looks at: on the robot's side, where nobody else is in its way."""


def _box_of(area: Area, table: Workplace) -> PlaceBox:
    side = "left" if sum(area.y) > 0 else "right"
    floor = table.table_height
    return PlaceBox(side, area.x, area.y, floor, floor + table.box_height)


def _standing(post: Post, lift: float) -> Floats:
    """Return ``world_from_base`` (4, 4) of a robot on a floor at which the table suits it."""
    pose = np.eye(4)
    if post.is_opposite:
        pose[:2, :2] = -np.eye(2)
    pose[:3, 3] = [*post.at, lift]
    return pose


def _at_bench(robot: RobotDescription, post: Post, table: Workplace) -> RobotDescription:
    """Return a robot with the table of a bench as its workplace, base frame."""
    own = robot.workplace
    x, y = table.table_x, table.table_y
    near = post.at[0] - x[1] if post.is_opposite else x[0] - post.at[0]
    # The plate as it lies around the robot, as wide to either side as it is to the farther one.
    width = 2 * max(abs(edge - post.at[1]) for edge in y)
    place = replace(
        own, table_near=near, table_size=(x[1] - x[0], width, table.table_size[2]),
        box_height=table.box_height,
    )  # fmt: skip
    cameras = dict(robot.cameras)
    root_from_base = np.linalg.inv(robot.base_from_root.matrix)
    for name, target in post.cameras.items():
        seen = np.array([*target, own.table_height])
        pose = Pose.of(root_from_base @ camera_pose(seen + _CAMERA_OFFSET_M, seen).matrix)
        cameras[name] = CameraMount(name, robot.root, pose, f"{name}_depth_optical_frame")
    return replace(robot, workplace=place, cameras=cameras)
