"""Services that tests give to workers; the server does not know them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from rtask.services import Call, Service, data_resource, method
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Pose, Unit


class Echoed(Answer):
    """Value that came, and who sends it back."""

    numbers: Array
    data: Bytes
    pose: Pose
    pid: int


class Field(Service):
    """Work that changes nothing."""

    name, version = "farm/Field", "1.0.0"
    max_workers = 2

    @method
    def echo(self, numbers: Annotated[Array, Unit("m")], data: bytes, pose: Pose) -> Echoed:
        """Send everything back."""
        return Echoed(numbers=2 * numbers, data=data, pose=pose, pid=os.getpid())

    @method(output="pid", effect="reads")
    def work(self, call: Call, until: str = "", most: Annotated[float, Ge(0)] = 60.0) -> int:
        """Wait for a file to appear, and tell who waited.

        Parameters
        ----------
        until
            Path of the file; none = do not wait.
        most
            Longest wait.
        """
        call.progress(0.5, "waiting")
        end = time.monotonic() + most
        while until and not Path(until).exists() and time.monotonic() < end:
            call.check_cancelled()
            time.sleep(0.01)
        return os.getpid()

    @method(output="pid")
    def die_once(self, marker: str) -> int:
        """End the worker the first time."""
        _die_once(Path(marker))
        return os.getpid()

    @method
    def refuse(self) -> None:
        """Refuse."""
        raise ValueError("nothing grows here")


class Barn(Service):
    """A store that calls write to."""

    name, version = "farm/Barn", "1.0.0"
    store = data_resource("binary", writable=True)

    @method(output="total", effect="writes")
    def add(self, number: int, marker: str = "") -> int:
        """Add to the sum in the store; end the worker after writing where a marker is named."""
        before = int(self.store.read("/sum")) if (self.store.folder / "sum").exists() else 0
        self.store.write("/sum", str(before + number).encode())
        if marker:
            _die_once(Path(marker))
        return before + number


def _die_once(marker: Path) -> None:
    try:
        marker.touch(exist_ok=False)
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)
