"""The body of a simulated robot, as :class:`simulate.agent.agent.Agent` uses it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from features.geometry import FloatArray, Frame
from features.perception import Ignored
from rtask.engine.perception.clutter import ClutterView
from rtask.interop.episodes.films import encode_film
from simulate.agent.films import FILM_HZ, Frames, filming
from simulate.grasping.executor import Executor, GraspRecord, GraspRequest, PlannedGrasp
from simulate.grasping.pushing import carry_out_push, plan_push
from simulate.robots import describe
from simulate.robots.description import Floats
from simulate.world.camera import Lighting
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise
from simulate.world.portrait import photograph
from simulate.world.robot_body import RobotBody
from simulate.world.scene import PlacedObject, Placement, lay
from simulate.world.world import World

__all__ = ["Conditions", "RobotAtTable", "SimulatedBody"]

_FREE_JOINTS = 6
_JPEG_QUALITY = 75
_PICTURE_SIZE = (480, 360)
_PICTURES = {"pregrasp": "pre_grasp", "close": "closed", "hold": "held", "place": "placed"}


@dataclass(frozen=True)
class Conditions:
    """Conditions under which a robot works.

    Parameters
    ----------
    robot
        Name of the kind of robot, from :func:`simulate.robots.known_robots`.
    preset
        Preset of the physics.
    gui
        Whether to show a window.
    lighting
        None selects the standard light.
    noise
        Noise of the camera.
    noise_seed
        Entropy of the camera's noise.
    pictures
        Folder for a picture of each phase of each grasp; None = no pictures are taken.
    small_pictures
        Whether these are JPEG, which takes a fifth of the room, and not PNG.
    films
        Whether two cameras film each grasp, besides pictures.
    """

    robot: str = "nao"
    preset: str = "faithful"
    gui: bool = False
    lighting: Lighting | None = None
    noise: SensorNoise = field(default_factory=SensorNoise)
    noise_seed: tuple[int, ...] = (0,)
    pictures: Path | None = None
    small_pictures: bool = False
    films: bool = False


class RobotAtTable:
    """A robot at a table in a physics world.

    Parameters
    ----------
    executor
        Of the robot, with its eyes.
    pictures
        Folder for a picture of each phase of each grasp; None = no pictures are taken.
    small_pictures
        Whether these are JPEG.
    films
        Whether two cameras film each grasp, besides pictures.
    """

    def __init__(
        self,
        executor: Executor,
        pictures: Path | None = None,
        small_pictures: bool = False,
        films: bool = False,
    ) -> None:
        self.executor, self.eyes = executor, executor.eyes
        self.world, self.robot = executor.world, executor.robot
        self.base_frame, self.preset = self.robot.base_frame, self.world.preset.name
        self.gripper_ids = {side: self.robot.arm(side).end_effector for side in ("right", "left")}
        joints = [len(chain.names) for chain in self.robot.chains.values()]
        self.takes_poses = min(joints) >= _FREE_JOINTS
        self.other_cameras = tuple(self.robot.description.cameras)[1:]
        # The contents of its boxes are ignored, and anything in front of the table is the robot.
        behind = Ignored((-np.inf, self.world.workplace.table_near - 0.02), (-np.inf, np.inf))
        boxes = self.world.place_boxes.values()
        self.ignored = (behind, *(Ignored(box.x_range, box.y_range) for box in boxes))
        self.watch: Callable[[PlannedGrasp], Callable[[str], None]] = lambda plan: _unwatched
        """Hook for scoring: called with each plan, it returns a function called at each phase."""
        self._pictures, self._films = pictures, films
        self._suffix = ".jpg" if small_pictures else ".png"
        self._taken = 0

    def look(self, side: str, camera: str | None = None) -> tuple[Frame, Floats]:
        """Turn the head towards a side and take a noisy frame, or take one with another camera."""
        return self.eyes.look(side, camera)

    def plan(
        self, request: GraspRequest, obstacles: list[FloatArray], seed: int
    ) -> PlannedGrasp | str:
        """Plan a grasp around what the camera saw."""
        clouds = [cloud.astype(np.float64) for cloud in obstacles]
        return self.executor.plan(request, obstacles=clouds, seed=seed)

    def execute(self, plan: PlannedGrasp) -> tuple[GraspRecord, list[tuple[str, bytes]]]:
        """Execute a plan; keep a picture of each phase and the motion if pictures are requested."""
        watch, taken = self.watch(plan), list[tuple[str, bytes]]()

        def on_phase(phase: str) -> None:
            watch(phase)
            if self._pictures is not None and phase in _PICTURES:
                taken.append((_PICTURES[phase], self._picture(plan)))

        with self._filming(plan) as films:
            record = self.executor.execute(plan, on_phase)
        if self._pictures is None:
            record = replace(record, motion=None)
        self._taken += 1
        if self._pictures is not None:
            self._pictures.mkdir(parents=True, exist_ok=True)
            for number, (phase, picture) in enumerate(taken, start=1):
                name = f"{self._taken:02d}-{number}-{phase}{self._suffix}"
                (self._pictures / name).write_bytes(picture)
        return record, taken + [(name, encode_film(f, FILM_HZ)) for name, f in films.items()]

    def _filming(self, plan: PlannedGrasp) -> AbstractContextManager[dict[str, Frames]]:
        if not self._films or self._pictures is None:
            return nullcontext({})
        side = "left" if plan.request.y > 0 else "right"
        return filming(self.world, self.eyes.camera, self.eyes.lighting, side)

    def push(
        self, points: FloatArray, others: Sequence[FloatArray], height: float, side: str, seed: int
    ) -> str:
        """Push a thing with the closed hand; return the reason code, empty if there is no way."""
        labels = np.repeat([1, 2], [len(points), sum(len(cloud) for cloud in others)])
        view = ClutterView(
            np.concatenate([points, *others]).astype(np.float64), labels.astype(np.int32),
            np.arange(len(labels)), np.zeros(3), np.array([0.0, 0.0, 1.0, -height]), height,
        )  # fmt: skip
        plan = plan_push(view, 1, self.executor, self.robot.arm(side).name, seed)
        return "" if plan is None else carry_out_push(self.executor, plan)

    def _picture(self, plan: PlannedGrasp) -> bytes:
        side = "left" if plan.request.y > 0 else "right"
        rgb = photograph(self.world, self.eyes.camera, _PICTURE_SIZE, side, self.eyes.lighting)
        _, picture = cv2.imencode(
            self._suffix, rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        )
        return picture.tobytes()


class SimulatedBody(RobotAtTable):
    """A robot in a physics world of its own, at a table with products.

    Parameters
    ----------
    placements
        The products on the table.
    assets
        Folder for meshes and prints.
    conditions
        Physics, light and noise.
    """

    def __init__(
        self, placements: Sequence[Placement], assets: Path, conditions: Conditions
    ) -> None:
        description = describe(conditions.robot)
        world = World(conditions.preset, conditions.gui, description.workplace)
        robot = RobotBody(world, description)
        world.add_table()
        for side in ("right", "left"):
            world.add_place_box(side)
        self.laid: list[PlacedObject] = lay(world, placements, assets)
        self.lighting = conditions.lighting or Lighting()
        eyes = Eyes(robot, self.lighting, conditions.noise, conditions.noise_seed)
        super().__init__(
            Executor(world, robot, eyes),
            conditions.pictures,
            conditions.small_pictures,
            conditions.films,
        )

    def close(self) -> None:
        """End the physics."""
        self.world.close()


def _unwatched(phase: str) -> None:
    """Do nothing at the end of a phase."""
