"""The operations of the engine as the service ``rtask/Engine``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.services.definition import Definition, Method

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.engine.operations.operation import Operation
    from rtask.services.call import Call
    from rtask.wire.message import Message

__all__ = ["engine_service"]

_WORKERS = 32


def engine_service(engine: Engine) -> Definition:
    """Return the operations of an engine as a service; each has the scope that it always has."""
    return Definition(
        name="rtask/Engine",
        version="1.0.0",
        summary="The shared memory of objects and grasps",
        description="Recognise, recall, store and curate: the operations of the engine.",
        methods={name: _method(operation) for name, operation in engine.operations.items()},
        resources={},
        make=lambda resources: engine,
        max_workers=_WORKERS,
    )


def _method(operation: Operation[Any, Any]) -> Method:
    def invoke(engine: Engine, request: Message, call: Call) -> Any:
        if operation.effect != "writes":
            return operation.answer_to(engine.context, request, call.caller)
        with call.ending.writing(is_last=True):  # once it writes, only its own end counts
            return operation.answer_to(engine.context, request, call.caller)

    summary = operation.summary[0].upper() + operation.summary[1:]
    return Method(
        operation.name, summary, "", operation.scope, operation.effect, operation.request,
        operation.answer, "", invoke,
    )  # fmt: skip
