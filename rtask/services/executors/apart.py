"""Parts shared by all workers outside this process, to which only values travel."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from rtask.errors import RtaskError, ServiceFailedError, UsageError
from rtask.services.definition import Definition
from rtask.services.registry import load

__all__ = ["definition_from", "sendable", "values_of"]


def definition_from(source: str, exact: str) -> Definition:
    """Return the definition of a service in the module or file that it came from.

    Parameters
    ----------
    source
        ``module:Class`` or ``file.py:Class``.
    exact
        Name and version of the service.

    Raises
    ------
    UsageError
        The file has changed and defines it no more.
    """
    module, _, _ = source.rpartition(":")
    found = next((one for one in load(module) if one.exact == exact), None)
    if found is None:
        raise UsageError(f"{module} no longer defines {exact}: restart the server")
    return found


def values_of(message: BaseModel) -> dict[str, Any]:
    """Return the fields of a message that are set, by their own names.

    Classes made from annotations exist in one process only; their values travel.
    """
    return {name: getattr(message, name) for name in message.model_fields_set}


def sendable(error: Exception) -> RtaskError:
    """Return an error that can be sent, in the words that callers see."""
    if isinstance(error, RtaskError):
        return error
    return ServiceFailedError(f"{type(error).__name__}: {error}"[:500])
