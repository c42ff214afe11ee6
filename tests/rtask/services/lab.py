"""Services for tests: an arm, work that can be cancelled, and mistakes of authors and callers."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from rtask.errors import ServiceError
from rtask.services import Call, Service, data_resource, method, shutdown, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Pose, Unit

CLOSED: list[str] = []
HEARD: list[Any] = []


class Stretch(Answer):
    """Reach of an arm."""

    distance: Annotated[float, Unit("m")]
    """from the base"""
    joints: Array
    """as they were given"""


class Turned(Answer):
    """Value that came."""

    pose: Pose
    image: Bytes
    pid: int


class Arm(Service):
    """A planar arm.

    Its links are 1 m long.
    """

    name = "lab/Arm"
    version = "1.2.0"

    @startup
    def load(self) -> None:
        self.lengths = np.ones(3)
        self.cache: dict[str, Any] = {}

    @shutdown
    def leave(self) -> None:
        CLOSED.append(self.name)

    @method(output="pose")
    def forward(
        self,
        joints: Annotated[Array, Unit("rad")],
        scale: Annotated[float, Ge(0), Le(10)] = 1.0,
    ) -> Pose:
        """Pose of the hand in the base frame.

        Parameters
        ----------
        joints : (n,) float, rad
            Angles from the base to the hand.
        scale
            Factor of all lengths.
        """
        angles = np.cumsum(joints)
        reach = self.lengths[: len(joints)] * scale
        base_from_hand = np.eye(4)
        base_from_hand[:2, 3] = (reach * np.cos(angles)).sum(), (reach * np.sin(angles)).sum()
        return base_from_hand

    @method
    def stretch(self, joints: Array) -> Stretch:
        """Distance that the arm reaches."""
        return Stretch(distance=float(len(joints)), joints=joints)

    @method(output="size")
    def weigh(self, image: Bytes) -> int:
        """Number of bytes of an image."""
        return len(image)

    @method(effect="reads")
    def count(self, steps: int, pause_s: float, call: Call) -> int:
        """Count, and say how far it is."""
        for step in range(steps):
            call.progress(step / steps, f"step {step}")
            time.sleep(pause_s)
        return steps

    @method
    def teach(self, key: str) -> str:
        """Remember, against the rule."""
        self.cache[key] = [len(self.cache)]
        return key

    @method
    def fail(self, kind: str) -> float:
        """Fail in one of three ways."""
        if kind == "refuse":
            raise ServiceError("that is out of reach", reach=3.0)
        if kind == "crash":
            raise ZeroDivisionError("division by zero")
        return "not a number"  # type: ignore[return-value]  # what an author may get wrong

    @method(scope="write", effect="writes")
    def store(self, text: str) -> str:
        """Change something, with the right to."""
        return text

    @method(effect="writes")
    def ask_again(self, depth: int, call: Call) -> float:
        """Call this service by a detour, which would never end."""
        detour = call.connect("lab/Detour")
        answer: float = detour.back(depth)
        return answer


class Detour(Service):
    """A service that calls another."""

    name = "lab/Detour"

    @method(effect="writes")
    def back(self, depth: int, call: Call) -> float:
        """Call the arm."""
        answer: float = call.connect("lab/Arm").ask_again(depth)
        return answer

    @method(effect="reads")
    def reach(self, joints: Array, call: Call) -> float:
        """Ask the arm, and say who asks."""
        found = call.connect("lab/Arm@1.*").stretch(joints)
        assert call.chain == ("lab/Detour",)
        distance: float = found.distance
        return distance


class Scan(Service):
    """Points of a scan, in steps whose middle results are large."""

    name = "lab/Scan"

    @method(output="points")
    def read(self, data: bytes) -> Array:
        """Return the coordinates that bytes hold, float32."""
        return np.frombuffer(data, np.float32).astype(float)

    @method(output="points")
    def move(self, points: Array, by: Array) -> Array:
        """Return the coordinates of points, moved."""
        return (points.reshape(-1, 3) + by).ravel()

    @method(output="centre")
    def centre(self, points: Array) -> Array:
        """Return the centre of points."""
        return points.reshape(-1, 3).mean(axis=0)


class Fragile(Service):
    """A service that can die."""

    name = "lab/Fragile"
    executor = "processes"
    max_workers = 2

    @startup
    def load(self) -> None:
        self.pid = os.getpid()

    @method(effect="reads")
    def turn(self, pose: Pose, image: bytes, call: Call) -> Turned:
        """Return what it was given, and who did it."""
        call.progress(0.5, "half")
        return Turned(pose=pose, image=image, pid=self.pid)

    @method
    def die_once(self, marker: str) -> int:
        """End the process the first time, and answer the second."""
        if not Path(marker).exists():
            Path(marker).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return os.getpid()

    @method
    def hang(self) -> None:
        """Never end."""
        while True:
            time.sleep(1)

    @method
    def crash(self) -> None:
        """Raise."""
        raise KeyError("nothing")


class Writer(Service):
    """A service that dies and may have written."""

    name = "lab/Writer"
    executor = "processes"
    store = data_resource("binary", writable=True)

    @method(scope="write", effect="writes")
    def write(self, marker: str) -> None:
        """Die in the middle."""
        with Path(marker).open("a") as out:
            out.write("x")
        self.store.write("half", b"x")
        os.kill(os.getpid(), signal.SIGKILL)


class Notebook(Service):
    """A service that keeps a count in its data."""

    name = "lab/Notebook"
    store = data_resource("binary", writable=True)

    @method(scope="write", effect="writes")
    def add(self, number: int, fail: bool = False) -> int:
        """Add to the sum that was kept."""
        files = {one.name for one in self.store.folder.iterdir()}
        total = number + (int(self.store.read("sum")) if "sum" in files else 0)
        self.store.write("/sum", str(total).encode())
        if fail:
            raise ServiceError("no")
        return int(self.store.read("sum"))


class ApartNotebook(Notebook):
    """The same in a process of its own."""

    name = "lab/ApartNotebook"
    executor = "processes"


class OldArm(Service):
    """An arm of former times."""

    name, version = "lab/Arm", "1.1.9"

    @method
    def forward(self) -> str:
        """Say what it is."""
        return "old"


class Broken(Service):
    """A service that cannot be made ready."""

    name = "lab/Broken"

    @startup
    def load(self) -> None:
        raise OSError("no such device")

    @method
    def use(self) -> None:
        """Be of no use."""


class Reader(Service):
    """A service that reads a file of its data."""

    name = "lab/Reader"
    model = data_resource("binary", summary="a folder with the file /model")

    @startup
    def load(self) -> None:
        self.text = self.model.path("/model").read_text("utf-8")

    @method(output="text")
    def read(self) -> str:
        """Return what the model says."""
        return self.text


class Counter(Service):
    """Objects of the graph, counted."""

    name = "lab/Counter"
    graph = data_resource("graph")

    @method(output="count", effect="reads")
    def count(self) -> int:
        """Count all statements."""
        rows = self.graph.query("SELECT (COUNT(*) AS ?n) { ?s ?p ?o }")
        return int(next(iter(rows))["n"].value)

    @method(scope="write", effect="writes")
    def note(self, text: str, call: Call) -> None:
        """Write to the graph."""
        self.graph.update(f'INSERT DATA {{ <urn:note> <urn:says> "{text}" }}', call.caller)


class NoteTaker(Counter):
    """A service that may write to the graph, and looks back."""

    name = "lab/NoteTaker"
    graph = data_resource("graph", writable=True)

    @startup
    def listen(self) -> None:
        self.stop = self.graph.follow(HEARD.append)

    @shutdown
    def leave(self) -> None:
        self.stop()

    @method(output="texts", effect="reads")
    def before(self, seq: int) -> list[str]:
        """Return the notes after a commit, and whether they are there now."""
        with self.graph.at(seq) as then:
            texts = [quad.object.value for quad in then.match("urn:note", "urn:says")]
            there = [self.graph.ask(f'ASK {{ <urn:note> <urn:says> "{one}" }}') for one in texts]
            assert all(there), "nothing was removed"
            assert then.seq == seq
            return sorted(texts)
