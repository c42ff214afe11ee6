"""An arm behind a rosbridge server: its joints from a topic, its trajectories as an action.

Works with any server that speaks rosbridge: `rosbridge_suite` before the driver of a real arm, in
ROS 2 with ros2_control, or `rtask serve` before a simulated one.
"""

from __future__ import annotations

import contextlib
import json
import time
from types import TracebackType
from typing import Any

import numpy as np

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.motion.joint_messages import check_start, goal_message
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["RosbridgeArm"]

_ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"
_STATE_S = 5.0
_SPARE_S = 5.0
_OPEN_S = 10.0
_GOAL_ID = "reach"


class RosbridgeArm:
    """An arm whose driver takes FollowJointTrajectory goals over rosbridge.

    Parameters
    ----------
    url
        Of the server's websocket, such as ``ws://robot:9090``.
    action
        Name of the action.
    joints
        In the order of the trajectories.
    topic
        On which a sensor_msgs/JointState tells the joints.
    token
        For a server that asks for one.

    Raises
    ------
    RemoteUnavailableError
        The server cannot be reached.
    """

    def __init__(
        self, url: str, action: str, joints: tuple[str, ...], topic: str, token: str | None = None
    ) -> None:
        from websockets.exceptions import InvalidHandshake, InvalidURI
        from websockets.sync.client import connect

        self._joints, self._action, self._topic = joints, action, topic
        self._opened = contextlib.ExitStack()
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        try:
            self._socket = self._opened.enter_context(
                connect(
                    url,
                    additional_headers=headers,
                    compression=None,
                    open_timeout=_OPEN_S,
                    proxy=None,
                )
            )
        except (OSError, InvalidHandshake, InvalidURI) as error:
            raise RemoteUnavailableError(f"{url} cannot be reached: {error}") from error

    def __enter__(self) -> RosbridgeArm:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._opened.close()

    def measured(self) -> Floats:
        """Return the measured joints (dof,), rad.

        Raises
        ------
        RemoteUnavailableError
            Nobody tells them.
        """
        self._send(op="subscribe", topic=self._topic, type="sensor_msgs/JointState")
        until = time.monotonic() + _STATE_S
        try:
            while (message := self._next(until)) is not None:
                state = message.get("msg") if message.get("op") == "publish" else None
                if message.get("topic") != self._topic or not isinstance(state, dict):
                    continue
                positions = dict(
                    zip(state.get("name", ()), state.get("position", ()), strict=False)
                )
                # Other publishers of the topic may tell of other joints.
                if set(self._joints) <= set(positions):
                    return np.array([float(positions[name]) for name in self._joints])
        finally:
            self._send(op="unsubscribe", topic=self._topic)
        raise RemoteUnavailableError(
            f"{self._topic} tells no {', '.join(self._joints)} within {_STATE_S:g} s"
        )

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory, and wait for its end; cancelled on every other exit.

        Raises
        ------
        RobotError
            It starts away from the measured pose, or the driver ended it with an error.
        RemoteUnavailableError
            It did not end in its time and 5 s, or the server refused it.
        """
        check_start(way, self._joints, self.measured())
        about = {"action": self._action, "id": _GOAL_ID}
        args = goal_message(way, self._joints)
        self._send(
            op="send_action_goal", action_type=_ACTION_TYPE, args=args, feedback=False, **about
        )
        result = None
        try:
            until = time.monotonic() + way.duration + _SPARE_S
            while result is None and (message := self._next(until)) is not None:
                if message.get("op") == "action_result" and message.get("id") == _GOAL_ID:
                    result = message
        finally:
            if result is None:
                with contextlib.suppress(RemoteUnavailableError):
                    self._send(op="cancel_action_goal", **about)
        if result is None:
            raise RemoteUnavailableError(
                f"{self._action} did not end within {way.duration + _SPARE_S:.1f} s; cancelled"
            )
        values = result.get("values")
        code = values.get("error_code", 0) if isinstance(values, dict) else 0
        if not result.get("result") or code:
            words = values.get("error_string", "") if isinstance(values, dict) else values
            raise RobotError(f"{self._action} ended with {code}: {words}")

    def _send(self, **message: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self._socket.send(json.dumps(message))
        except ConnectionClosed as error:
            raise RemoteUnavailableError(f"the connection was lost: {error}") from error

    def _next(self, until: float) -> dict[str, Any] | None:
        """Return the next message, or None after a time of the monotonic clock."""
        from websockets.exceptions import ConnectionClosed

        try:
            message = json.loads(self._socket.recv(timeout=max(until - time.monotonic(), 0.0)))
        except TimeoutError:
            return None
        except ConnectionClosed as error:
            raise RemoteUnavailableError(f"the connection was lost: {error}") from error
        if not isinstance(message, dict):
            return {}
        if message.get("op") == "status" and message.get("level") == "error":
            raise RemoteUnavailableError(f"the server refused: {message.get('msg')}")
        return message
