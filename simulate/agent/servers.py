"""Server clients for agents: two that wait for answers, and one without geometry.

An endpoint may be slow or unavailable for a while. :class:`RetryingServer` repeats every call until
it is answered; :class:`OutboxServer` repeats requests only and leaves reports in the outbox.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from rtask.client import Client
from rtask.errors import CallFailedError, RemoteUnavailableError
from simulate.agent.agent import Server

__all__ = ["LONG_CALL_S", "BlindServer", "OutboxServer", "RetryingServer"]

LONG_CALL_S = 120.0
"""Time that a repeated call waits for its answer, s."""
_FIRST_CALL_S = 30.0
_PATIENCE_S = 900.0
_PAUSE_S = 0.5
_DIRECTIONS = 12
_BLIND_GRASPS = 10
_LOOK = ("data", "sensor_pose", "frame_id", "support_height")
_DECIDING = ("decide", "min_identity", "min_pose", "min_grasp", "unknown")


class _Client(Protocol):
    """Part of a client from :func:`rtask.connect` that :class:`OutboxServer` uses."""

    def call(self, operation: str, /, **args: Any) -> dict[str, Any]: ...

    def tell(self, operation: str, /, **args: Any) -> dict[str, Any] | None: ...


def _may_recover(error: RemoteUnavailableError | CallFailedError) -> bool:
    """Return whether a repeated call may succeed.

    A server may be busy (503), or its own time limit for the call may be exceeded (504).
    """
    return isinstance(error, RemoteUnavailableError) or bool(error.details.get("transient"))


class RetryingServer:
    """Repeats every call until it is answered; the server stores repeated reports only once.

    Parameters
    ----------
    client
        With an outbox.
    on_wait
        Called with the name of the operation whenever there was no answer, so that the caller can
        find out whether the server is slow or gone.
    patience_s
        Time after which the error of an unanswered call is raised.
    """

    def __init__(
        self, client: Client, on_wait: Callable[[str], None], patience_s: float = _PATIENCE_S
    ) -> None:
        self._client, self._on_wait, self._patience_s = client, on_wait, patience_s

    def register_robot(self, **request: Any) -> dict[str, Any]:
        """Introduce the robot."""
        return self._repeat("register_robot", request)

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]:
        """Ask which object this is and which grasps to try."""
        return self._repeat("recognise_for_grasp", request)

    def plan_on_scene(self, **request: Any) -> dict[str, Any]:
        """Ask for grasps of everything in a view."""
        return self._repeat("plan_on_scene", request)

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Report what was seen and the outcome of grasping it."""
        return self._repeat("insert_object", request)

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Report the outcome of a grasp."""
        return self._repeat("report_outcome", request)

    def report_refusal(self, **request: Any) -> dict[str, Any]:
        """Report what the robot did after a refusal."""
        return self._repeat("report_refusal", request)

    def _repeat(self, operation: str, request: dict[str, Any]) -> dict[str, Any]:
        deadline = time.monotonic() + self._patience_s
        call_s = _FIRST_CALL_S
        while True:
            try:
                if call_s > _FIRST_CALL_S:
                    self._client.deliver()  # earlier reports first, from the outbox
                return self._client.call(operation, call_s, **request)
            except (RemoteUnavailableError, CallFailedError) as error:
                if not _may_recover(error) or time.monotonic() > deadline:
                    raise
            call_s = LONG_CALL_S
            self._on_wait(operation)


class OutboxServer:
    """Repeats requests until they are answered; meanwhile reports wait in the outbox.

    Parameters
    ----------
    client
        With an outbox.
    patience_s
        Time after which an unanswered request raises its error.
    on_wait
        Called with the name of the operation whenever there was no answer.
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
        """Ask until an answer comes.

        Raises
        ------
        RemoteUnavailableError, CallFailedError
            No answer came in time, or the server refused.
        """
        return self._asked("recognise_for_grasp", request)

    def plan_on_scene(self, **request: Any) -> dict[str, Any]:
        """Ask for grasps of everything in a view; see :meth:`recognise_for_grasp`."""
        return self._asked("plan_on_scene", request)

    def _asked(self, operation: str, request: dict[str, Any]) -> dict[str, Any]:
        deadline = time.monotonic() + self._patience_s
        while True:
            try:
                return self._client.call(operation, **request)
            except (RemoteUnavailableError, CallFailedError) as error:
                if not _may_recover(error) or time.monotonic() > deadline:
                    raise
            self._on_wait(operation)
            time.sleep(_PAUSE_S)  # the client has waited already; this only bounds its retries

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Report now or later; if later, the IRI of a new object is not known yet."""
        answer = self._client.tell("insert_object", **request)
        if answer is None:
            self._on_wait("insert_object")
            return {"objects": [{"object": item.get("object", "")} for item in request["objects"]]}
        return answer

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Report now or later."""
        answer = self._client.tell("report_outcome", **request)
        if answer is None:
            self._on_wait("report_outcome")
        return answer or {}

    def report_refusal(self, **request: Any) -> dict[str, Any]:
        """Report now or later; see :meth:`report_outcome`."""
        answer = self._client.tell("report_refusal", **request)
        if answer is None:
            self._on_wait("report_refusal")
        return answer or {}


