"""An animated picture of robots at work, side by side, for documentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RobotError, UsageError
from rtask.scratch import ScratchFolder
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.executor import PlannedGrasp
from simulate.robots import describe
from simulate.study.judging import grasp_across
from simulate.world.animation import check_film, write_animation
from simulate.world.objects import sample_objects
from simulate.world.portrait import LIGHT, portrait
from simulate.world.scene import Placement, arrange
from simulate.world.seeds import mix_seed, stream

__all__ = ["Film", "film_robot", "write_film"]

_PRODUCTS, _TABLE = range(80, 82)

Frames = list[NDArray[np.uint8]]


@dataclass(frozen=True)
class Film:
    """Settings of a film.

    Parameters
    ----------
    size : (width, height), px
        Of each robot's half.
    frames_per_s
        Pictures in each simulated second.
    speed
        Simulated seconds shown in one second.
    objects
        Objects on each table; the robot grasps those on its right side.
    """

    size: tuple[int, int] = (640, 360)
    frames_per_s: float = 3.0
    speed: float = 2.0
    objects: int = 4
    seed: int = 0


def film_robot(kind: str, film: Film, preset: str = "faithful") -> Frames:
    """Return the pictures (h, w, 3) RGB of one robot that grasps an object and puts it down."""
    products = sample_objects(stream(film.seed, _PRODUCTS), film.objects)
    place = describe(kind).workplace
    placements = arrange(products, stream(film.seed, _TABLE), workplace=place)
    with ScratchFolder("assets") as assets:
        conditions = Conditions(robot=kind, preset=preset, lighting=LIGHT)
        body = SimulatedBody(placements, assets, conditions)
        try:
            plan = _first_plan(body, placements, film.seed)
            frames: Frames = []

            def take() -> None:
                if body.world.time >= len(frames) / film.frames_per_s + started:
                    shot = portrait(body.world, body.eyes.camera, film.size, "right")
                    frames.append(shot)

            started = body.world.time
            body.world.on_step = take
            body.execute(plan)
            return frames
        finally:
            body.close()


def _first_plan(body: SimulatedBody, placements: Sequence[Placement], seed: int) -> PlannedGrasp:
    """Return a plan for the first object on the right that the robot can grasp.

    Raises
    ------
    RobotError
        It can grasp none.
    """
    for placement in sorted(placements, key=lambda spot: spot.y):
        if placement.y < 0:
            plan = body.executor.plan(grasp_across(body, placement), seed=mix_seed(seed))
            if isinstance(plan, PlannedGrasp):
                return plan
    raise RobotError(f"no object can be grasped at seed {seed}; try another --seed")


def write_film(path: Path, robots: Sequence[Frames], film: Film) -> None:
    """Write the pictures of robots side by side as one animated picture.

    Parameters
    ----------
    path
        ``.webp``, ``.png`` (APNG) or ``.gif``.
    robots
        Pictures of each robot; one that has finished stands still.

    Raises
    ------
    UsageError
        As :func:`simulate.world.animation.check_film`, or there is nothing to show.
    """
    check_film(path)
    if not robots or not all(robots):
        raise UsageError("there are no pictures to show")
    count = max(map(len, robots))
    rows = [np.hstack([frames[min(k, len(frames) - 1)] for frames in robots]) for k in range(count)]
    pause_ms = round(1000 / (film.frames_per_s * film.speed))
    write_animation(path, rows, pause_ms)
