"""Calls of instances outside this process, to and from which only values travel."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from rtask.errors import RtaskError, ServiceFailedError, UsageError
from rtask.kb.commit.access import Access
from rtask.services.call import Call, Listener
from rtask.services.definition import Definition
from rtask.services.registry import load
from rtask.services.task import Task
from rtask.wire.message import read

__all__ = ["Sent", "definition_from", "receive", "send", "sendable", "values_of"]

Sent = tuple[str, dict[str, Any], Access, float]
"""A call on its way: name of the method, values of the request, caller, and time left, s."""


def send(task: Task) -> Sent:
    """Return a call as the values that travel."""
    call = task.call
    return task.method.name, values_of(task.request), call.caller, max(call.left_s, 0.0)


def receive(sent: Sent, definition: Definition, on_progress: Listener) -> Task:
    """Return a call that came, to be carried out here."""
    name, values, caller, left_s = sent
    call = Call(caller, left_s, (definition.name,))
    call.on_progress(on_progress)
    method = definition.methods[name]
    return Task(method, read(method.request, values), call, definition.exact)


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
    definition = next(
        (
            definition_loaded
            for definition_loaded in load(module)
            if definition_loaded.exact == exact
        ),
        None,
    )
    if definition is None:
        raise UsageError(f"{module} no longer defines {exact}: restart the server")
    return definition


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
