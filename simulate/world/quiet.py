"""Standard output kept for results while the physics engine starts."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["banner_on_stderr"]


@contextmanager
def banner_on_stderr() -> Iterator[None]:
    """Send what pybullet prints when it starts to standard error: results go to standard output.

    The library writes to file descriptor 1 through the buffers of the C library.
    """
    c_library = ctypes.CDLL(None)
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        c_library.fflush(None)
        os.dup2(kept, 1)
        os.close(kept)
