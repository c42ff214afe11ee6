"""What stands between an agent and the shared graph: patience, and a robot without geometry."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from rtask.errors import CallFailedError, RemoteUnavailableError
from simulate.agent.agent import Server

__all__ = ["BlindServer", "PatientServer"]

_PAUSE_S = 0.5
_DIRECTIONS = 12
_BLIND_GRASPS = 10
_LOOK = ("data", "sensor_pose", "frame_id", "support_height")


class _Client(Protocol):
    """What :class:`PatientServer` needs of :func:`rtask.connect`."""

    def call(self, operation: str, /, **args: Any) -> dict[str, Any]: ...

    def tell(self, operation: str, /, **args: Any) -> dict[str, Any] | None: ...


class PatientServer:
    """Questions wait for an answer; what is told waits in the outbox while the robot works on.

    Parameters
    ----------
    client
        With an outbox.
    patience_s
        How long a question waits.
    on_wait
        Called with what could not be asked or told, each time.
    """

    def __init__(
        self,
        client: _Client,
        patience_s: float,
        on_wait: Callable[[str], None] = lambda operation: None,
    ) -> None:
        self._client = client
        self._patience_s = patience_s
        self._on_wait = on_wait

    def register_robot(self, **request: Any) -> dict[str, Any]:
        """Introduce the robot; see :meth:`recognise_for_grasp`."""
        return self._asked("register_robot", request)

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]:
        """Ask, again and again until somebody answers.

        Raises
        ------
        RemoteUnavailableError, CallFailedError
            Nobody did in time, or had the time to.
        """
        return self._asked("recognise_for_grasp", request)

    def _asked(self, operation: str, request: dict[str, Any]) -> dict[str, Any]:
        deadline = time.monotonic() + self._patience_s
        while True:
            try:
                return self._client.call(operation, **request)
            except RemoteUnavailableError:
                if time.monotonic() > deadline:
                    raise
            except CallFailedError as error:
                # A busy server says so (503), or that its own time for the call ran out (504).
                if not error.details.get("may_change") or time.monotonic() > deadline:
                    raise
            self._on_wait(operation)
            time.sleep(_PAUSE_S)  # the client has waited already; this only bounds its retries

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Tell now or later; told later, nobody knows yet under which name it is stored."""
        answer = self._client.tell("insert_object", **request)
        if answer is None:
            self._on_wait("insert_object")
            return {"objects": [{"object": item.get("object", "")} for item in request["objects"]]}
        return answer

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Tell now or later."""
        answer = self._client.tell("report_outcome", **request)
        if answer is None:
            self._on_wait("report_outcome")
        return answer or {}


class BlindServer:
    """A robot that cannot judge shapes: it tries what the graph knows to hold, else anything.

    A grasp that somebody held this object with before goes first. Without one the robot closes its
    hand somewhere over the object's bounding box, in any direction.

    Parameters
    ----------
    server
        The shared graph.
    rng
        Draws blind grasps.
    opening_m
        Of the hand before it closes.
    """

    def __init__(self, server: Server, rng: np.random.Generator, opening_m: float) -> None:
        self._server = server
        self._rng = rng
        self._opening_m = opening_m
        self._look: dict[str, Any] = {}

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]:
        """Ask for what is known, and add blind grasps after it."""
        self._look = {name: request[name] for name in _LOOK}
        answer = self._server.recognise_for_grasp(**{**request, "propose": False})
        held = [g for g in answer["grasps"] if _share_held(g) > 0.5]
        held.sort(key=_share_held, reverse=True)
        shape = answer["shape"]
        blind = [] if shape is None else [self._blind(shape, k) for k in range(_BLIND_GRASPS)]
        return {**answer, "grasps": [*held, *blind]}

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Tell the graph."""
        return self._server.insert_object(**request)

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Tell the graph; with the look, where only that says what a blind grasp was of."""
        if request["grasp"]["source"] != "blind":
            return self._server.report_outcome(**request)
        return self._server.insert_object(objects=[{**self._look, **request}])

    def _blind(self, shape: dict[str, float], number: int) -> dict[str, Any]:
        """Return a grasp that knows the bounding box only."""
        half = np.array([shape["length"], shape["width"]]) / 2
        a, b = self._rng.uniform(-half, half)
        cos, sin = math.cos(shape["yaw"]), math.sin(shape["yaw"])
        turn = int(self._rng.integers(_DIRECTIONS)) * math.pi / _DIRECTIONS
        height = min(max(0.5 * shape["height"], 0.008), 0.045)
        return {
            "id": f"candidate:blind-{number}",
            "source": "blind",
            "x": shape["x"] + cos * a - sin * b,
            "y": shape["y"] + sin * a + cos * b,
            "z": shape["support_height"] + height,
            "theta": (shape["yaw"] + turn) % math.pi,
            "width": min(shape["width"], self._opening_m),
            "opening": self._opening_m,
            "mean": 0.5,
        }


def _share_held(grasp: dict[str, Any]) -> float:
    """Return how often a remembered grasp held, over all robots."""
    counted = grasp["statistics"]
    return float(counted["successes"]) / max(int(counted["attempts"]), 1)
