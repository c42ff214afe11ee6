"""A physics world: its own client, a table, boxes to place into, objects.

No other file imports pybullet. Every call names its client, so that worlds are independent; a world
belongs to one thread.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rtask.errors import RobotError, UsageError
from rtask.scratch import ScratchFolder
from simulate.robots.description import Floats, Pose, Range, RobotDescription, Workplace
from simulate.robots.mesh_files import engine_mesh
from simulate.robots.urdf import urdf_text
from simulate.world.bodies import break_part, breakable_parts, create_object, mass_offset
from simulate.world.objects import Assets, ObjectSpec
from simulate.world.quiet import without_banner

with without_banner():
    import pybullet
    from pybullet_utils.bullet_client import BulletClient  # type: ignore[import-untyped]

__all__ = [
    "PRESETS",
    "BodyPose",
    "PlaceBox",
    "Preset",
    "World",
    "box_message",
    "places_of",
    "side_sign",
    "surface_message",
]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Preset:
    """Resolution of the physics; its name goes into every record.

    Parameters
    ----------
    step_s
        Time step, s.
    iterations
        Of the constraint solver, per step.
    """

    name: str
    step_s: float
    iterations: int


PRESETS = {
    "faithful": Preset("faithful", 1 / 480, 80),
    "fast": Preset("fast", 1 / 240, 50),
}

_TABLE_FRICTION = 0.6
_BREAK_CHECK_STEPS = 4

_TABLE_COLOUR = (0.62, 0.50, 0.38, 1.0)
_BOX_WALL = 0.003
_BOX_COLOUR = (0.36, 0.44, 0.52, 1.0)


def side_sign(side: str) -> int:
    """Return +1 for ``left`` or ``left_arm``, -1 for ``right`` or ``right_arm``."""
    signs = {"left": 1, "left_arm": 1, "right": -1, "right_arm": -1}
    if side not in signs:
        raise UsageError(f"unknown side {side!r}: expected left or right")
    return signs[side]


@dataclass(frozen=True)
class BodyPose:
    """Pose of a body's origin in the world: position (3,) m, quaternion (x, y, z, w)."""

    position: Floats
    quaternion: Floats

    @property
    def x(self) -> float:
        """Position along x, m."""
        return float(self.position[0])

    @property
    def y(self) -> float:
        """Position along y, m."""
        return float(self.position[1])

    @property
    def z(self) -> float:
        """Position along z, m."""
        return float(self.position[2])

    @property
    def rotation(self) -> Floats:
        """``world_from_body`` rotation (3, 3)."""
        x, y, z, w = self.quaternion
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def yaw(self) -> float:
        """Angle (rad) of the body's x axis in the horizontal plane."""
        rotation = self.rotation
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


