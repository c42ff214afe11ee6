"""Methods of services as services and actions of rosbridge.

The data resources of a call are named by the member ``$data`` of its arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from endpoint.rosbridge.actions import Action, Progress
from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.services import Service
from rtask.kb.commit.access import Access
from rtask.services import ServiceHost
from rtask.services.call import Invocation
from rtask.services.definition import Definition, Method
from rtask.services.description import ros_service, ros_type
from rtask.services.host import MAX_TIMEOUT_S
from rtask.services.task import Task
from rtask.wire.effect import Source

_DATA = "$data"


def hosted_services(host: ServiceHost | None) -> list[Service]:
    """Return one service for each method of each service, of its newest version."""
    if host is None:
        return []
    return [hosted_service(host, definition, method) for definition, method in _methods(host)]


def hosted_service(host: ServiceHost, definition: Definition, method: Method) -> Service:
    """Return a method as a service of rosbridge."""

    def prepare(args: JsonObject, access: Access, timeout_s: float) -> HostedCall:
        given, data = _split(args)
        asked = Invocation(
            definition.name, method.name, given, access, data, timeout_s, data_form=_DATA
        )
        return HostedCall(host, host.prepare(asked))

    def handler(args: JsonObject, access: Access) -> JsonObject:
        return prepare(args, access, definition.timeout_s).result()

    return Service(
        ros_service(definition.name, method.name), ros_type(definition, method), method.scope,
        handler, request=method.request, answer=method.answer, prepare=prepare,
        at_copy=is_at_copy(definition, method),
    )  # fmt: skip


class HostedCall:
    """A call of a method, whose end the host settles once."""

    def __init__(self, host: ServiceHost, task: Task) -> None:
        self._host, self._task = host, task
        self.expire, self.cancel = task.expire, task.cancel

    def result(self) -> JsonObject:
        """Carry the call out and return its answer; errors as :meth:`ServiceHost.call`."""
        self._host.start(self._task)
        return self._task.result().as_json()


def hosted_actions(host: ServiceHost | None) -> list[Action]:
    """Return one action for each method: the same call with progress and cancel."""
    if host is None:
        return []

    def of(definition: Definition, method: Method) -> Action:
        def handler(args: JsonObject, access: Access, progress: Progress) -> JsonObject:
            given, data = _split(args)
            task = host.prepare(
                Invocation(
                    definition.name,
                    method.name,
                    given,
                    access,
                    data,
                    timeout_s=MAX_TIMEOUT_S,
                    data_form=_DATA,
                )
            )
            task.call.on_progress(progress.report)
            progress.on_cancel(task.cancel)
            host.start(task)
            return task.result().as_json()

        name, type_ = ros_service(definition.name, method.name), ros_type(definition, method)
        return Action(name, type_, method.scope, handler, is_at_copy(definition, method))

    return [of(definition, method) for definition, method in _methods(host)]


def is_at_copy(definition: Definition, method: Method) -> bool:
    """Return whether a follower carries a method out itself."""
    return source_of(definition, method) == "graph"


def source_of(definition: Definition, method: Method) -> Source:
    """Return what the answer of a method is made from.

    The writer alone carries out what writes, and has the datasets and the workers of services.
    """
    has_datasets = any(resource.type == "binary" for resource in definition.resources.values())
    is_elsewhere = has_datasets or definition.executor == "outward"
    return "writer" if is_elsewhere or method.effect == "writes" else "graph"


def _methods(host: ServiceHost) -> Iterator[tuple[Definition, Method]]:
    for definition in host.registry:
        for method in definition.methods.values():
            yield definition, method


def _split(args: JsonObject) -> tuple[JsonObject, Mapping[str, str] | None]:
    """Return the arguments of a method and the datasets that a call names."""
    given = dict(args)
    return given, given.pop(_DATA, None)
