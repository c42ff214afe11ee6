"""Joint states of a real arm: which can be trusted, whether the arm rests, whether it is one arm.

A state is trusted when it is recent, complete, finite and within the limits; an arm rests when two
states of .1 s or more apart agree.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.robots.description import Floats, RobotDescription

__all__ = [
    "REST_S",
    "JointLimits",
    "OneSource",
    "check_positions",
    "check_unmoved",
    "number_in",
    "read_state",
    "settled_joints",
    "stamp_of",
]

MAX_AGE_S = 1.0
_REST_RAD_S = 0.05
_NOISE_RAD = 0.002
REST_S = 0.1
"""Between two states by whose difference an arm rests: within a millisecond, noise hides all."""
_LIMIT_MARGIN_RAD = 0.05
_BACK_RAD, _BACK_S = 0.05, 0.15


@dataclass(frozen=True)
class JointLimits:
    """Position limits (dof,) of an arm's joints, rad; infinite for continuous joints."""

    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, robot: RobotDescription, joints: Sequence[str]) -> JointLimits:
        """Return the limits of joints of a robot."""
        by_name = {joint.name: joint for joint in robot.joints}
        ends = [(by_name[name].lower, by_name[name].upper) for name in joints]
        ends = [(low, high) if low < high else (-np.inf, np.inf) for low, high in ends]
        return cls(np.array([low for low, _ in ends]), np.array([high for _, high in ends]))


@dataclass(frozen=True)
class _State:
    """Joints of one message: positions (dof,) and velocities (dof,) or None, and its time, s."""

    positions: Floats
    velocities: Floats | None
    stamp_s: float


class OneSource:
    """Tells whether joint states come from one arm alone.

    Two programs that publish on one topic, such as a robot and its shadow in simulation, take
    turns: states go elsewhere and are back at once. No arm is; that its clock is another one hides
    nothing, as times are compared with those of the same program.
    """

    def __init__(self) -> None:
        self._former: list[tuple[float, Floats]] = []

    def take(self, stamp_s: float, positions: Floats) -> None:
        """Take the time and the joints (dof,), rad, of the next state.

        Raises
        ------
        RobotError
            It is where the state before the last one was, and that one was elsewhere.
        """
        if len(self._former) == 2:
            (then_s, first), (_, between) = self._former
            away = np.abs(between - positions).max()
            back = np.abs(first - positions).max()
            # Between turns, 50 ms may be gone there and back only at 40 rad/s2.
            if away > _BACK_RAD and back < away / 2 and abs(stamp_s - then_s) < _BACK_S:
                raise RobotError(
                    f"the joint states jump by {away:.2f} rad and back: two programs publish "
                    "states of these joints on one topic; stop one of them, or give each its own"
                )
        self._former = [*self._former[-1:], (stamp_s, positions)]


def read_state(
    message: Mapping[str, Any], joints: Sequence[str], limits: JointLimits | None, now_s: float
) -> _State:
    """Read a sensor_msgs/JointState from which a motion may start.

    Parameters
    ----------
    message
        Its joints may stand in any order, beside others; each value belongs to its name.
    joints
        Of the arm.
    limits
        Of these joints.
    now_s
        Time of this machine, s since 1970.

    Raises
    ------
    RobotError
        Says what is wrong with which joint, and what to do about it.
    """
    names, positions = _names_of(message), _listed(message, "position")
    # Names and positions are joined by place, so that one too few moves the wrong joint.
    if len(names) != len(positions) or len(set(names)) != len(names):
        raise RobotError(
            f"a joint state names {len(set(names))} joints and has {len(positions)} positions; "
            "check its publisher"
        )
    missing = [name for name in joints if name not in names]
    if missing:
        raise RobotError(
            f"the joint states lack {', '.join(missing)}; "
            "start the broadcaster of the arm's joints, or give its topic by --joints"
        )
    _check_time(message, now_s)
    rows = [names.index(name) for name in joints]
    values = np.array([number_in(positions[k]) for k in rows])
    check_positions(values, joints, limits)
    rates = _listed(message, "velocity")
    velocities = None
    # Empty where a robot does not measure it, as the message allows.
    if len(rates) == len(names):
        velocities = np.array([number_in(rates[k]) for k in rows])
    return _State(values, velocities, stamp_of(message))


def check_positions(values: Floats, joints: Sequence[str], limits: JointLimits | None) -> None:
    """Check that measured joints (dof,), rad, are finite and within their limits.

    Raises
    ------
    RobotError
        A joint is not; degrees are recognised.
    """
    if not np.isfinite(values).all():
        name = joints[int(np.flatnonzero(~np.isfinite(values))[0])]
        raise RobotError(f"{name} is not a finite number; check its encoder and the driver")
    if limits is None:
        return
    margin = _LIMIT_MARGIN_RAD
    outside = (values < limits.lower - margin) | (values > limits.upper + margin)
    if not outside.any():
        return
    k = int(np.flatnonzero(outside)[0])
    turned = np.sign(values) * (np.abs(values) - 2 * np.pi)
    # Of such a joint the reader of models makes one of a full turn.
    is_endless = limits.upper - limits.lower >= 2 * np.pi - _NOISE_RAD
    is_wound = outside & is_endless & (np.abs(turned) <= np.pi + margin)
    if (is_wound == outside).all():
        # Planned within a turn, such a joint may come back the long way.
        raise RobotError(
            f"{joints[k]} is {values[k]:.2f} rad, a whole turn off: it has no ends, and was wound "
            f"up; turn it back to {limits.lower[k]:.2f} to {limits.upper[k]:.2f} by hand"
        )
    radians = np.deg2rad(values)
    # No arm stands beyond a full turn unless it counts in degrees.
    if (
        np.abs(values).max() > 2 * np.pi
        and ((radians >= limits.lower - margin) & (radians <= limits.upper + margin)).all()
    ):
        raise RobotError(
            f"{joints[k]} is {values[k]:.2f}, which looks like degrees; "
            "the driver has to publish radians"
        )
    raise RobotError(
        f"{joints[k]} is {values[k]:.2f} rad, outside its limits "
        f"{limits.lower[k]:.2f} to {limits.upper[k]:.2f}; move the arm back by hand, "
        "or check that the model is that of the robot"
    )


