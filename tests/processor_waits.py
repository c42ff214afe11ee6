"""Waits of a client, less what it and the server stood in line for a processor.

On a busy machine most of a long answer is waiting for a processor, which says nothing about the
server. Linux counts that wait for each thread (``/proc/PID/task/TID/schedstat``, second field).
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Wait", "timed", "waits_in_line"]


@dataclass
class Wait:
    """How long an answer took.

    Parameters
    ----------
    clock_s
        By the clock.
    own_s
        Of this, what is left without the longest wait of any thread of the server for a processor
        and without that of the asking thread. Threads of a chain wait one after the other, so this
        is still more than an idle machine would have taken.
    """

    clock_s: float = 0.0
    own_s: float = 0.0


def waits_in_line(pid: int) -> dict[str, int]:
    """Return how long each thread of a process has waited for a processor so far, ns."""
    waits: dict[str, int] = {}
    for thread in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(OSError):  # the thread has ended meanwhile
            waits[thread.name] = int((thread / "schedstat").read_text("ascii").split()[1])
    return waits


def _of_this_thread() -> int:
    return int(Path("/proc/thread-self/schedstat").read_text("ascii").split()[1])


@contextlib.contextmanager
def timed(pid: int) -> Iterator[Wait]:
    """Measure what the block waits for an answer of the server with this process."""
    wait = Wait()
    before, mine, started = waits_in_line(pid), _of_this_thread(), time.perf_counter()
    yield wait
    wait.clock_s = time.perf_counter() - started
    mine = _of_this_thread() - mine
    after = waits_in_line(pid)
    longest = max((after[name] - before.get(name, 0) for name in after), default=0)
    wait.own_s = max(0.0, wait.clock_s - 1e-9 * (mine + longest))