@dataclass(frozen=True)
class PlaceBox:
    """An open box on the table: inner ranges (low, high) m, heights of floor and rim m."""

    side: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    floor: float
    rim: float
    wall: float = _BOX_WALL

    @classmethod
    def at(cls, place: Workplace, side: str, floor: float) -> PlaceBox:
        """Return the box of a side, ``left`` or ``right``, on a table of some height, m."""
        sign = side_sign(side)
        (x, y), half = place.box_centre, place.box_inner / 2
        return cls(
            "left" if sign > 0 else "right",
            (x - half, x + half),
            (y * sign - half, y * sign + half),
            floor,
            floor + place.box_height,
        )

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the floor, m."""
        return (sum(self.x_range) / 2, sum(self.y_range) / 2)

    def walls(self) -> Iterator[tuple[tuple[float, float, float], tuple[float, float, float]]]:
        """Yield centre and full size (m) of the four walls."""
        (x0, x1), (y0, y1), wall = self.x_range, self.y_range, self.wall
        x, y = self.centre
        z, height = (self.floor + self.rim) / 2, self.rim - self.floor
        across, along = x1 - x0 + 2 * wall, y1 - y0 + 2 * wall
        for edge in (x0 - wall / 2, x1 + wall / 2):
            yield (edge, y, z), (wall, along, height)
        for edge in (y0 - wall / 2, y1 + wall / 2):
            yield (x, edge, z), (across, wall, height)


def _with_engine_meshes(robot: RobotDescription, folder: Path) -> RobotDescription:
    """Return a robot whose meshes the engine reads; others are converted into a folder."""
    links = []
    for link in robot.links:
        shapes = tuple(
            replace(shape, path=str(engine_mesh(Path(shape.path), folder)))
            if shape.kind == "mesh"
            else shape
            for shape in link.shapes
        )
        links.append(replace(link, shapes=shapes) if shapes != link.shapes else link)
    return replace(robot, links=tuple(links))


class World:
    """A physics world with its own client.

    Parameters
    ----------
    preset
        ``faithful`` (labels and tests of success) or ``fast`` (2 to 3 times cheaper; grasps hold
        less often, so its outcomes must not be mixed with the other's).
    gui
        Open a window; needs a display.
    workplace
        Table and boxes that suit the robot; None selects those of the smallest robot.

    Examples
    --------
    >>> with World() as world:
    ...     table = world.add_table()
    ...     world.step(0.1)
    ...     round(world.time, 3)
    0.1
    """

    def __init__(
        self, preset: str = "faithful", gui: bool = False, workplace: Workplace | None = None
    ) -> None:
        if preset not in PRESETS:
            raise UsageError(f"unknown preset {preset!r}: expected one of {', '.join(PRESETS)}")
        self.preset = PRESETS[preset]
        self.workplace = workplace or Workplace()
        self.client: Any = _connect(gui)
        self.table_height = float("nan")
        self.table_body = -1
        self._grounds: set[int] = set()
        self.place_boxes: dict[str, PlaceBox] = {}
        self.objects: dict[int, ObjectSpec] = {}
        self.broken: set[int] = set()
        """Objects of which a part has broken."""
        self._breakable: dict[tuple[int, int], float] = {}
        self._steps = self._moved_by_hand = 0
        self.on_step: Callable[[], None] = lambda: None
        """Called at the end of every :meth:`step`, in its thread."""
        self.before_each: list[Callable[[], None]] = []
        """Called before every single step of the physics."""
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=self.preset.step_s,
            numSolverIterations=self.preset.iterations,
            numSubSteps=0,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
        )
        self.client.setGravity(0, 0, -9.81)

    def __enter__(self) -> World:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        if self.client is not None and self.client.isConnected():
            self.client.disconnect()

    @property
    def time(self) -> float:
        """Simulated time since the world began, s."""
        return self._steps * self.preset.step_s

    @property
    def moment(self) -> tuple[float, int]:
        """The time, and how often something was put or taken away; nothing moves within one."""
        return self.time, self._moved_by_hand

    def step(self, seconds: float) -> None:
        """Run the physics for at least one step."""
        for _ in range(max(round(seconds / self.preset.step_s), 1)):
            for act in self.before_each:
                act()
            self.client.stepSimulation()
            self._steps += 1
            if self._breakable and self._steps % _BREAK_CHECK_STEPS == 0:
                self._break_parts()
        self.on_step()

    def add_table(self, height: float | None = None) -> int:
        """Add the table in front of the robot; return the body.

        Parameters
        ----------
        height
            Of its top, m; None = as the workplace has it.
        """
        place = self.workplace
        height = place.table_height if height is None else height
        length, _, thick = place.table_size
        centre = (place.table_near + length / 2, 0.0, height - thick / 2)
        self.table_body = self._static_box(centre, place.table_size, _TABLE_COLOUR)
        self.table_height = height
        return self.table_body

    def add_place_box(self, side: str) -> PlaceBox:
        """Add the box into which an arm places; ``side`` is left or right."""
        if not np.isfinite(self.table_height):
            raise UsageError("add the table before its boxes")
        box = PlaceBox.at(self.workplace, side, self.table_height)
        self.add_box(box)
        self.place_boxes[box.side] = box
        return box

    def add_box(self, box: PlaceBox) -> None:
        """Add the walls of a box on the table, which belongs to nobody yet."""
        for centre, size in box.walls():
            self._static_box(centre, size, _BOX_COLOUR)

    def box_for(self, side: int, y: float) -> PlaceBox | None:
        """Return the box that an arm of a side (0 = both) uses for something at y m, if any."""
        return self.place_boxes.get("left" if (side or y) > 0 else "right")

    def add_wall(self, centre: Sequence[float], size: Sequence[float]) -> int:
        """Add a static box of full ``size`` (m) at ``centre`` (m); return the body."""
        return self._static_box(centre, size, (0.5, 0.5, 0.5, 1.0))

    def _static_box(
        self, centre: Sequence[float], size: Sequence[float], colour: Sequence[float]
    ) -> int:
        half = [value / 2 for value in size]
        client = self.client
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=half)
        visual = client.createVisualShape(client.GEOM_BOX, halfExtents=half, rgbaColor=colour)
        body = int(client.createMultiBody(0, shape, visual, centre))
        client.changeDynamics(body, -1, lateralFriction=_TABLE_FRICTION)
        self._grounds.add(body)
        return body

    def load_urdf(self, robot: RobotDescription, world_from_base: Floats) -> int:
        """Load a described robot with a fixed base; return the body.

        Links that are not each other's ancestors collide.

        Parameters
        ----------
        robot
            The description.
        world_from_base : (4, 4) float
            Where the robot stands; z up.

        Raises
        ------
        RobotError
            A mesh cannot be read, or the engine refuses the robot.
        """
        world_from_root = Pose.of(world_from_base @ robot.base_from_root.matrix)
        client = self.client
        flags = (
            client.URDF_USE_INERTIA_FROM_FILE | client.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS
        )
        with ScratchFolder("urdf") as folder:
            path = folder / f"{robot.name}.urdf"
            path.write_text(urdf_text(_with_engine_meshes(robot, folder)), encoding="utf-8")
            try:
                body = client.loadURDF(
                    str(path),
                    world_from_root.xyz,
                    client.getQuaternionFromEuler(world_from_root.rpy),
                    useFixedBase=True,
                    flags=flags,
                )
            except pybullet.error as error:
                raise RobotError(f"{robot.name}: the physics engine refuses it: {error}") from error
        return int(body)

    def spawn(
        self,
        spec: ObjectSpec,
        position: Sequence[float],
        yaw: float = 0.0,
        assets: Assets | None = None,
    ) -> int:
        """Put an object on the table.

        Parameters
        ----------
        spec
            What it is.
        position : (x, y) or (x, y, z), m
            Of its origin, the centre of mass; without z it rests on the table.
        yaw
            rad.
        assets
            Mesh and texture for the camera; None shows plain primitives.

        Returns
        -------
        int
            The body.
        """
        z = position[2] if len(position) > 2 else self.table_height + spec.rest_height
        pose = (float(position[0]), float(position[1]), float(z))
        body = create_object(self.client, spec, assets)
        self.objects[body] = spec
        self.put(body, pose, self.client.getQuaternionFromEuler((0, 0, yaw)))
        for link, force in breakable_parts(spec).items():
            self._breakable[body, link] = force
        return body

    def remove(self, body: int) -> None:
        """Remove an object from the world."""
        self._moved_by_hand += 1
        self.client.removeBody(body)
        self.objects.pop(body, None)
        self.broken.discard(body)
        self._breakable = {k: force for k, force in self._breakable.items() if k[0] != body}

    def on_table(self, body: int) -> bool:
        """Tell whether a body touches the table."""
        return self.table_body >= 0 and len(self.client.getContactPoints(body, self.table_body)) > 0

    def object_pose(self, body: int) -> BodyPose:
        """Return the true pose of an object, for scoring only."""
        # Bullet tells the pose of the centre of mass.
        position, quaternion = self.client.getBasePositionAndOrientation(body)
        pose = BodyPose(np.array(position), np.array(quaternion))
        spec = self.objects.get(body)
        if spec is None or not spec.secret.mass_offset_m:
            return pose
        return BodyPose(pose.position - pose.rotation @ mass_offset(spec), pose.quaternion)

    def put(self, body: int, position: Sequence[float], quaternion: Sequence[float]) -> None:
        """Put an object's origin at a position (m) and orientation (x, y, z, w), at rest."""
        self._moved_by_hand += 1
        pose = BodyPose(np.array(position, dtype=np.float64), np.array(quaternion))
        spec = self.objects.get(body)
        centre = pose.position
        if spec is not None:
            centre = centre + pose.rotation @ mass_offset(spec)
        self.client.resetBasePositionAndOrientation(body, centre.tolist(), list(quaternion))
        self.client.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0])

    def _break_parts(self) -> None:
        """Break the parts that something presses harder than they stand."""
        for (body, link), limit in list(self._breakable.items()):
            contacts = self.client.getContactPoints(bodyA=body, linkIndexA=link)
            if any(c[9] > limit and c[2] not in self._grounds for c in contacts):
                del self._breakable[body, link]
                self.broken.add(body)
                break_part(self.client, body, link, sorted(self._grounds))


