"""The arms, hands and cameras of a real NAO, through its own program NAOqi (library ``qi``).

Written against the documentation of NAOqi 2.5 (ALMotion, ALAutonomousLife, ALVideoDevice, ALMemory)
and tested against a stand-in that speaks the same protocol; never tried on a robot.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.following import FollowingArm
from simulate.drivers.joint_states import REST_S, JointLimits, check_positions, check_unmoved
from simulate.motion.trajectory import Trajectory
from simulate.robots.description import Floats

__all__ = ["HANDS", "NaoqiArm"]

HANDS = ("LHand", "RHand")
"""Names of a NAO's hands in NAOqi."""

log = logging.getLogger(__name__)

_CALL_S, _SPARE_S, _TASK_S = 10.0, 5.0, 0.5
_STATE_S, _STOPPED_S = 5.0, 2.0
_KNOT_S = 0.08
"""ALMotion computes its own commands every 20 ms, and takes longer the more points it is given."""
_HAND_S = 0.8
_VGA, _RGB, _FPS = 2, 11, 5


@dataclass(frozen=True)
class _Unended:
    """A motion that did not end yet: its joints, and its task where that is known."""

    names: list[str]
    tasks: frozenset[int] = frozenset()


class NaoqiArm(FollowingArm):
    """One arm of a NAO with its hand.

    While it is open, autonomous life is off and the arm is stiff: otherwise the robot moves by
    itself. At the end the arm gets limp, wherever it is; bring it home before. After an error it
    stays stiff, and autonomous life off: a limp arm would fall, with what it holds.

    Parameters
    ----------
    address
        Of NAOqi, such as ``tcp://nao.local:9559``.
    joints
        Of the arm, in the order of the trajectories.
    hand
        One of :data:`HANDS`.
    limits
        Of the joints; an arm outside them is not moved.
    say
        Receives what people have to know about a motion; logged by default.

    Raises
    ------
    RemoteUnavailableError
        NAOqi cannot be reached, or lacks a service.
    """

    arrived_rad = 0.1
    """Also where an arm at rest sags under its own weight."""

    def __init__(
        self,
        address: str,
        joints: tuple[str, ...],
        hand: str,
        limits: JointLimits | None = None,
        say: Callable[[str], object] = log.warning,
    ) -> None:
        import qi

        super().__init__(joints, f"the link to {address}", "a hand at the chest button", say)
        self._hand, self._address, self._limits = hand, address, limits
        self._session = qi.Session()
        self._wait(self._session.connect(address, _async=True), "connecting", _CALL_S)
        self._motion = self._service("ALMotion")
        self._unended: _Unended | None = None
        self._life_before: str | None = None
        try:
            self._take_over()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> NaoqiArm:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # After an error the arm may hold something over somebody: limp, it would drop that and
        # itself.
        if kind is None:
            self.close()
        else:
            log.warning(
                "%s: the arm stays stiff and autonomous life off; hold the arm, then take the "
                "stiffness away (ALMotion.setStiffnesses)",
                self._address,
            )
            self._session.close()

    def close(self) -> None:
        """Make the arm limp, let autonomous life go on, and disconnect."""
        # Each by itself: a lost link must not keep the rest from being tried.
        with contextlib.suppress(RemoteUnavailableError):
            self._call(self._motion, "setStiffnesses", [*self._joints, self._hand], 0.0)
        if self._life_before is not None:
            with contextlib.suppress(RemoteUnavailableError):
                self._call(self._service("ALAutonomousLife"), "setState", self._life_before)
        self._session.close()

    def _take_over(self) -> None:
        """Turn autonomous life off and stiffen the arm."""
        try:
            life = self._service("ALAutonomousLife")
        except RemoteUnavailableError:
            life = None  # a simulated robot has none
        if life is not None:
            state = str(self._call(life, "getState"))
            if state != "disabled":
                self._call(life, "setState", "disabled")
                self._life_before = state
        self._call(self._motion, "setStiffnesses", [*self._joints, self._hand], 1.0)

    def measured(self) -> Floats:
        """Return the joints (dof,), rad, of the arm at rest, from two readings .1 s apart.

        The arm has 5 s to come to rest: ALMotion ends a motion when its last command is out, and a
        loaded arm is a little behind.

        Raises
        ------
        RobotError
            One is not finite, outside its limits, or goes on moving; or the robot's own clock
            stands still, so that the values are old.
        """
        return self._settled(self._motion, self._limits, _STATE_S)

    def _settled(self, motion: Any, limits: JointLimits | None, wait_s: float) -> Floats:
        until = time.monotonic() + wait_s
        before = self._checked(motion, limits)
        while True:
            ticks = self._ticks()
            time.sleep(REST_S)
            angles = self._checked(motion, limits)
            # NAOqi goes on answering with the last angles when its sensors have stopped.
            if ticks is not None and ticks == self._ticks():
                raise RobotError(
                    f"the sensors of {self._address} stand still, so that nobody knows how old its "
                    "joints are; restart NAOqi"
                )
            try:
                check_unmoved(before, angles, REST_S, self._joints)
            except RobotError:
                if time.monotonic() >= until:
                    raise
                before = angles
            else:
                return angles

    def _checked(self, motion: Any, limits: JointLimits | None) -> Floats:
        angles = np.array(self._angles(motion, self._joints))
        check_positions(angles, self._joints, limits)
        return angles

    def _ticks(self) -> object:
        """Return the time of the robot's device manager, ms; None where there is none."""
        try:
            return self._call(self._service("ALMemory"), "getData", "DCM/Time")
        except RemoteUnavailableError:
            return None  # a simulated robot has none

    def carry_out(self, way: Trajectory) -> None:
        """Have the robot interpolate a motion, and wait."""
        knots = _knots(way)
        rows, times = way.positions[knots], way.times[knots].tolist()
        angles = [column.tolist() for column in rows.T]
        self._move(list(self._joints), angles, [times] * len(self._joints), way.duration)

    def stop(self) -> None:
        """Kill this program's own motion, by a second connection if the first one does not serve.

        Where the arm is not seen to rest afterwards, that is said.
        """
        if self._is_stopped(self._motion):
            return
        with contextlib.suppress(RemoteUnavailableError), self._connected() as motion:
            if self._is_stopped(motion):
                return
        self._say(
            f"nobody can tell whether the arm of {self._address} has stopped: "
            "press the chest button"
        )

    @contextlib.contextmanager
    def _connected(self) -> Iterator[Any]:
        """Connect once more, and yield ALMotion."""
        import qi

        other = qi.Session()
        try:
            self._wait(other.connect(self._address, _async=True), "connecting", _CALL_S)
            yield self._wait(other.service("ALMotion", _async=True), "ALMotion", _CALL_S)
        finally:
            other.close()

    def _is_stopped(self, motion: Any) -> bool:
        """Kill the motion that has not ended, and return whether the arm is seen to rest."""
        try:
            if (left := self._unended) is not None:
                for task in left.tasks:
                    self._call(motion, "killTask", task)
                # Too much is stopped rather than too little, where the task is not known or does
                # not end.
                if not left.tasks or not self._rests(motion):
                    self._call(motion, "killTasksUsingResources", left.names)
            return self._rests(motion)
        except RemoteUnavailableError:
            return False

    def _rests(self, motion: Any) -> bool:
        try:
            self._settled(motion, None, _STOPPED_S)
        except RobotError:
            return False
        return True

    def _move(
        self,
        names: list[str],
        angles: Sequence[Sequence[float]],
        times: Sequence[Sequence[float]],
        duration: float,
    ) -> None:
        """Interpolate joints along angles (rad, or 0 to 1 for hands) at times (s), and wait."""
        # Before the motion, so that its own task can be told from those of others.
        is_absolute, others = True, self._tasks()
        self._unended = _Unended(names)
        moving = self._begin(self._motion, "angleInterpolation", names, angles, times, is_absolute)
        try:
            self._unended = _Unended(names, self._own_tasks(moving, others))
            self._wait(moving, "angleInterpolation", duration + _SPARE_S)
            self._unended = None
        finally:
            if self._unended is not None:
                # A future that has ended cannot be cancelled, which is what is wanted.
                with contextlib.suppress(RuntimeError):
                    moving.cancel()

    def _tasks(self) -> frozenset[int]:
        """Return the numbers of all interpolations of the robot, whoever began them."""
        try:
            told = self._call(self._motion, "getTaskList")
            return frozenset(int(task[1]) for task in told if task[0] == "angleInterpolation")
        except (RemoteUnavailableError, TypeError, ValueError, LookupError):
            return frozenset()

    def _own_tasks(self, moving: Any, others: frozenset[int]) -> frozenset[int]:
        """Return the task that a motion just became; none if it ended before, or nobody knows."""
        # The call does not return its task's number: it is the one that was not there before.
        until = time.monotonic() + _TASK_S
        while moving.isRunning() and time.monotonic() < until:
            own = self._tasks() - others
            if own:
                # Another program began at the same moment: no number can be told to be ours.
                return own if len(own) == 1 else frozenset()
        return frozenset()

    def move_hand(self, opening: float) -> None:
        """Drive the hand towards an opening, 0 (closed) to 1; what it holds stops it."""
        try:
            self._move([self._hand], [[float(opening)]], [[_HAND_S]], _HAND_S)
        # Ctrl-C as well, as for the arm.
        except BaseException:
            self.stop()
            raise

    def opening(self) -> float:
        """Return the measured opening of the hand, 0 to 1."""
        return self._angles(self._motion, [self._hand])[0]

    def picture(self, camera: int = 0) -> NDArray[np.uint8]:
        """Return what a camera sees, (480, 640, 3) uint8, RGB.

        Parameters
        ----------
        camera
            0 = in the forehead, 1 = in the mouth, which sees what is before the feet.

        Raises
        ------
        RemoteUnavailableError
            It gives no picture.
        """
        video = self._service("ALVideoDevice")
        handle = self._call(video, "subscribeCamera", "rtask", camera, _VGA, _RGB, _FPS)
        if not handle:
            raise RemoteUnavailableError(f"camera {camera} of {self._address} is not free")
        try:
            image = self._call(video, "getImageRemote", handle)
            if not image:
                raise RemoteUnavailableError(f"camera {camera} of {self._address} gave no picture")
            width, height, layers, data = image[0], image[1], image[2], image[6]
            pixels = np.frombuffer(data, np.uint8)
            if layers != 3 or pixels.size != width * height * layers:
                raise RemoteUnavailableError(
                    f"camera {camera} of {self._address}: {pixels.size} bytes for a picture of "
                    f"{width} x {height} with {layers} layers; expected RGB"
                )
            self._call(video, "releaseImage", handle)
        finally:
            self._call(video, "unsubscribe", handle)
        return pixels.reshape(height, width, layers)

    def _angles(self, motion: Any, names: Sequence[str]) -> list[float]:
        use_sensors = True
        told = self._call(motion, "getAngles", list(names), use_sensors)
        try:
            angles = [float(value) for value in told]
        except (TypeError, ValueError):
            angles = []
        if len(angles) != len(names):
            raise RobotError(
                f"{self._address}, getAngles: expected {len(names)} numbers for "
                f"{', '.join(names)}, got {told!r}; check that the joints are those of the robot"
            )
        return angles

    def _service(self, name: str) -> Any:
        return self._wait(self._session.service(name, _async=True), name, _CALL_S)

    def _call(self, service: Any, method: str, *arguments: Any) -> Any:
        return self._wait(self._begin(service, method, *arguments), method, _CALL_S)

    def _begin(self, service: Any, method: str, *arguments: Any) -> Any:
        try:
            return getattr(service, method)(*arguments, _async=True)
        except (RuntimeError, AttributeError) as error:
            self._lost(method, error)

    def _wait(self, future: Any, what: str, seconds: float) -> Any:
        """Return what a call answers; ``qi`` tells of every failure by a RuntimeError."""
        try:
            return future.value(round(1000 * seconds))
        except RuntimeError as error:
            self._lost(what, error)

    def _lost(self, what: str, error: Exception) -> NoReturn:
        words = str(error).strip().partition("\n")[0]
        raise RemoteUnavailableError(f"{self._address}, {what}: {words}") from error


def _knots(way: Trajectory) -> NDArray[np.int64]:
    """Return the numbers of the waypoints to send: the last one, and before it some 80 ms apart."""
    count = max(round(way.duration / _KNOT_S), 1)
    numbers = np.searchsorted(way.times, np.linspace(0.0, way.duration, count + 1)[1:])
    return np.unique(np.clip(numbers, 1, len(way.times) - 1)) if len(way.times) > 1 else numbers[:0]
