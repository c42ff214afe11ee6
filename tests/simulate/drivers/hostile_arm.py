"""An arm of two joints whose driver lies, whatever carries its messages.

``state`` says how its joint states lie, ``end`` how its goals end. With ``is_timed`` it takes its
time for a goal, five times as fast as the wall's, and keeps when it moved last.
"""

from __future__ import annotations

import threading
import time

import numpy as np

from simulate.drivers.joint_states import JointLimits

JOINTS = ("shoulder", "elbow")
LIMITS = JointLimits(np.array([-3.0, -3.0]), np.array([3.0, 3.0]))
START = (0.9, 0.3)
ACTION, TOPIC = "/arm_controller/follow_joint_trajectory", "/joint_states"
_STEP_S, _HURRY = 0.01, 5.0
_ASIDE_RAD, _TOLD_ASIDE = 0.3, 20


class HostileArm:
    """Joints, lies, and what was asked of them."""

    def __init__(self):
        self.reset()
        self.closed = threading.Event()
        self.stepping = threading.Thread(target=self.step, daemon=True)
        self.stepping.start()

    def reset(self):
        self.state, self.end, self.at = "good", {"status": 4}, np.array(START)
        self.goals, self.cancelled, self.stopped = [], [], threading.Event()
        self.ticks = 0
        self.is_timed, self.clock, self.last_moved = False, 0.0, 0.0
        self.motion, self.over = None, []
        self.twin = np.array(START) + 0.4
        self.__dict__.pop("base", None)
        self.__dict__.pop("first_stamp", None)

    def close(self):
        self.closed.set()
        self.stepping.join()

    def step(self):
        """Let time pass, and move along the goal that came last."""
        while not self.closed.wait(_STEP_S / _HURRY):
            self.clock += _STEP_S
            motion = self.motion
            if motion is None:
                continue
            goal, began, times, rows = motion
            passed = self.clock - began
            before = self.at
            self.at = self._place(passed, times, rows)
            if (self.at != before).any():
                self.last_moved = self.clock
            if passed >= times[-1] and self.motion is motion and not self._lingers(passed, times):
                self.motion = None
                self.over.append(goal)

    def _place(self, passed, times, rows):
        """Return where a motion is, in the way that it goes."""
        goes = self.end.get("goes") if isinstance(self.end, dict) else None
        if goes == "half" and passed > times[-1] / 2:  # another controller has the joints now
            self.motion = None
        at = np.array([np.interp(passed, times, column) for column in rows.T])
        if self._lingers(passed, times):
            at[0] += 0.8 * np.sin(np.pi * min(passed / times[-1], 0.5))
        return 2 * rows[0] - at if goes == "mirrored" else at

    def _lingers(self, passed, times):
        """Tell whether the arm is aside: until that was told often, however busy the machine is."""
        goes = self.end.get("goes") if isinstance(self.end, dict) else None
        return goes == "aside" and (passed < times[-1] or self.ticks < _TOLD_ASIDE)

    def take(self, goal, points):
        """Take a goal; return whether it has ended at once."""
        self.goals.append(goal)
        if self.is_timed:
            times = [seconds_of(point["time_from_start"]) for point in points]
            rows = np.array([self.at, *(point["positions"] for point in points)])
            self.motion = goal, self.clock, [0.0, *times], rows
            return False
        if self.end == "states stop":
            self.state = "none"
        if self.end in ("renamed", "unannounced motion", "NaN", "incomplete"):
            self.state = self.end
        if isinstance(self.end, str):
            return False
        self.state = self.end.get("state", self.state)
        self.twin = np.array(points[-1]["positions"])
        if "stays" not in self.end:
            self.at = np.array(points[-1]["positions"]) - self.end.get("freezes", 0.0)
        return True

    def cancel(self, goal):
        self.cancelled.append(goal)
        self.stopped.set()
        if self.motion is not None and self.motion[0] == goal:
            self.motion = None

    def report(self):
        return {"clock": self.clock, "last_moved": self.last_moved, "at": self.at.tolist(),
                "goals": len(self.goals), "moves": self.motion is not None}  # fmt: skip

    def tick(self):
        self.ticks += 1
        return self.ticks

    def joint_state(self):
        seconds, nanoseconds = divmod(time.time_ns() - 3_600_000_000_000 * (self.state == "old"),
                                      1_000_000_000)  # fmt: skip
        names, at = list(JOINTS), self.at.tolist()
        if at[0] > START[0] + _ASIDE_RAD:
            self.tick()
        if self.state == "a text for a list":
            at = "0.9 0.3"
        if isinstance(self.end, dict) and self.end.get("goes") == "unseen":
            at = list(START)
        stamp = {"sec": seconds, "nanosec": nanoseconds}
        velocity = [0.0, 1.5] if self.state == "moving" else [0.0, 0.0]
        match self.state:
            case "without time":
                stamp = {"sec": 0, "nanosec": 0}
            case "ahead":
                stamp["sec"] += 60
            case "frozen":
                stamp = self.__dict__.setdefault("first_stamp", stamp)
            case "NaN":
                at[1] = None  # as rosbridge writes what JSON has no number for
            case "a text for a number":
                at[1] = "0.3"
            case "two seconds old":
                stamp["sec"] -= 2
            case "one old state, as latched" if self.tick() == 1:
                stamp["sec"] -= 3600
            case "one state of the future" if self.tick() == 1:
                stamp["sec"] += 10**8
            case "without speed, moving":
                at, velocity = (self.at + 0.5 * (time.time() % 4)).tolist(), [0.0, 0.0]
            case "a huge number":
                at[1] = 10**400
            case "no names":
                names = [names[0], {}]
            case "a text for a time":
                stamp = {"sec": "now", "nanosec": None}
            case "no header":
                return {"name": names, "position": at}
            case "twice the same joint":
                names = [names[0]] * 2
            case "a thousand times a second, moving":
                # Within a millisecond an arm at 1.5 rad/s moves less than an encoder's noise.
                base, self.ticks = self.__dict__.setdefault("base", time.time_ns()), self.ticks + 1
                now = base + self.ticks * 10**6
                stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
                at, velocity = (self.at + 0.0015 * self.ticks).tolist(), []
            case "velocities unknown":
                velocity = [None, None]
            case "degrees":
                at = np.rad2deg(self.at).tolist()
            case "outside":
                at[0] = 3.4
            case "in another order":
                names.reverse()
            case "an old copy between" if self.tick() % 2:
                stamp["sec"] -= 30
                at = [0.0, 0.0]
            case "another publisher between" if self.tick() % 2:
                at = [0.0, 0.0]
            case "in changing order" if self.tick() % 2:
                names, at = names[::-1], at[::-1]
            case "time goes back":
                base = self.__dict__.setdefault("base", time.time_ns())
                now = base - self.tick() * 10**6
                stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
            case "a twin ahead of it between" if self.tick() % 2:
                # Another clock: its states are always the newest, and hide the arm's own.
                stamp["sec"] += stamp["nanosec"] >= 600_000_000
                stamp["nanosec"] = (stamp["nanosec"] + 400_000_000) % 10**9
                at = self.twin.tolist()
            case "renamed":
                names = [f"left/{name}" for name in names]
            case "incomplete":
                names, at, velocity = names[:1], at[:1], velocity[:1]
            case "uneven":
                at = at[:1]
            case "unannounced motion":
                at, velocity = (self.at + 0.5 * (time.time() % 4)).tolist(), []
        return {"header": {"stamp": stamp}, "name": names, "position": at, "velocity": velocity}


def seconds_of(duration):
    return duration["sec"] + duration["nanosec"] / 1e9