def _connect(gui: bool) -> Any:
    if not gui:
        with without_banner():
            return BulletClient(pybullet.DIRECT)
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise RobotError("no display for the simulation window: set DISPLAY or leave gui off")
    try:
        client = BulletClient(pybullet.GUI)
    except pybullet.error as error:
        raise RobotError(f"the simulation window does not open: {error}") from error
    if not client.isConnected():
        raise RobotError("the simulation window does not open: the display gives no OpenGL 3")
    client.configureDebugVisualizer(client.COV_ENABLE_GUI, 0)
    return client


def places_of(world: World) -> list[dict[str, Any]]:
    """Return the table of a world and the boxes beside it; its frame is the robot's base frame.

    The names of the boxes are those under which robots report that they put something there.
    """
    if not np.isfinite(world.table_height):  # no table was added
        return []
    place = world.workplace
    table = surface_message("table", place.table_x, place.table_y, world.table_height)
    boxes = world.place_boxes.values()
    return [table, *(box_message(f"{box.side} box", box) for box in boxes)]


def box_message(name: str, box: PlaceBox) -> dict[str, Any]:
    """Return an open box, in the base frame of a robot."""
    return surface_message(name, box.x_range, box.y_range, box.floor, box.rim - box.floor)


def surface_message(
    name: str, x: Range, y: Range, height: float, rim_height: float = 0.0
) -> dict[str, Any]:
    """Return a level rectangle on which things stand.

    Parameters
    ----------
    x, y
        Ranges, m, in the base frame of the robot.
    height, rim_height
        Of the surface above the origin of that frame, and of the walls above the surface, m.
    """
    return {
        "name": name, "length": x[1] - x[0], "width": y[1] - y[0], "rim_height": rim_height,
        "pose": {
            "position": {"x": sum(x) / 2, "y": sum(y) / 2, "z": height},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
    }  # fmt: skip
