"""Print the source of the typed client's methods, made from what the operations declare.

After a declaration has changed: ``python -m rtask.engine.client_calls > rtask/client/calls.py``.
"""

from __future__ import annotations

from rtask.engine.operations.table import OPERATIONS
from rtask.wire.stubs import source_of

__all__ = ["source"]


def source() -> str:
    """Return what ``rtask/client/calls.py`` is to contain."""
    return source_of(OPERATIONS.values(), "rtask.engine.client_calls")


if __name__ == "__main__":
    print(source(), end="")  # noqa: T201 - this is what it is for
