"""Pauses of the collector of reference cycles.

Each time the number of live objects has grown by a quarter, the collector looks at all of them. A
load makes hundreds of thousands of terms and keys, none of them in a cycle, so this would be a
third of its time.
"""

from __future__ import annotations

import contextlib
import gc
import threading
from collections.abc import Iterator

__all__ = ["collector_paused"]

_lock = threading.Lock()
_pauses = 0
_was_enabled = False


@contextlib.contextmanager
def collector_paused() -> Iterator[None]:
    """Let no cycles be collected in the block, in this process; blocks may overlap."""
    global _pauses, _was_enabled
    with _lock:
        if not _pauses:
            _was_enabled = gc.isenabled()
            gc.disable()
        _pauses += 1
    try:
        yield
    finally:
        with _lock:
            _pauses -= 1
            if not _pauses and _was_enabled:
                gc.enable()
