"""A stand-in for a NAO: NAOqi's services of a robot without physics, over the real protocol.

Run as a program, it prints ``ready ADDRESS`` and ends when its input does. Joints go where they are
sent, at once when the motion's time has passed; what lies in the hand stops it.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

import numpy as np
import qi

ARM_JOINTS = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
NAMES = [f"{side}{joint}" for side in "LR" for joint in (*ARM_JOINTS, "Hand")]
GOING_ON = ("success, but it goes on", "no end, and it goes on when cancelled")
THEIRS = 999
WIDTH, HEIGHT = 640, 480
_IMAGE = "(iiiiiiriffff)"
"""Width, height, layers, colours, s, us, bytes, camera, and the angles of the view."""


@qi.multiThreaded()
class ALMotion:
    """Angles of the arms; time passes ``hurry`` times faster."""

    def __init__(self) -> None:
        self.angles = dict.fromkeys(NAMES, 0.0)
        self.stiff = dict.fromkeys(NAMES, 0.0)
        self.calls: list[str] = []
        self.in_hand = 0.0
        self.blocked = ""
        self.hurry = 20.0
        self.tasks: dict[int, bool] = {}
        """Whether each running task was killed, by its number."""
        self.newest = 0
        self.drifting: dict[str, float] = {}
        self.lying = "good"
        self.last_moved = 0.0

    def getAngles(self, names: list[str], use_sensors: bool) -> list[float]:
        for name, rate in self.drifting.items():
            self.angles[name] = 0.1 + (self.angles[name] + rate * 0.1 - 0.1) % 1.2
        return [self.angles[name] for name in names[: 1 if self.lying == "uneven" else None]]

    def setStiffnesses(self, names: list[str], value: float) -> None:
        self.calls.append(f"stiff {value:g}")
        self.stiff.update(dict.fromkeys(names, value))

    def angleInterpolation(
        self, names: list[str], angles: Any, times: Any, is_absolute: bool
    ) -> None:
        if not is_absolute or len(names) != len(angles) or len(angles) != len(times):
            raise ValueError("angleInterpolation: sizes differ")
        for name, rows, moments in zip(names, angles, times, strict=True):
            if len(rows) != len(moments) or list(moments) != sorted(moments) or moments[0] <= 0:
                raise ValueError(f"angleInterpolation: bad times of {name}")
            if self.stiff[name] == 0.0:
                raise ValueError(f"angleInterpolation: {name} is not stiff")
        if self.lying == "rejected":
            raise ValueError("angleInterpolation: refused")
        self.calls.append(f"move {names[0]} {len(names)} {len(angles[0])}")
        self.newest += 1
        task = self.newest
        if self.lying == "another begins as well":
            self.tasks[THEIRS] = False
        self.tasks[task] = False
        if self.lying in GOING_ON:
            self.drifting = {"RElbowRoll": 0.5}
        going = threading.Thread(target=self._interpolate, args=(task, names, angles, times))
        going.start()
        if self.lying != "success at once":
            going.join()
        if self.lying == "success, but it fell limp":
            self.angles.update(dict.fromkeys(names, 0.0))

    def _interpolate(self, task: int, names: list[str], angles: Any, times: Any) -> None:
        try:
            self._go(task, names, angles, times)
        finally:
            del self.tasks[task]

    def _go(self, task: int, names: list[str], angles: Any, times: Any) -> None:
        began = {name: self.angles[name] for name in names}
        start = time.monotonic()
        passed, takes = 0.0, max(moments[-1] for moments in times)
        if self.lying.startswith("canceled"):
            takes /= 2  # another program kills it there
        while passed < takes:
            if self.tasks[task]:
                return
            time.sleep(0.002)
            passed = min((time.monotonic() - start) * self.hurry, takes)
            for name, rows, moments in zip(names, angles, times, strict=True):
                if name != self.blocked:
                    way = [began[name], *rows]
                    self.angles[name] = float(np.interp(passed, [0.0, *moments], way))
                if name.endswith("Hand"):
                    self.angles[name] = max(self.angles[name], self.in_hand)
            self.last_moved = self.now()

    def getTaskList(self) -> list[Any]:
        if self.lying == "no list of tasks":
            return ["angleInterpolation"]
        return [["angleInterpolation", task] for task in self.tasks]

    def killTask(self, task: int) -> bool:
        self.calls.append(f"killed {task}")
        if task in self.tasks:
            self.tasks[task] = True
        return task in self.tasks

    def killTasksUsingResources(self, names: list[str]) -> None:
        self.calls.append("killed all")
        for task in self.tasks:
            self.tasks[task] = True

    # Of the stand-in only.

    def put(self, angles: dict[str, float]) -> None:
        self.angles.update(angles)

    def arrange(self, in_hand: float, blocked: str, hurry: float) -> None:
        self.in_hand, self.blocked, self.hurry = in_hand, blocked, hurry

    def drift(self, name: str, rate: float) -> None:
        self.drifting = {name: rate} if rate else {}

    def told(self) -> list[str]:
        return self.calls

    def now(self) -> float:
        """Return the time in which the motions go on, s."""
        return time.monotonic() * self.hurry

    def lie(self, how: str) -> None:
        self.lying = how

    def forget(self) -> None:
        """Forget what was called, and end what still goes on."""
        self.calls = []
        self.tasks.pop(THEIRS, None)
        for task in self.tasks:
            self.tasks[task] = True

    def begun(self) -> list[int]:
        """Return the numbers of the tasks of arms that stiffened joints began, of the right arm."""
        moves = [call for call in self.calls if call.startswith("move R")]
        return list(range(self.newest - len(moves) + 1, self.newest + 1))

    def killed(self) -> list[int]:
        kills = [call.split()[1] for call in self.calls if call.startswith("killed ")]
        return [int(kill) for kill in kills if kill != "all"]

    def report(self) -> dict[str, Any]:
        return {
            "clock": self.now(),
            "last_moved": self.last_moved,
            "goals": len(self.begun()),
            "moves": bool(self.tasks),
            "at": self.angles["RShoulderPitch"],
        }


class ALAutonomousLife:
    """Whether the robot lives by itself."""

    def __init__(self) -> None:
        self.state = "solitary"

    def getState(self) -> str:
        return self.state

    def setState(self, state: str) -> None:
        self.state = state


class ALMemory:
    """The current of a hand, and the time of the sensors."""

    def __init__(self) -> None:
        self.frozen = False

    def freeze(self, frozen: bool) -> None:
        self.frozen = frozen

    def getData(self, key: str) -> float:
        if key == "DCM/Time":
            return 0.0 if self.frozen else round(time.monotonic() * 1000)
        if not key.endswith("Hand/ElectricCurrent/Sensor/Value"):
            raise ValueError(f"no data {key}")
        return 0.12


class ALVideoDevice:
    """A camera whose pictures are red at the left and blue at the right."""

    def __init__(self) -> None:
        self.open: list[str] = []

    def subscribeCamera(self, name: str, camera: int, size: int, colours: int, fps: int) -> str:
        if camera not in (0, 1) or (size, colours) != (2, 11):
            return ""
        self.open.append(f"{name}_{camera}")
        return self.open[-1]

    @qi.bind(returnType=_IMAGE, paramsType=[qi.String])
    def getImageRemote(self, handle: str) -> tuple[Any, ...]:
        row = b"\xff\x00\x00" * (WIDTH // 2) + b"\x00\x00\xff" * (WIDTH // 2)
        data = bytearray(row * HEIGHT)
        return WIDTH, HEIGHT, 3, 11, 0, 0, data, 0, 0.5, 0.4, -0.5, -0.4

    def releaseImage(self, handle: str) -> None:
        pass

    def unsubscribe(self, handle: str) -> None:
        self.open.remove(handle)

    def subscribed(self) -> list[str]:
        return self.open


def main() -> None:
    """Offer the services until standard input ends."""
    session = qi.Session()
    session.listenStandalone("tcp://127.0.0.1:0")
    for service in (ALMotion(), ALAutonomousLife(), ALMemory(), ALVideoDevice()):
        session.registerService(type(service).__name__, service)
    sys.stdout.write(f"ready {session.endpoints()[0]}\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    main()