class BlindServer:
    """Simulates a robot that cannot judge shapes: it takes remembered grasps or random ones.

    Grasps that held this object before come first. After them come random positions over the
    object's bounding box with random closing directions.

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
        """Ask for remembered grasps and append blind ones, to which no decision applies."""
        self._look = {name: request[name] for name in _LOOK}
        asked = {name: value for name, value in request.items() if name not in _DECIDING}
        answer = self._server.recognise_for_grasp(**{**asked, "propose": False})
        held = [g for g in answer["grasps"] if _share_held(g) > 0.5]
        held.sort(key=_share_held, reverse=True)
        shape = answer["shape"]
        blind = [] if shape is None else [self._blind(shape, k) for k in range(_BLIND_GRASPS)]
        return {**answer, "grasps": [*held, *blind]}

    def plan_on_scene(self, **request: Any) -> dict[str, Any]:
        """Plan nothing: a robot without geometry has no grasps of a view."""
        return {"segments": [], "grasps": []}

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Report to the graph."""
        return self._server.insert_object(**request)

    def report_refusal(self, **request: Any) -> dict[str, Any]:
        """Report to the graph."""
        return self._server.report_refusal(**request)

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Report to the graph, for a blind grasp together with the view of the object."""
        if request["grasp"]["source"] != "blind":
            return self._server.report_outcome(**request)
        return self._server.insert_object(objects=[{**self._look, **request}])

    def _blind(self, shape: dict[str, float], number: int) -> dict[str, Any]:
        """Draw a grasp over the bounding box."""
        half = np.array([shape["length"], shape["width"]]) / 2
        a, b = self._rng.uniform(-half, half)
        cos, sin = math.cos(shape["yaw"]), math.sin(shape["yaw"])
        yaw_offset = int(self._rng.integers(_DIRECTIONS)) * math.pi / _DIRECTIONS
        height = min(max(0.5 * shape["height"], 0.008), 0.045)
        return {
            "id": f"candidate:blind-{number}",
            "source": "blind",
            "x": shape["x"] + cos * a - sin * b,
            "y": shape["y"] + sin * a + cos * b,
            "z": shape["support_height"] + height,
            "theta": (shape["yaw"] + yaw_offset) % math.pi,
            "width": min(shape["width"], self._opening_m),
            "opening": self._opening_m,
            "mean": 0.5,
        }


def _share_held(grasp: dict[str, Any]) -> float:
    """Return how often a remembered grasp held, over all robots."""
    counted = grasp["statistics"]
    return float(counted["successes"]) / max(int(counted["attempts"]), 1)
