"""One robot of a fleet as a process that clears one table after another.

Started as ``python -m simulate.fleet.member JOB`` with the token in ``RTASK_TOKEN``. It prints
``ready`` before each table, begins it at ``go``, and ends when its standard input is closed.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import Any, cast

import rtask
from features.perception import Seen
from rtask.client import Client
from rtask.errors import RemoteUnavailableError, RtaskError
from rtask.scratch import ScratchFolder
from simulate.agent.agent import Agent, AgentConfig, Server
from simulate.agent.encounter import Encounter
from simulate.agent.scoring import Scorer
from simulate.agent.servers import BlindServer, OutboxServer
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.demo.robot_process import EventWriter
from simulate.fleet.assignment import MemberJob
from simulate.robots import describe
from simulate.world.camera import Lighting
from simulate.world.objects import spec_of
from simulate.world.scene import arrange
from simulate.world.seeds import stream

__all__ = ["Member", "main"]

_TABLE, _LIGHT, _NOISE, _CHOICE, _BLIND = range(40, 45)
Tell = Callable[[str, dict[str, Any]], None]

_CALL_TIMEOUT_S = 60.0


class Member:
    """A robot of a fleet and its tables.

    Parameters
    ----------
    job
        Its task.
    client
        Its connection to the graph.
    tell
        Called with the name and the data of each event.
    assets
        Folder for the meshes of its objects.
    """

    def __init__(self, job: MemberJob, client: Client, tell: Tell, assets: Path) -> None:
        self.job, self.client, self.tell, self.assets = job, client, tell, assets
        self._introduced = False

    def work(self, wait_for_go: SimpleQueue[str]) -> None:
        """Clear all tables, then deliver the outbox."""
        for number in range(len(self.job.tables)):

            def wait(number: int = number) -> None:
                self.tell("ready", {"table": number})
                wait_for_go.get()

            self.clear(number, wait)
        self._deliver()

    def clear(self, number: int, wait: Callable[[], None] = lambda: None) -> list[dict[str, Any]]:
        """Clear one table; return its encounters, scored against ground truth.

        Parameters
        ----------
        wait
            Called when the robot is ready at the table.
        """
        body = self._body(number)
        try:
            self._introduce(body)
            wait()
            return self._clear(body, number)
        finally:
            body.close()

    def _body(self, number: int) -> SimulatedBody:
        job, key = self.job, (self.job.index, number)
        products = [spec_of(name, job.look_alikes) for name in job.tables[number]]
        conditions = Conditions(
            robot=job.robot,
            preset=job.preset,
            lighting=Lighting.sample(stream(job.seed, _LIGHT, *key)),
            noise_seed=(job.seed, _NOISE, *key),
        )
        workplace = describe(job.robot).workplace
        placements = arrange(products, stream(job.seed, _TABLE, *key), workplace=workplace)
        return SimulatedBody(placements, self.assets, conditions)

    def _introduce(self, body: SimulatedBody) -> None:
        if not self._introduced:
            self._server().register_robot(**body.robot.describe(self.job.name))
            self._introduced = True

    def _clear(self, body: SimulatedBody, number: int) -> list[dict[str, Any]]:
        job, scorer, first_sight = self.job, Scorer(body), {}

        def on_sight(encounter: Encounter, seen: Seen) -> None:
            first_sight[encounter.number] = body_seen = scorer.body_under(seen)
            encounter.name = scorer.name_of(body_seen)

        in_reach = scorer.in_reach()
        choice = int(stream(job.seed, _CHOICE, job.index, number).integers(2**31))
        server: Any = self._server()
        if not job.prior:
            mouth = min(arm.mouth for arm in body.robot.arms.values())
            server = BlindServer(server, stream(job.seed, _BLIND, job.index, number), mouth)
        config = AgentConfig(max_attempts=job.max_attempts, seed=choice)
        agent = Agent(body, cast(Server, server), config, self.tell, on_sight)
        started = time.perf_counter()
        encounters = agent.clear_table()
        done = {"table": number, "seconds": time.perf_counter() - started}
        scored = scorer.score(encounters, first_sight, in_reach)
        self.tell("table", {**done, "encounters": scored})
        return scored

    def _server(self) -> OutboxServer:
        return OutboxServer(self.client, self.job.patience_s, self._waited)

    def _waited(self, operation: str) -> None:
        self.tell("waiting", {"for": operation, "outbox": self.client.waiting})

    def _deliver(self) -> None:
        """Deliver the outbox; reports that cannot be delivered in time stay for the next run."""
        deadline = time.monotonic() + self.job.patience_s
        while self.client.waiting and time.monotonic() < deadline:
            try:
                self.client.deliver()
            except RemoteUnavailableError:
                self._waited("deliver")
        self.tell("done", {"undelivered": self.client.waiting})


def _listen(lines: SimpleQueue[str]) -> None:
    """Pass on the parent's lines; exit at once when it is gone, as the store needs no shutdown."""
    for line in sys.stdin:
        lines.put(line.strip())
    os._exit(1)


def main() -> None:
    """Run the job given as the one argument."""
    # Bullet and Mesa write to file descriptor 1; events get a private copy of it.
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    job = MemberJob(**json.loads(sys.argv[1]))
    lines: SimpleQueue[str] = SimpleQueue()
    threading.Thread(target=_listen, args=(lines,), daemon=True).start()
    token = os.environ.get("RTASK_TOKEN")
    try:
        with (
            ScratchFolder("assets") as assets,
            rtask.connect(
                job.url, token=token, timeout_s=_CALL_TIMEOUT_S, outbox=Path(job.outbox)
            ) as client,
        ):
            Member(job, client, EventWriter(events), assets).work(lines)
    except RtaskError as error:
        sys.exit(f"{job.name}: {error}")


if __name__ == "__main__":
    main()
