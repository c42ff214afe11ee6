"""The robot and the graph as an agent uses them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Frame
from features.perception import Ignored
from simulate.grasping.executor import GraspRecord, GraspRequest, PlannedGrasp

__all__ = ["Body", "Server"]


class Body(Protocol):
    """Robot that an agent moves, e.g. :class:`simulate.agent.simulated_body.SimulatedBody`."""

    @property
    def gripper_ids(self) -> Mapping[str, str]:
        """Name of the end effector of each side."""

    @property
    def base_frame(self) -> str:
        """Name of the base frame (tf)."""

    @property
    def preset(self) -> str:
        """Kind of physics that it is in: faithful, fast or real."""

    @property
    def takes_poses(self) -> bool:
        """Whether its arms bring the tool to any pose, with six joints or more."""

    @property
    def ignored(self) -> tuple[Ignored, ...]:
        """Regions of the table whose contents are ignored, such as the robot's boxes."""

    @property
    def other_cameras(self) -> Sequence[str]:
        """Names of further cameras that see the table, such as those over the boxes."""

    def look(self, side: str, camera: str | None = None) -> tuple[Frame, NDArray[np.float64]]:
        """Turn the head and return a frame with base_from_camera (4, 4).

        ``camera`` names one of :attr:`other_cameras`; None = the one in the head.
        """

    def plan(
        self, request: GraspRequest, obstacles: list[FloatArray], seed: int
    ) -> PlannedGrasp | str:
        """Return a plan, or the reason code why there is none."""

    def execute(self, plan: PlannedGrasp) -> tuple[GraspRecord, list[tuple[str, bytes]]]:
        """Execute a plan; return its record and pictures (phase, PNG)."""

    def push(
        self, points: FloatArray, others: Sequence[FloatArray], height: float, side: str, seed: int
    ) -> str:
        """Push a thing with the closed hand; return the reason code, empty if there is no way.

        Its points and those of the others are (n, 3), m, base frame, ``height`` is the table's.
        """


class Server(Protocol):
    """Operations of the engine that the agent calls; clients of :func:`rtask.connect` have them."""

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]: ...

    def plan_on_scene(self, **request: Any) -> Mapping[str, Any]: ...

    def insert_object(self, **request: Any) -> dict[str, Any]: ...

    def report_outcome(self, **request: Any) -> dict[str, Any]: ...

    def report_refusal(self, **request: Any) -> dict[str, Any]: ...
