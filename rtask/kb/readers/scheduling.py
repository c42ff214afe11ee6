"""Long time slices for queries that take their time, so that quick ones need not wait for a core.

Linux lets a process that wakes up interrupt one with a longer slice than its own (since 6.12,
"EEVDF", Stoica and Abdel-Wahab 1995). A reader with a long slice still gets its fair share of the
processor, in fewer and longer turns. Elsewhere nothing changes.

This file is part of the keeper's script and needs only the standard library and pyoxigraph.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

__all__ = ["in_long_turns"]

_SLICE_NS = 20_000_000
_OWN_CHOICE = 0
"""As a slice: the kernel's own choice."""
_SET_ATTRIBUTES = {"x86_64": 314, "aarch64": 274}
"""Numbers of the system call sched_setattr, which the C library lacks before glibc 2.41."""
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")
"""size, policy, flags, nice, priority, slice, deadline, period"""


@contextmanager
def in_long_turns() -> Iterator[None]:
    """Let this process have long turns on a processor meanwhile, which quick ones interrupt."""
    _set_slice(_SLICE_NS)
    try:
        yield
    finally:
        _set_slice(_OWN_CHOICE)


def _set_slice(slice_ns: int) -> None:
    number = _SET_ATTRIBUTES.get(platform.machine())
    if sys.platform != "linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, slice_ns, 0, 0)
    _c_library().syscall(number, 0, attributes, 0)  # an older kernel ignores it


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None)
