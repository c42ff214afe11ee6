"""A stand-in for a NAO: NAOqi's services of a robot without physics, over the real protocol.

Run as a program, it prints ``ready ADDRESS`` and ends when its input does. Joints go where they are
sent, at once when the motion's time has passed; what lies in the hand stops it.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import qi

ARM_JOINTS = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
NAMES = [f"{side}{joint}" for side in "LR" for joint in (*ARM_JOINTS, "Hand")]
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

    def getAngles(self, names: list[str], use_sensors: bool) -> list[float]:
        for name, rate in self.drifting.items():
            self.angles[name] += rate * 0.1
        return [self.angles[name] for name in names]

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
        self.calls.append(f"move {names[0]} {len(names)} {len(angles[0])}")
        self.newest += 1
        task = self.newest
        self.tasks[task] = False
        try:
            self._interpolate(task, names, angles, times)
        finally:
            del self.tasks[task]

    def _interpolate(self, task: int, names: list[str], angles: Any, times: Any) -> None:
        ends = time.monotonic() + max(moments[-1] for moments in times) / self.hurry
        while time.monotonic() < ends:
            if self.tasks[task]:
                return
            time.sleep(0.002)
        for name, rows in zip(names, angles, strict=True):
            if name != self.blocked:
                self.angles[name] = float(rows[-1])
            if name.endswith("Hand"):
                self.angles[name] = max(float(rows[-1]), self.in_hand)

    def getTaskList(self) -> list[Any]:
        return [["angleInterpolation", task] for task in self.tasks]

    def killTask(self, task: int) -> bool:
        self.calls.append(f"killed {task}")
        if task in self.tasks:
            self.tasks[task] = True
        return task in self.tasks

    def killTasksUsingResources(self, names: list[str]) -> None:
        self.calls.append("killed all")
        self.tasks = dict.fromkeys(self.tasks, True)

    # Of the stand-in only.

    def put(self, angles: dict[str, float]) -> None:
        self.angles.update(angles)

    def arrange(self, in_hand: float, blocked: str, hurry: float) -> None:
        self.in_hand, self.blocked, self.hurry = in_hand, blocked, hurry

    def drift(self, name: str, rate: float) -> None:
        self.drifting = {name: rate} if rate else {}

    def told(self) -> list[str]:
        return self.calls


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
