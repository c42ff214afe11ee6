"""The body of a simulated robot, as :class:`simulate.agent.agent.Agent` uses it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Frame
from simulate.agent.perception import Ignored
from simulate.grasping.executor import Executor, GraspRecord, GraspRequest, PlannedGrasp
from simulate.robots import describe
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.robot_body import RobotBody
from simulate.world.scene import Laid, Placement, lay
from simulate.world.world import World

__all__ = ["Conditions", "SimulatedBody"]

_PICTURE_SIZE = (320, 240)
_PICTURES = {"pregrasp": "pre_grasp", "close": "closed", "hold": "held", "place": "placed"}


@dataclass(frozen=True)
class Conditions:
    """Conditions under which a robot works.

    Parameters
    ----------
    robot
        Which one: a name of :data:`simulate.robots.ROBOTS`.
    preset
        Of the physics.
    gui
        Show a window.
    lighting
        None = the standard light.
    noise
        Of the camera.
    noise_seed
        Entropy of the camera's noise.
    pictures
        Folder for a PNG of each phase of each grasp; None = no pictures are taken.
    """

    robot: str = "nao"
    preset: str = "faithful"
    gui: bool = False
    lighting: Lighting | None = None
    noise: SensorNoise = field(default_factory=SensorNoise)
    noise_seed: tuple[int, ...] = (0,)
    pictures: Path | None = None


class SimulatedBody:
    """A robot in a physics world at a table with products.

    Parameters
    ----------
    placements
        What stands on the table.
    assets
        Folder for meshes and prints.
    conditions
        Physics, light and noise.
    """

    def __init__(
        self, placements: Sequence[Placement], assets: Path, conditions: Conditions
    ) -> None:
        description = describe(conditions.robot)
        self.world = World(conditions.preset, conditions.gui, description.workplace)
        self.robot = RobotBody(self.world, description)
        self.base_frame = self.robot.base_frame
        self.gripper_ids = {side: self.robot.arm(side).end_effector for side in ("right", "left")}
        self.world.add_table()
        boxes = [self.world.add_place_box(side) for side in ("right", "left")]
        # Its boxes are its own business, and what stands before the table is the robot itself.
        behind = Ignored((-np.inf, self.world.workplace.table_near - 0.02), (-np.inf, np.inf))
        self.ignored = (behind, *(Ignored(box.x_range, box.y_range) for box in boxes))
        self.laid: list[Laid] = lay(self.world, placements, assets)
        self.lighting = conditions.lighting or Lighting()
        self._noise = conditions.noise
        self._noise_rng = np.random.default_rng(np.random.SeedSequence(conditions.noise_seed))
        self.camera = Camera(self.world.client)
        self.executor = Executor(self.world, self.robot)
        self._pictures = conditions.pictures
        self._taken = 0
        self.last_labels: NDArray[np.int32] = np.zeros((0, 0), np.int32)

    def look(self, side: str) -> tuple[Frame, NDArray[np.float64]]:
        """Turn the head towards a side and take a noisy frame."""
        base_from_camera = self.robot.look(side)
        frame, self.last_labels = self.camera.capture(base_from_camera, self.lighting)
        return self._noise.apply(frame, self._noise_rng), base_from_camera

    def plan(
        self, request: GraspRequest, obstacles: list[FloatArray], seed: int
    ) -> PlannedGrasp | str:
        """Plan a grasp around what the camera saw."""
        clouds = [cloud.astype(np.float64) for cloud in obstacles]
        return self.executor.plan(request, obstacles=clouds, seed=seed)

    def execute(self, plan: PlannedGrasp) -> tuple[GraspRecord, list[tuple[str, bytes]]]:
        """Carry out a plan, and take a picture of each phase if pictures are wanted."""
        if self._pictures is None:
            return self.executor.execute(plan), []
        taken: list[tuple[str, bytes]] = []

        def picture(phase: str) -> None:
            if phase in _PICTURES:
                side = "left" if plan.request.y > 0 else "right"
                place = self.world.workplace
                png = self.camera.snapshot(
                    self.lighting, _PICTURE_SIZE, side, place.eye, place.target
                )
                taken.append((_PICTURES[phase], png))

        record = self.executor.execute(plan, on_phase=picture)
        self._taken += 1
        self._pictures.mkdir(parents=True, exist_ok=True)
        for number, (phase, png) in enumerate(taken, start=1):
            name = f"{self._taken:02d}-{number}-{phase}.png"
            (self._pictures / name).write_bytes(png)
        return record, taken

    def close(self) -> None:
        """End the physics."""
        self.world.close()
