"""The act service on a rosbridge server: the robot advertises it and answers calls.

Everything runs in one thread, because physics must: calls are answered one after the other, in the
order of their arrival.
"""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from rtask.client.remote import addresses
from rtask.errors import (
    AuthenticationError,
    RemoteUnavailableError,
    RtaskError,
    UsageError,
    nearest,
)
from rtask.wire.message import Message, read
from rtask.wire.types import Number, Unit, Whole
from simulate.act.service import ActService
from simulate.act.trials import Trial, place_test, reach_test, reasons
from simulate.act.workspace import map_workspace

__all__ = ["ActProvider", "methods_of"]

log = logging.getLogger(__name__)

Method = Callable[[dict[str, Any]], dict[str, Any]]

_WAIT_S = 0.2
_AGAIN_S = 1.0
_OPEN_S = 10.0
_MAX_TRIALS = 1_000


class Trials(Message):
    """Random goals to try."""

    n: Annotated[Whole, Ge(1), Le(_MAX_TRIALS)] = 10
    """random goals"""
    seed: Annotated[Whole, Ge(0)] = 0
    """of the goals"""


class WorkspaceMap(Message):
    """Cells to try."""

    step: Annotated[Number, Unit("m"), Ge(0.002), Le(0.2)] = 0.03
    """size of a cell"""
    angles: Annotated[Whole, Ge(1), Le(72)] = 8
    """closing directions"""
    height: Annotated[Number, Unit("m")] | None = None
    """of the tool, base frame; 3 cm over the table when left out"""


def methods_of(service: ActService) -> dict[str, tuple[str, Method]]:
    """Return the services of a robot: relative name to type and function."""

    def trials(run: Callable[[ActService, int, int], list[Trial]]) -> Method:
        def method(message: dict[str, Any]) -> dict[str, Any]:
            asked = read(Trials, message)
            done = run(service, asked.n, asked.seed)
            return {
                "n": len(done),
                "reached": sum(trial.reached for trial in done),
                "reasons": reasons(done),
                "trials": [vars(trial) for trial in done],
            }

        return method

    def workspace(message: dict[str, Any]) -> dict[str, Any]:
        asked = read(WorkspaceMap, message)
        heights = () if asked.height is None else (asked.height,)
        space = service.cell.executor.space
        found = map_workspace(space, step=asked.step, heights=heights, angles=asked.angles)
        return {
            "x": found.x.tolist(),
            "y": found.y.tolist(),
            "heights": found.heights.tolist(),
            "arms": list(found.arms),
            "share": np.round(found.share, 4).tolist(),
        }

    return {
        "act": ("rtask/Act", service.act),
        "act/reach_test": ("rtask/ActTest", trials(reach_test)),
        "act/place_test": ("rtask/ActTest", trials(place_test)),
        "act/workspace": ("rtask/ActWorkspace", workspace),
    }


class ActProvider:
    """Provides a robot's act service below ``/NAME/``.

    Parameters
    ----------
    service
        The service that handles the requests.
    url
        The server.
    name
        Name of the robot; with a token, the token's agent.
    token
        Token of the robot, unless the server runs without tokens.
    """

    def __init__(self, service: ActService, url: str, name: str, token: str | None = None) -> None:
        _, self._address = addresses(url)
        self._token = token
        self._methods: Mapping[str, tuple[str, Method]] = {
            f"/{name}/{path}": entry for path, entry in methods_of(service).items()
        }
        self._stop = threading.Event()

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the services."""
        return tuple(self._methods)

    def stop(self) -> None:
        """Let :meth:`serve` return after the current call; may be called from any thread."""
        self._stop.set()

    def serve(self, on_ready: Callable[[], None] = lambda: None) -> None:
        """Advertise the services and answer calls until :meth:`stop`.

        If the connection is lost later, it is reopened.

        Raises
        ------
        AuthenticationError, RemoteUnavailableError
            The server cannot be reached at the start.
        """
        with contextlib.ExitStack() as opened:
            socket = self._open(opened)
            on_ready()
            while not self._stop.is_set():
                try:
                    self._answer_next(socket)
                except OSError as error:
                    log.warning("%s: %s; announcing again", self._address, error)
                    opened.close()
                    socket = self._open_again(opened)

    def _open_again(self, opened: contextlib.ExitStack) -> Any:
        while not self._stop.is_set():
            with contextlib.suppress(RemoteUnavailableError):
                return self._open(opened)
            time.sleep(_AGAIN_S)
        return None

    def _open(self, opened: contextlib.ExitStack) -> Any:
        from websockets.exceptions import InvalidHandshake, InvalidStatus
        from websockets.sync.client import connect

        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        try:
            socket = opened.enter_context(
                connect(
                    self._address,
                    additional_headers=headers,
                    compression=None,
                    open_timeout=_OPEN_S,
                    proxy=None,
                )
            )
            for name, (type_, _) in self._methods.items():
                announce = {"op": "advertise_service", "service": name, "type": type_}
                socket.send(json.dumps(announce))
        except InvalidStatus as error:
            if error.response.status_code in (401, 403):
                raise AuthenticationError(f"{self._address} requires a robot's token") from error
            raise RemoteUnavailableError(f"{self._address}: {error}") from error
        except (OSError, InvalidHandshake) as error:
            raise RemoteUnavailableError(f"{self._address} cannot be reached: {error}") from error
        return socket

    def _answer_next(self, socket: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            with contextlib.suppress(TimeoutError):
                message = json.loads(socket.recv(timeout=_WAIT_S))
                if message.get("op") == "status":
                    log.warning("%s: %s", self._address, message.get("msg"))
                if message.get("op") == "call_service":
                    socket.send(json.dumps(self._response(message), allow_nan=False))
        except ConnectionClosed as error:
            raise OSError(f"the connection was lost: {error}") from error

    def _response(self, message: dict[str, Any]) -> dict[str, Any]:
        name = str(message.get("service"))
        response = {"op": "service_response", "service": name, "id": message.get("id")}
        try:
            if name not in self._methods:
                raise UsageError(f"no service {name}{nearest(name, list(self._methods))}")
            args = message.get("args")
            values = self._methods[name][1](args if isinstance(args, dict) else {})
        except RtaskError as error:
            return {**response, "values": str(error), "result": False}
        return {**response, "values": values, "result": True}
