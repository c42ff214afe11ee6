"""Use cases of RTASK, independent of HTTP and physics.

A robot sends an observation; the engine answers which object it is, how it was grasped before and
which grasp to try. The robot reports the outcome, and the next robot benefits from it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.engine.operations.operation import Operation
    from rtask.engine.policy import Policy

__all__ = ["Engine", "Operation", "Policy"]

_PLACES = {
    "Engine": "rtask.engine.engine",
    "Operation": "rtask.engine.operations.operation",
    "Policy": "rtask.engine.policy",
}


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        import importlib

        return getattr(importlib.import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'rtask.engine' has no attribute {name!r}")
