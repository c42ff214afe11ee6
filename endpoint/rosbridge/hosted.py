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

_DATA = "$data"


def hosted_services(host: ServiceHost | None) -> list[Service]:
    """Return one service for each method of each service, of its newest version."""
    if host is None:
        return []
    return [hosted_service(host, one, method) for one, method in _methods(host)]


def hosted_service(host: ServiceHost, definition: Definition, method: Method) -> Service:
    """Return a method as a service of rosbridge."""

    def handler(args: JsonObject, access: Access) -> JsonObject:
        given, data = _split(args)
        return host.call(definition.name, method.name, given, access, data).as_json()

    name, type_ = ros_service(definition.name, method.name), ros_type(definition, method)
    return Service(name, type_, method.scope, handler, request=method.request, answer=method.answer)


def hosted_actions(host: ServiceHost | None) -> list[Action]:
    """Return one action for each method: the same call with progress and cancel."""
    if host is None:
        return []

    def of(definition: Definition, method: Method) -> Action:
        def handler(args: JsonObject, access: Access, progress: Progress) -> JsonObject:
            given, data = _split(args)
            task = host.prepare(
                Invocation(
                    definition.name, method.name, given, access, data, timeout_s=MAX_TIMEOUT_S
                )
            )
            task.call.on_progress(progress.report)
            progress.on_cancel(task.cancel)
            host.start(task)
            return task.result().as_json()

        name, type_ = ros_service(definition.name, method.name), ros_type(definition, method)
        return Action(name, type_, method.scope, handler)

    return [of(definition, method) for definition, method in _methods(host)]


def _methods(host: ServiceHost) -> Iterator[tuple[Definition, Method]]:
    for definition in host.registry:
        for method in definition.methods.values():
            yield definition, method


def _split(args: JsonObject) -> tuple[JsonObject, Mapping[str, str] | None]:
    """Return the arguments of a method and the datasets that a call names."""
    given = dict(args)
    return given, given.pop(_DATA, None)
