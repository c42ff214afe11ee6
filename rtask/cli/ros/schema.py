"""The schema of the engine's operations, for the commands of ``rtask ros``.

``python -m rtask.cli.ros.schema`` prints all definitions; after a change of a declaration that is
meant, write them to ``tests/rtask/interop/ros/rtask_msgs.txt``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rtask.interop.ros.schema import Schema

__all__ = ["definitions_text", "engine_schema"]


def engine_schema() -> Schema:
    """Return the schema of all operations of the engine."""
    from rtask.engine.operations.table import OPERATIONS
    from rtask.interop.ros.declared import declared_schema

    return declared_schema(OPERATIONS.values())


def definitions_text() -> str:
    """Return every message, service and action of ``rtask_msgs``, each after its path."""
    from rtask.interop.ros.package import source_files

    files = source_files(engine_schema()).items()
    return "".join(f"== {path}\n{text}\n" for path, text in files if "/" in path)


if __name__ == "__main__":
    print(definitions_text(), end="")  # noqa: T201 - this is what it is for