def settled_joints(
    next_message: Callable[[float], Mapping[str, Any] | None],
    joints: Sequence[str],
    limits: JointLimits | None,
    wait_s: float,
    now: Callable[[], float] = time.time,
) -> Floats:
    """Return the joints (dof,), rad, of an arm at rest, from fresh states of .1 s or more.

    Parameters
    ----------
    next_message
        Returns the next JointState, or None after a time of the monotonic clock.
    now
        Clock of the states' stamps, s.

    Raises
    ------
    RobotError
        None of the states that came within ``wait_s`` will do; says why the last one does not.
    RemoteUnavailableError
        No joint state came.
    """
    until, complaint = time.monotonic() + wait_s, None
    before: _State | None = None
    source = OneSource()
    # States that keep coming must not keep one here for good.
    while time.monotonic() < until and (message := next_message(until)) is not None:
        try:
            state = read_state(message, joints, limits, now())
        except RobotError as error:
            complaint, before = error, None
            continue
        # Not waited out: between two states of the slower one, the quicker one looks like an arm.
        source.take(state.stamp_s, state.positions)
        if before is None:
            before = state
        # A state of the same time is the same one, sent again: nothing was measured meanwhile.
        elif state.stamp_s > before.stamp_s:
            try:
                _check_rest(before, state, joints)
            except RobotError as error:
                complaint, before = error, None
                continue
            if state.stamp_s - before.stamp_s >= REST_S:
                return state.positions
    if complaint is not None:
        raise complaint
    if before is not None:
        raise RobotError(
            f"the joint states of {wait_s:g} s are fewer than two {REST_S:g} s apart, or their "
            "time stands still, or goes back; check that one driver alone publishes them"
        )
    raise RemoteUnavailableError(f"no state of {', '.join(joints)} came within {wait_s:g} s")


def stamp_of(message: Mapping[str, Any]) -> float:
    """Return the time of a message, s since 1970, of ROS 1 or 2; 0 or NaN where it has none."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if not isinstance(stamp, Mapping):
        return 0.0
    seconds = number_in(stamp.get("sec", stamp.get("secs", 0)))
    return seconds + number_in(stamp.get("nanosec", stamp.get("nsecs", 0))) / 1e9


def number_in(value: object) -> float:
    """Return a number of a message; NaN where there is none, as JSON has no NaN."""
    # A bool is an int in Python, and no driver means 1 rad by true.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    try:
        return float(value)
    except OverflowError:
        return float("nan")


def _listed(message: Mapping[str, Any], key: str) -> list[Any]:
    values = message.get(key)
    if values is None:
        return []
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Sequence):
        raise RobotError(f"{key} of a joint state is no list; check its publisher")
    return list(values)


def _names_of(message: Mapping[str, Any]) -> list[str]:
    names = _listed(message, "name")
    if not all(isinstance(name, str) for name in names):
        raise RobotError("a joint state has names that are no texts; check its publisher")
    return names


def _check_time(message: Mapping[str, Any], now_s: float) -> None:
    stamp = stamp_of(message)
    if not stamp > 0:
        raise RobotError(
            "the joint states carry no time, so that nobody knows how old they are; "
            "have the driver fill header.stamp"
        )
    age = now_s - stamp
    # A state from the future is as bad as an old one: the clocks disagree by as much.
    if not abs(age) <= MAX_AGE_S:
        when = f"{age:.1f} s old" if age > 0 else f"{-age:.1f} s ahead of this machine"
        raise RobotError(
            f"the joint states are {when}; restart the driver that publishes them, "
            "or set the clocks of both machines by NTP"
        )


def _check_rest(before: _State, state: _State, joints: Sequence[str]) -> None:
    """Refuse an arm that moves, by its velocities and by the difference of two states."""
    if state.velocities is not None:
        # Broadcasters fill in NaN where a joint has no sensor of velocity: the difference decides.
        _refuse_moving(np.abs(state.velocities) > _REST_RAD_S, joints)
    seconds = state.stamp_s - before.stamp_s
    check_unmoved(before.positions, state.positions, seconds, joints)


def check_unmoved(before: Floats, after: Floats, seconds: float, joints: Sequence[str]) -> None:
    """Check that joints (dof,), rad, are at rest, by two measurements some seconds apart.

    Raises
    ------
    RobotError
        One moves.
    """
    _refuse_moving(np.abs(after - before) > _REST_RAD_S * seconds + _NOISE_RAD, joints)


def _refuse_moving(is_moving: NDArray[np.bool_], joints: Sequence[str]) -> None:
    if is_moving.any():
        k = int(np.flatnonzero(is_moving)[0])
        raise RobotError(f"{joints[k]} is moving; stop what moves the arm, and try again")
