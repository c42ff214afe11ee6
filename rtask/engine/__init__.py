"""The use cases of RTASK, free of HTTP and physics.

A robot sends what it sees; the engine says which object that is, how it was taken before and which
grasp to try; the robot tells what came of it, and the next robot starts from there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.engine.operations.table import Operation
    from rtask.engine.policy import Policy

__all__ = ["Engine", "Operation", "Policy"]

_PLACES = {
    "Engine": "rtask.engine.engine",
    "Operation": "rtask.engine.operations.table",
    "Policy": "rtask.engine.policy",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        import importlib

        return getattr(importlib.import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'rtask.engine' has no attribute {name!r}")
