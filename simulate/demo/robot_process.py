"""One simulated robot of a demo as a process: a world, a body, a connection to the graph.

Started as ``python -m simulate.demo.robot_process JOB`` with the job as JSON and the token in the
environment variable ``RTASK_TOKEN``. It prints one JSON event per line, begins at ``go`` on its
standard input, and ends when that is closed.
"""

from __future__ import annotations

import json
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import rtask
from features.geometry import Frame
from features.perception import Seen
from rtask.client import Client
from rtask.errors import RtaskError
from rtask.scratch import ScratchFolder
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.encounter import Encounter
from simulate.agent.frame_topic import FramePublisher
from simulate.agent.scoring import Scorer
from simulate.agent.servers import LONG_CALL_S, RetryingServer
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.demo.processes import RobotJob
from simulate.grasping.table_reach import arrange_for
from simulate.robots import describe
from simulate.world.camera import Lighting
from simulate.world.objects import sample_products, spec_of
from simulate.world.scene import Placement, arrange
from simulate.world.seeds import stream

__all__ = ["EventWriter", "clear_table", "lay_table", "main", "make_body"]

# Streams of random numbers, one per purpose.
_PRODUCTS, _TABLE, _LIGHT, _NOISE, _CHOICE = range(5)


def lay_table(job: RobotJob) -> list[Placement]:
    """Return the products of a robot's table with their places.

    Products with a secret stand where the robot reaches both of their ends; plain ones anywhere.
    """
    if job.only:
        products = [spec_of(job.only, job.mirrored)]
    else:
        products = sample_products(job.products, stream(job.seed, _PRODUCTS), job.objects)
    robot, rng = describe(job.robot), stream(job.seed, _TABLE, job.index)
    if job.products == "plain":
        placements = arrange(products, rng, workplace=robot.workplace)
    else:
        placements = arrange_for(robot, products, rng)
    if job.turned:
        placements = [replace(placed, yaw=placed.yaw + math.pi) for placed in placements]
    return placements


def make_body(job: RobotJob, assets: Path) -> SimulatedBody:
    """Create the body of a robot at its table."""
    conditions = Conditions(
        robot=job.robot,
        preset=job.preset,
        gui=job.gui,
        lighting=Lighting.sample(stream(job.seed, _LIGHT, job.index)),
        noise_seed=(job.seed, _NOISE, job.index),
        pictures=Path(job.pictures) if job.pictures else None,
        small_pictures=job.small_pictures,
        films=job.films,
    )
    return SimulatedBody(lay_table(job), assets, conditions)


class EventWriter:
    """Writes events, one JSON object per line."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __call__(self, name: str, data: dict[str, Any]) -> None:
        self._stream.write(json.dumps({"event": name, **data}) + "\n")
        self._stream.flush()


def clear_table(
    job: RobotJob,
    body: SimulatedBody,
    client: Client,
    *,
    tell: Callable[[str, dict[str, Any]], None],
    watch: Callable[[Frame], None] = lambda frame: None,
    may_begin: Callable[[], bool] = lambda: True,
) -> dict[str, Any] | None:
    """Register a robot and let it clear its table; return what it did, scored.

    Parameters
    ----------
    client
        Its connection to the graph.
    tell
        Called with the name and the data of each event.
    watch
        Called with each frame.
    may_begin
        Called when the robot is ready; None is returned if it answers no.
    """
    scorer = Scorer(body)
    first_sight: dict[int, int] = {}

    def on_sight(encounter: Encounter, seen: Seen) -> None:
        first_sight[encounter.number] = body_seen = scorer.body_under(seen)
        encounter.name = scorer.name_of(body_seen)

    def waiting(operation: str) -> None:
        tell("waiting", {"for": operation, "doing": "waiting for the endpoint"})

    server = RetryingServer(client, waiting)
    server.register_robot(**body.robot.describe(job.name))
    in_reach = scorer.in_reach()
    tell("ready", {"objects": len(body.laid), "in_reach": sum(in_reach.values())})
    if not may_begin():
        return None
    started = time.perf_counter()
    config = AgentConfig(max_attempts=job.max_attempts, seed=_mixed(job), thresholds=job.thresholds)
    agent = Agent(body, server, config, on_event=tell, on_sight=on_sight, on_frame=watch)
    encounters = agent.clear_table()
    return {
        "name": job.name,
        "seconds": time.perf_counter() - started,
        "products": [laid.placement.spec.name for laid in body.laid],
        "encounters": scorer.score(encounters, first_sight, in_reach),
    }


def _run(job: RobotJob, body: SimulatedBody, tell: EventWriter) -> None:
    """Connect, clear the table when told to begin, and report the result."""
    token = os.environ.get("RTASK_TOKEN")
    with ExitStack() as stack:
        watch = _unwatched
        if job.url:
            client = stack.enter_context(
                rtask.connect(job.url, token=token, timeout_s=LONG_CALL_S, outbox=Path(job.outbox))
            )
            watch = stack.enter_context(FramePublisher(job.url, job.name, token)).watch
        else:
            own = stack.enter_context(rtask.open(":memory:"))
            client = stack.enter_context(rtask.connect(own, agent=job.name))
        done = clear_table(job, body, client, tell=tell, watch=watch, may_begin=_is_to_begin)
    if done is not None:
        tell("done", done)


def _is_to_begin() -> bool:
    """Wait for the parent's ``go``, then end with the parent."""
    if sys.stdin.readline().strip() != "go":
        return False
    threading.Thread(target=_end_with_parent, daemon=True).start()
    return True


def _unwatched(frame: Frame) -> None:
    """Show a frame to nobody."""


def _mixed(job: RobotJob) -> int:
    return int(stream(job.seed, _CHOICE, job.index).integers(2**31))


def _end_with_parent() -> None:
    """Exit at once when the parent closes the pipe; the store needs no shutdown."""
    while sys.stdin.readline():
        pass
    os._exit(1)


def main() -> None:
    """Run the job given as the one argument."""
    logging.basicConfig(level=os.environ.get("RTASK_LOG", "WARNING"), stream=sys.stderr)
    # Bullet and Mesa write to file descriptor 1; events get a private copy of it.
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    job = RobotJob(**json.loads(sys.argv[1]))
    tell = EventWriter(events)
    try:
        with ScratchFolder("assets") as assets:
            body = make_body(job, assets)
            try:
                _run(job, body, tell)
            finally:
                body.close()
    except RtaskError as error:
        sys.exit(f"{job.name}: {error}")


if __name__ == "__main__":
    main()
