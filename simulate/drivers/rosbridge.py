"""An arm behind a rosbridge server: its joints from a topic, its trajectories as an action.

Works with any server that speaks rosbridge: `rosbridge_suite` before the driver of a real arm, in
ROS 1 or 2, or `rtask serve` before a simulated one.
"""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable, Iterator, Mapping
from types import TracebackType
from typing import Any

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.contract import RosVersion, goal_id
from simulate.drivers.following import FollowingArm
from simulate.drivers.joint_states import JointLimits, settled_joints
from simulate.drivers.rosbridge_goals import GoalEnd, goals_of, is_topic
from simulate.drivers.watch import MotionWatch
from simulate.motion.joint_messages import goal_message
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["RosbridgeArm"]

_STATE_S = 5.0
_SPARE_S = 5.0
_STOPPED_S = 2.0
_OPEN_S, _CLOSE_S = 10.0, 1.0

log = logging.getLogger(__name__)


class _Link:
    """One connection to the bridge."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def send(self, **message: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self._socket.send(json.dumps(message))
        except ConnectionClosed as error:
            raise RemoteUnavailableError(f"the connection was lost: {error}") from error

    def next(self, until: float) -> dict[str, Any] | None:
        """Return the next message, or None after a time of the monotonic clock."""
        from websockets.exceptions import ConnectionClosed

        try:
            text = self._socket.recv(timeout=max(until - time.monotonic(), 0.0))
            message = json.loads(text)
        except TimeoutError:
            return None
        except ConnectionClosed as error:
            raise RemoteUnavailableError(f"the connection was lost: {error}") from error
        except (ValueError, RecursionError) as error:  # the latter of lists within lists
            raise RemoteUnavailableError(f"the server sent what is no JSON: {error}") from error
        if not isinstance(message, dict):
            return {}
        if message.get("op") == "status" and message.get("level") == "error":
            raise RemoteUnavailableError(f"the server refused: {message.get('msg')}")
        return message


class RosbridgeArm(FollowingArm):
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
        Version of ROS behind the server: goals are sent as its bridge takes them, and their status
        has its numbers.
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
        super().__init__(joints, f"the link to {url}", "the emergency stop at hand", say)
        self._action, self._topic, self._url, self._token = action, topic, url, token
        self._limits, self._ros, self._goal = limits, ros, ""
        self._goals = goals_of(ros, action)
        self._opened = contextlib.ExitStack()
        self._link = self._opened.enter_context(self._connected())

    @contextlib.contextmanager
    def _connected(self) -> Iterator[_Link]:
        from websockets.exceptions import InvalidHandshake, InvalidURI
        from websockets.sync.client import connect

        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        try:
            socket = connect(
                self._url,
                additional_headers=headers,
                compression=None,
                open_timeout=_OPEN_S,
                close_timeout=_CLOSE_S,
                proxy=None,
            )
        except (OSError, InvalidHandshake, InvalidURI) as error:
            raise RemoteUnavailableError(f"{self._url} cannot be reached: {error}") from error
        with socket:
            link = _Link(socket)
            for message in self._goals.opening():
                link.send(**message)
            yield link

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
        return self._settled(self._link, self._limits, _STATE_S)

    def carry_out(self, way: Trajectory) -> Callable[[Floats], None]:
        """Send a goal, and wait until the driver says that it succeeded."""
        self._goal = goal_id()
        watch = MotionWatch(way, self._joints)
        end = self._carried_out(self._goal, way, watch)
        end.check(self._ros, self._action)
        if doubt := watch.pace_doubt():
            self._say(doubt)
        return watch.check_followed

    def _carried_out(self, goal: str, way: Trajectory, watch: MotionWatch) -> GoalEnd:
        """Send a goal, and return how it ended."""
        # States are subscribed to before the goal is sent, so that its very first ones are watched.
        with self._subscribed(self._link):
            for message in self._goals.begin(goal, goal_message(way, self._joints)):
                self._link.send(**message)
            until = time.monotonic() + way.duration + _SPARE_S
            while (now := time.monotonic()) < until:
                watch.check()
                came = self._link.next(max(min(until, watch.deadline), now))
                if came is None:
                    continue
                if (state := self._state_in(came)) is not None:
                    watch.take(state)
                if (end := self._goals.end(goal, came)) is not None:
                    return end
        raise RemoteUnavailableError(
            f"{self._action} did not end within {way.duration + _SPARE_S:.1f} s; a cancel was sent"
        )

    def stop(self) -> None:
        """Cancel this program's own goal, by a second connection if the first one does not serve.

        Where the arm is not seen to rest afterwards, that is said.
        """
        if self._is_stopped(self._link, self._goal):
            return
        with contextlib.suppress(RemoteUnavailableError), self._connected() as other:
            if self._is_stopped(other, self._goal):
                return
        self._say(
            f"nobody can tell whether the arm of {self._action} has stopped: use the emergency stop"
        )

    def _is_stopped(self, link: _Link, goal: str) -> bool:
        """Cancel a goal, and return whether the arm is seen to rest."""
        try:
            for message in self._goals.cancel(goal):
                link.send(**message)
            self._settled(link, None, _STOPPED_S)
        except (RemoteUnavailableError, RobotError):
            return False
        return True

    def _settled(self, link: _Link, limits: JointLimits | None, wait_s: float) -> Floats:
        with self._subscribed(link):
            return settled_joints(
                lambda until: self._next_state(link, until), self._joints, limits, wait_s
            )

    @contextlib.contextmanager
    def _subscribed(self, link: _Link) -> Iterator[None]:
        """Have the joint states sent."""
        # Only while they are read: states that pile up on the link would be old when they are.
        link.send(op="subscribe", topic=self._topic, type="sensor_msgs/JointState")
        try:
            yield
        finally:
            # The error that ended the block says more than that this failed, too.
            with contextlib.suppress(RemoteUnavailableError):
                link.send(op="unsubscribe", topic=self._topic)

    def _next_state(self, link: _Link, until: float) -> dict[str, Any] | None:
        """Return the next joint state that names a joint of the arm, or None after a time."""
        while time.monotonic() < until and (message := link.next(until)) is not None:
            if (state := self._state_in(message)) is not None:
                return state
        return None

    def _state_in(self, message: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the joint state in a message, unless it tells of other joints than the arm's."""
        state = message.get("msg") if message.get("op") == "publish" else None
        if not is_topic(message, self._topic) or not isinstance(state, dict):
            return None
        # What is no list of names is passed on: whoever reads the state says what is wrong with it.
        names = state.get("name")
        if isinstance(names, list) and not any(name in self._joints for name in names):
            return None
        return state
