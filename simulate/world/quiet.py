"""Standard output kept for results, and the terminal free of the physics engine's banners."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["banner_on_stderr", "without_banner"]

_BANNERS = (b"pybullet build time:", b"argv[0]=")


@contextmanager
def banner_on_stderr() -> Iterator[None]:
    """Send what pybullet prints to standard error: results go to standard output.

    The library writes to file descriptor 1 through the buffers of the C library.
    """
    with _redirected(2, (1,)):
        yield


@contextmanager
def without_banner() -> Iterator[None]:
    """Drop the lines with which pybullet greets; anything else it prints goes to standard error."""
    with tempfile.TemporaryFile() as printed:
        try:
            with _redirected(printed.fileno(), (1, 2)):
                yield
        finally:
            printed.seek(0)
            other_lines = [line for line in printed if not line.startswith(_BANNERS)]
            os.write(2, b"".join(other_lines))


@contextmanager
def _redirected(target: int, descriptors: tuple[int, ...]) -> Iterator[None]:
    c_library = ctypes.CDLL(None)
    sys.stdout.flush()
    sys.stderr.flush()
    c_library.fflush(None)
    copies = {descriptor: os.dup(descriptor) for descriptor in descriptors}
    for descriptor in descriptors:
        os.dup2(target, descriptor)
    try:
        yield
    finally:
        sys.stderr.flush()
        c_library.fflush(None)
        for descriptor, copy in copies.items():
            os.dup2(copy, descriptor)
            os.close(copy)
