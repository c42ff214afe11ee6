"""Memory of a reader process: how much it uses, and limits on it.

This file is part of the keeper's script and needs only the standard library.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator

__all__ = ["ResidentBytes", "limit_memory", "memory_limit", "resident_bytes"]

_MEASURE_EVERY_S = 0.25


def limit_memory(allowed: int) -> None:
    """Limit this process to ``allowed`` bytes more than it uses now."""
    import resource

    used = _data_bytes()
    resource.setrlimit(resource.RLIMIT_DATA, (used + allowed, used + allowed))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _data_bytes() -> int:
    with contextlib.suppress(OSError, ValueError, StopIteration), open("/proc/self/status") as file:  # noqa: PTH123 - no pathlib in a process that must be small
        line = next(line for line in file if line.startswith("VmData:"))
        return int(line.split()[1]) << 10
    return 0


@contextlib.contextmanager
def memory_limit(allowed: int) -> Iterator[None]:
    """Limit this process to ``allowed`` bytes more than it uses now, inside the block."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = _data_bytes() + allowed
    resource.setrlimit(resource.RLIMIT_DATA, (limit if soft < 0 else min(limit, soft), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def resident_bytes() -> int:
    """Return the resident memory of this process that is not shared, in bytes."""
    try:
        with open("/proc/self/statm") as file:  # noqa: PTH123 - as above
            _, resident, shared, *_ = map(int, file.read().split())
    except OSError:
        return 0
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")


class ResidentBytes:
    """Resident memory of this process, measured at most a few times a second."""

    def __init__(self) -> None:
        self._again = 0.0
        self._bytes = 0

    def recent(self) -> int:
        """Return a recent measurement."""
        now = time.monotonic()
        if now >= self._again:
            self._again = now + _MEASURE_EVERY_S
            self._bytes = resident_bytes()
        return self._bytes
