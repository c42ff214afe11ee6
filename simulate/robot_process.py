"""One simulated robot as a process of its own: a world, a body, a connection to the graph.

Started as ``python -m simulate.robot_process JOB`` with the job as JSON and the token in the
environment variable ``RTASK_TOKEN``. It prints one JSON event a line and begins at ``go`` on its
standard input; when that closes it ends.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import rtask
from features.geometry import FloatArray, Frame
from rtask.errors import RtaskError
from simulate.agent import Agent, AgentConfig, Server
from simulate.camera import Camera, Lighting
from simulate.encounter import Encounter
from simulate.executor import Executor, GraspRecord, GraspRequest, PlannedGrasp
from simulate.job import Job
from simulate.noise import SensorNoise
from simulate.objects import sample_objects
from simulate.perception import Ignored, Seen
from simulate.robots.nao import Nao
from simulate.scene import Laid, arrange, lay
from simulate.scoring import Judge
from simulate.world import World

__all__ = ["SimulatedBody", "main"]

_PICTURE_SIZE = (320, 240)
_PICTURES = {"pregrasp": "pre_grasp", "close": "closed", "hold": "held", "place": "placed"}
# Streams of random numbers, one a purpose, so that one more draw here changes nothing there.
_PRODUCTS, _TABLE, _LIGHT, _NOISE, _CHOICE = range(5)


def stream(seed: int, *purpose: int) -> np.random.Generator:
    """Return the random numbers of one purpose."""
    return np.random.default_rng(np.random.SeedSequence((seed, *purpose)))


class SimulatedBody:
    """A Nao in a physics world, as the agent sees it."""

    def __init__(self, job: Job, assets: Path) -> None:
        self._job = job
        self.world = World(preset=job.preset, gui=job.gui)
        self.robot = Nao(self.world)
        self.base_frame = self.robot.base_frame
        self.gripper_ids = {side: self.robot.arm(side).end_effector for side in ("right", "left")}
        self.world.add_table()
        boxes = [self.world.add_place_box(side) for side in ("right", "left")]
        self.ignored = tuple(Ignored(box.x_range, box.y_range) for box in boxes)
        products = sample_objects(stream(job.seed, _PRODUCTS), job.objects)
        placements = arrange(products, stream(job.seed, _TABLE, job.index))
        self.laid: list[Laid] = lay(self.world, placements, assets)
        self.lighting = Lighting.sample(stream(job.seed, _LIGHT, job.index))
        self._noise = SensorNoise()
        self._noise_rng = stream(job.seed, _NOISE, job.index)
        self.camera = Camera(self.world.client)
        self.executor = Executor(self.world, self.robot)
        self._pictures = Path(job.pictures)
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
        """Grasp, and take a picture of each phase."""
        taken: list[tuple[str, bytes]] = []

        def picture(phase: str) -> None:
            if phase in _PICTURES:
                png = self.camera.snapshot(self.lighting, _PICTURE_SIZE, plan.arm.split("_")[0])
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


class Voice:
    """Prints events, one JSON object a line."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __call__(self, name: str, data: dict[str, Any]) -> None:
        self._stream.write(json.dumps({"event": name, **data}) + "\n")
        self._stream.flush()


def _run(job: Job, body: SimulatedBody, tell: Voice) -> None:
    """Connect, introduce the robot, clear the table, tell what came of it."""
    judge = Judge(body)
    first_sight: dict[int, int] = {}

    def on_sight(encounter: Encounter, seen: Seen) -> None:
        first_sight[encounter.number] = judge.body_under(seen)

    token = os.environ.get("RTASK_TOKEN")
    with rtask.connect(job.url, token=token, outbox=Path(job.outbox)) as client:
        client.call("register_robot", **body.robot.describe(job.name))
        in_reach = judge.in_reach()
        tell("ready", {"objects": len(body.laid), "in_reach": sum(in_reach.values())})
        if sys.stdin.readline().strip() != "go":
            return
        threading.Thread(target=_end_with_parent, daemon=True).start()
        started = time.perf_counter()
        config = AgentConfig(max_attempts=job.max_attempts, seed=_mixed(job))
        agent = Agent(body, cast(Server, client), config, on_event=tell, on_sight=on_sight)
        met = agent.clear_table()
        seconds = time.perf_counter() - started
    tell(
        "done",
        {
            "name": job.name,
            "seconds": seconds,
            "objects_on_table": len(body.laid),
            "encounters": judge.score(met, first_sight, in_reach),
        },
    )


def _mixed(job: Job) -> int:
    return int(stream(job.seed, _CHOICE, job.index).integers(2**31))


def _end_with_parent() -> None:
    """Leave at once when the parent's end of the pipe closes; the store needs no farewell."""
    while sys.stdin.readline():
        pass
    os._exit(1)


def main() -> None:
    """Run the job given as the one argument."""
    logging.basicConfig(level=os.environ.get("RTASK_LOG", "WARNING"), stream=sys.stderr)
    # Bullet and Mesa write to file descriptor 1; events get a private copy of it.
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    job = Job(**json.loads(sys.argv[1]))
    tell = Voice(events)
    try:
        with tempfile.TemporaryDirectory(prefix="rtask-assets-") as assets:
            body = SimulatedBody(job, Path(assets))
            try:
                _run(job, body, tell)
            finally:
                body.close()
    except RtaskError as error:
        sys.exit(f"{job.name}: {error}")


if __name__ == "__main__":
    main()
