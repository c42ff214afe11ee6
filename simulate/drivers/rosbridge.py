"""An arm behind a rosbridge server: its joints from a topic, its trajectories as an action.

Works with any server that speaks rosbridge: `rosbridge_suite` before the driver of a real arm, in
ROS 2 with ros2_control, or `rtask serve` before a simulated one.
"""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.contract import (
    JointLimits,
    RosVersion,
    check_arrival,
    check_ending,
    check_motion_start,
    goal_id,
    settled_joints,
)
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["RosbridgeArm"]

_ACTION_TYPE = "control_msgs/action/FollowJointTrajectory"
_STATE_S = 5.0
_SPARE_S = 5.0
_OPEN_S = 10.0

log = logging.getLogger(__name__)


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
    limits
        Of the joints; states outside them start no motion.
    ros
        Version of ROS behind the server, whose numbers the status of a goal has. Servers that take
        ``send_action_goal`` are of ROS 2, unless told otherwise.
    say
        Receives what people have to know before a motion; logged by default.

    Raises
    ------
    RemoteUnavailableError
        The server cannot be reached.
    """

    def __init__(
        self,
        url: str,
        action: str,
        joints: tuple[str, ...],
        topic: str,
        token: str | None = None,
        *,
        limits: JointLimits | None = None,
        ros: RosVersion = 2,
        say: Callable[[str], object] = log.warning,
    ) -> None:
        self._joints, self._action, self._topic = joints, action, topic
        self._url, self._token = url, token
        self._limits, self._ros, self._say = limits, ros, say
        self._opened = contextlib.ExitStack()
        self._socket = self._opened.enter_context(self._connected())

    def _connected(self) -> Any:
        from websockets.exceptions import InvalidHandshake, InvalidURI
        from websockets.sync.client import connect

        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        try:
            return connect(
                self._url,
                additional_headers=headers,
                compression=None,
                open_timeout=_OPEN_S,
                proxy=None,
            )
        except (OSError, InvalidHandshake, InvalidURI) as error:
            raise RemoteUnavailableError(f"{self._url} cannot be reached: {error}") from error

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
        """Return the joints (dof,), rad, of the arm at rest, from fresh states.

        Raises
        ------
        RobotError
            The states are old, without time, incomplete, not finite, outside the limits, or the
            arm moves.
        RemoteUnavailableError
            No joint state comes.
        """
        self._send(op="subscribe", topic=self._topic, type="sensor_msgs/JointState")
        try:
            return settled_joints(self._next_state, self._joints, self._limits, _STATE_S)
        finally:
            with contextlib.suppress(RemoteUnavailableError):
                self._send(op="unsubscribe", topic=self._topic)

    def follow(self, way: Trajectory) -> None:
        """Have the arm follow a trajectory, and wait until it is there; stopped on every error.

        The bridge has no watchdog: an arm whose link is lost goes on to the end of the motion,
        unless a second connection can cancel it. That is said before the motion.

        Raises
        ------
        RobotError
            It starts away from the measured pose, the driver ended it otherwise than by success,
            or the measured joints are not at the goal.
        RemoteUnavailableError
            It did not end in its time and 5 s, or the link was lost.
        """
        check_motion_start(way, self._joints, self.measured())
        self._say(
            f"if the link to {self._url} is lost, the arm may go on for up to "
            f"{way.duration:.1f} s: keep the emergency stop at hand"
        )
        goal = goal_id()
        try:
            result = self._carried_out(goal, way)
        except BaseException:
            self._stop(goal)
            raise
        values = result.get("values")
        about = values if isinstance(values, dict) else {"error_string": str(values or "")}
        code, words = about.get("error_code", 0), str(about.get("error_string", ""))
        if code:
            raise RobotError(f"{self._action} ended with {code}: {words}")
        check_ending(self._ros, result.get("status"), self._action, words)
        check_arrival(way.positions[-1], self._joints, self.measured())

    def _carried_out(self, goal: str, way: Trajectory) -> dict[str, Any]:
        """Return the result of a goal."""
        about = {"action": self._action, "id": goal, "action_type": _ACTION_TYPE}
        args = goal_message(way, self._joints)
        self._send(op="send_action_goal", args=args, feedback=False, **about)
        until = time.monotonic() + way.duration + _SPARE_S
        while (message := self._next(until)) is not None:
            if message.get("op") == "action_result" and message.get("id") == goal:
                return message
        raise RemoteUnavailableError(
            f"{self._action} did not end within {way.duration + _SPARE_S:.1f} s; cancelled"
        )

    def _stop(self, goal: str) -> None:
        """Cancel this program's own goal, by a second connection if the first one is lost."""
        cancel = {"op": "cancel_action_goal", "action": self._action, "id": goal}
        try:
            self._send(**cancel)
        except RemoteUnavailableError:
            with contextlib.suppress(RemoteUnavailableError), self._connected() as other:
                other.send(json.dumps(cancel))

    def _next_state(self, until: float) -> dict[str, Any] | None:
        """Return the next joint state that names a joint of the arm, or None after a time."""
        while (message := self._next(until)) is not None:
            state = message.get("msg") if message.get("op") == "publish" else None
            if message.get("topic") != self._topic or not isinstance(state, dict):
                continue
            # Other publishers of the topic may tell of other joints.
            if set(self._joints) & set(state.get("name") or ()):
                return state
        return None

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
