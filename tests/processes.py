"""Wait for processes and threads to be as expected."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

EVER_LONGER_S = (0.4, 4.0, 40.0)
"""Times to wait for what never comes: what is to come before it may take long on a busy machine."""


def is_alive(pid: int) -> bool:
    """Whether a process is there, a zombie included."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_until(condition: Callable[[], bool], within_s: float = 60.0) -> None:
    """Wait for a condition, for as long as a busy machine may take, or fail."""
    end = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def end_of_checkpoints() -> None:
    """Wait for the checkpoints that are under way in this process."""
    for thread in threading.enumerate():
        if thread.name == "rtask-checkpoint":
            thread.join()
