"""A simulated robot as the drivers of a real one would show it in ROS."""

from __future__ import annotations

import json
import math
import queue
import time
from collections.abc import Callable

from rtask.errors import RemoteUnavailableError, RtaskError
from rtask.interop.ros.convert import JsonObject, time_of
from simulate.act.service import ActService
from simulate.ros.front import Front
from simulate.ros.sensors import Rates, Sensors
from simulate.ros.trajectories import ArmAction

__all__ = ["RosBody"]

_TICK_S = 0.02
_ACT_S = 120.0


class RosBody:
    """Sensors, action servers and the act service of a robot; the physics runs in :meth:`run`.

    Parameters
    ----------
    front
        ROS.
    service
        The act service of the robot.
    is_clock
        Publish simulated time.
    prefix
        Before the names of its frames.
    is_paced
        Keep to the time of the wall; else run as fast as it goes.
    """

    def __init__(
        self,
        front: Front,
        service: ActService,
        rates: Rates,
        is_clock: bool = False,
        prefix: str = "",
        is_paced: bool = True,
    ) -> None:
        self._service, self._is_paced = service, is_paced
        self._world = service.cell.world
        self._work: queue.Queue[Callable[[], None]] = queue.Queue()
        self._sensors = Sensors(front, service.cell.robot, rates, is_clock, prefix)
        self._world.on_step = self._stepped
        self._started, self._began = time.monotonic(), self._world.time
        self.arms = [
            ArmAction(
                front,
                service.cell.robot,
                arm,
                self._work.put,
                lambda: not service.has_the_arm,
                self._now,
            )
            for arm in service.cell.robot.arms
        ]
        front.offer_act("act", self._act)

    def _now(self) -> float:
        """Return the time with which the robot stamps, s."""
        secs, nsecs = time_of(self._sensors.now())
        return secs + nsecs / 1e9

    def run(self, is_ended: Callable[[], bool]) -> None:
        """Run the physics until the end, and what was posted in its order."""
        while not is_ended():
            try:
                self._work.get_nowait()()
            except queue.Empty:
                self._world.step(_TICK_S)

    def _stepped(self) -> None:
        """Publish after a step of the physics, and wait for the wall's time to catch up."""
        self._sensors.tick()
        ahead = (self._world.time - self._began) - (time.monotonic() - self._started)
        if ahead > 0 and self._is_paced:
            time.sleep(ahead)
        elif ahead < -1.0:  # too slow for the wall's time: do not race to catch up
            self._started, self._began = time.monotonic(), self._world.time

    def _act(self, request: JsonObject) -> JsonObject:
        """Carry out a request in the physics, and wait in the thread of the service's caller.

        Returns
        -------
        The fields of ``rtask_msgs/Act``'s response.
        """
        outcome: queue.Queue[JsonObject | RtaskError] = queue.Queue()

        def act() -> None:
            try:
                outcome.put(self._service.act(request))
            except RtaskError as error:
                outcome.put(error)

        self._work.put(act)
        try:
            answer = outcome.get(timeout=_ACT_S)
        except queue.Empty:
            raise RemoteUnavailableError(f"act: no answer within {_ACT_S:g} s") from None
        if isinstance(answer, RtaskError):
            raise answer
        names = ("success", "held", "placed", "reason", "theta", "arm")
        error_m = answer["distance_error_m"]
        return {
            **{name: answer[name] for name in names},
            "distance_error_m": math.nan if error_m is None else float(error_m),
            "record_json": json.dumps(answer["record"]),
        }
