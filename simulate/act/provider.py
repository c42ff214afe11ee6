"""The act service and the arms' actions on a rosbridge server: the robot advertises and answers.

Everything runs in one thread, because physics must: calls and goals are answered one after the
other, in the order of their arrival.
"""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from rtask.client.calling.messages import addresses
from rtask.errors import (
    AuthenticationError,
    RemoteUnavailableError,
    RtaskError,
    UsageError,
    nearest,
)
from rtask.wire.message import Message, read
from rtask.wire.types import Number, Unit, Whole
from simulate.act.arm_goals import ABORTED, ACTION_TYPE, SUCCEEDED, ArmGoals
from simulate.act.service import ActService
from simulate.act.trials import Trial, place_test, reach_test, reasons
from simulate.act.workspace import map_workspace
from simulate.motion.goal_course import INVALID_GOAL

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
        reach_map = map_workspace(space, step=asked.step, heights=heights, angles=asked.angles)
        return {
            "x": reach_map.x.tolist(),
            "y": reach_map.y.tolist(),
            "heights": reach_map.heights.tolist(),
            "arms": list(reach_map.arms),
            "share": np.round(reach_map.share, 4).tolist(),
        }

    return {
        "act": ("rtask/Act", service.act),
        "act/reach_test": ("rtask/ActTest", trials(reach_test)),
        "act/place_test": ("rtask/ActTest", trials(place_test)),
        "act/workspace": ("rtask/ActWorkspace", workspace),
    }


class ActProvider:
    """Provides a robot's act service and the actions of its arms below ``/NAME/``.

    Where the joints are is published, latched and with its time, on ``/NAME/joint_states``.

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
        self._arms = ArmGoals(service)
        self._actions = {f"/{name}/{path}": path for path in self._arms.actions}
        self._joints_topic = f"/{name}/joint_states"
        self._waiting: deque[dict[str, Any]] = deque()
        self._cancelled: set[Any] = set()
        self._stop = threading.Event()

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the services."""
        return tuple(self._methods)

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions."""
        return tuple(self._actions)

    def stop(self) -> None:
        """Let :meth:`serve` return after the current call; may be called from any thread."""
        self._stop.set()

    def serve(self, on_ready: Callable[[], None] = lambda: None) -> None:
        """Advertise services and actions and answer calls and goals until :meth:`stop`.

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
                self._send(socket, {"op": "advertise_service", "service": name, "type": type_})
            for name in self._actions:
                self._send(socket, {"op": "advertise_action", "action": name, "type": ACTION_TYPE})
            topic = {"topic": self._joints_topic, "type": "sensor_msgs/JointState", "latch": True}
            self._send(socket, {"op": "advertise", **topic})
            self._publish_joints(socket)
        except InvalidStatus as error:
            if error.response.status_code in (401, 403):
                raise AuthenticationError(f"{self._address} requires a robot's token") from error
            raise RemoteUnavailableError(f"{self._address}: {error}") from error
        except (OSError, InvalidHandshake) as error:
            opened.close()
            raise RemoteUnavailableError(f"{self._address} cannot be reached: {error}") from error
        return socket

    def _answer_next(self, socket: Any) -> None:
        message = self._waiting.popleft() if self._waiting else self._received(socket, _WAIT_S)
        if message is None:
            self._publish_joints(socket)  # drivers' clients refuse states that are old
            return
        if message.get("op") == "call_service":
            answer = self._response(message)
        elif message.get("op") == "send_action_goal":
            answer = self._result(message, socket)
        else:
            self._cancelled.clear()  # of goals that have ended, as none waits
            return
        self._publish_joints(socket)  # first, so that who has the answer finds them
        self._send(socket, answer)

    def _received(self, socket: Any, wait_s: float) -> dict[str, Any] | None:
        """Return the next message, or None if there was none for that long.

        Raises
        ------
        OSError
            The connection was lost; whoever asked over it does not wait any more.
        """
        from websockets.exceptions import ConnectionClosed

        try:
            message = json.loads(socket.recv(timeout=wait_s))
        except TimeoutError:
            return None
        except ConnectionClosed as error:
            self._waiting.clear()
            self._cancelled.clear()
            raise OSError(f"the connection was lost: {error}") from error
        if not isinstance(message, dict):
            return None
        if message.get("op") == "status":
            log.warning("%s: %s", self._address, message.get("msg"))
        if message.get("op") == "cancel_action_goal":
            self._cancelled.add(message.get("id"))
        return message

    def _send(self, socket: Any, message: dict[str, Any]) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            socket.send(json.dumps(message, allow_nan=False))
        except ConnectionClosed as error:
            raise OSError(f"the connection was lost: {error}") from error

    def _publish_joints(self, socket: Any) -> None:
        states = self._arms.joint_states()
        self._send(socket, {"op": "publish", "topic": self._joints_topic, "msg": states})

    def _result(self, message: dict[str, Any], socket: Any) -> dict[str, Any]:
        """Carry out the goal of an action; what else arrives meanwhile waits."""
        action, goal_id = str(message.get("action")), message.get("id")
        about = {"action": action, "id": goal_id}

        def tell(feedback: dict[str, Any]) -> None:
            if message.get("feedback"):
                self._send(socket, {"op": "action_feedback", **about, "values": feedback})

        def is_cancelled() -> bool:
            self._publish_joints(socket)  # clients watch the arm on its way
            while (came := self._received(socket, 0)) is not None:
                if came.get("op") in ("call_service", "send_action_goal"):
                    self._waiting.append(came)
            return goal_id in self._cancelled or self._stop.is_set()

        args = message.get("args")
        goal = args if isinstance(args, dict) else {}
        try:
            if action not in self._actions:
                raise UsageError(f"no action {action}{nearest(action, list(self._actions))}")
            status, values = self._arms.follow(self._actions[action], goal, tell, is_cancelled)
        except UsageError as error:
            status, values = ABORTED, {"error_code": INVALID_GOAL, "error_string": str(error)}
        finally:
            self._cancelled.discard(goal_id)
        result = {"op": "action_result", **about, "values": values}
        return {**result, "status": status, "result": status == SUCCEEDED}

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
