"""`/rosapi`: which time, topics, services, nodes, actions and parameters there are.

Clients wait three seconds for these answers, so they are given by the reader at once, from the
tables as they are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from endpoint.rosbridge.actions import Actions
from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.parameters import Parameters
from endpoint.rosbridge.providers import Peer, Providers
from endpoint.rosbridge.services import Service, ServiceTable
from endpoint.rosbridge.topics import Topics
from endpoint.rosbridge.typedefs import full_text, message_typedefs, typedefs_of
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.access import Access

SERVER_NODE = "/rtask"
Answer = Callable[[JsonObject], JsonObject]
# The request fields of each service in the order of its .srv file, for callers that send a list.
_FIELDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("topic_type", "publishers", "subscribers"), ("topic",)),
    **dict.fromkeys(("service_type", "service_node", "service_providers"), ("service",)),
    **dict.fromkeys(("topics_for_type", "services_for_type", "message_details"), ("type",)),
    **dict.fromkeys(("service_request_details", "service_response_details"), ("type",)),
    **dict.fromkeys(("has_param", "delete_param"), ("name",)),
    "service_request_text": ("type",),
    "node_details": ("node",),
    "get_param": ("name", "default_value"),
    "set_param": ("name", "value"),
}


@dataclass(frozen=True)
class Graph:
    """The computation graph, in the words of ROS, which `/rosapi` describes."""

    table: ServiceTable
    topics: Topics
    providers: Providers
    actions: Actions
    parameters: Parameters
    sessions: Callable[[], Iterable[Peer]]

    def nodes(self) -> dict[str, Peer | None]:
        """Return the server and one node for each connected robot."""
        nodes: dict[str, Peer | None] = {SERVER_NODE: None}
        for peer in self.sessions():
            name = f"/{peer.identity}"
            # One robot may hold several connections, and names of nodes are unique in ROS.
            nodes[f"{name}_{peer.number}" if name in nodes else name] = peer
        return nodes

    def services(self) -> list[tuple[str, str]]:
        """Return names and types of all services, sorted."""
        own = [(service.name, service.type) for service in self.table]
        return sorted(
            [*own, *((provider.name, provider.type) for provider in self.providers.listing())]
        )

    def node_of(self, number: int) -> str:
        """Return the node of a session."""
        names = (n for n, peer in self.nodes().items() if peer and peer.number == number)
        return next(names, "")

    def server_topics(self) -> list[str]:
        """Return the topics that the server itself publishes."""
        return [name for name, _ in self.topics.listing() if name.startswith("/rtask/")]


def rosapi_services(graph: Graph) -> list[Service]:
    """Return the services of `/rosapi`."""
    read = {**_listings(graph), **_nodes(graph), **_types(graph), **_parameters(graph)}
    write = _parameter_changes(graph)
    return [
        *(_service(name, "read", answer) for name, answer in read.items()),
        *(_service(name, "write", answer) for name, answer in write.items()),
    ]


def _service(name: str, scope: str, answer: Answer) -> Service:
    def handler(args: JsonObject, access: Access) -> JsonObject:
        return answer(args)

    camel = "".join(part.title() for part in name.split("_"))
    # The one service whose type does not follow from its name.
    type_ = "rosapi/GetActionServers" if name == "action_servers" else f"rosapi/{camel}"
    fields = _FIELDS.get(name, ())
    return Service(f"/rosapi/{name}", type_, scope, handler, inline=True, positional=fields)


def _listings(graph: Graph) -> dict[str, Answer]:
    def topics(args: JsonObject) -> JsonObject:
        listed = graph.topics.listing()
        return {"topics": [name for name, _ in listed], "types": [type_ for _, type_ in listed]}

    def raw(args: JsonObject) -> JsonObject:
        listed = topics(args)
        texts = [
            [full_text(typedef) for typedef in message_typedefs(name)] for name in listed["types"]
        ]
        return {**listed, "typedefs_full_text": [text[0] if text else "" for text in texts]}

    return {
        "get_time": _get_time,
        "topics": topics,
        "topics_and_raw_types": raw,
        "services": lambda args: {"services": [name for name, _ in graph.services()]},
        "action_servers": lambda args: {"action_servers": graph.actions.names()},
        "topic_type": lambda args: {
            "type": dict(graph.topics.listing()).get(_name(args, "topic"), "")
        },
        "topics_for_type": lambda args: {
            "topics": [n for n, type_ in graph.topics.listing() if type_ == _text(args, "type")]
        },
        "service_type": lambda args: {
            "type": dict(graph.services()).get(_name(args, "service"), "")
        },
        "services_for_type": lambda args: {
            "services": [n for n, type_ in graph.services() if type_ == _text(args, "type")]
        },
    }


def _nodes(graph: Graph) -> dict[str, Answer]:
    def details(args: JsonObject) -> JsonObject:
        node = _name(args, "node")
        nodes = graph.nodes()
        if node not in nodes:
            return {"subscribing": [], "publishing": [], "services": []}
        peer = nodes[node]
        if peer is None:
            own = [service.name for service in graph.table]
            return {"subscribing": [], "publishing": graph.server_topics(), "services": own}
        publishing, subscribing = graph.topics.of(peer.number)
        provided = [
            provider.name for provider in graph.providers.listing() if provider.peer is peer
        ]
        return {"subscribing": subscribing, "publishing": publishing, "services": provided}

    def publishers(args: JsonObject) -> JsonObject:
        name = _name(args, "topic")
        own = [SERVER_NODE] if name in graph.server_topics() else []
        advertisers, _ = graph.topics.sessions(name)
        return {"publishers": own + sorted(map(graph.node_of, advertisers))}

    def subscribers(args: JsonObject) -> JsonObject:
        _, numbers = graph.topics.sessions(_name(args, "topic"))
        return {"subscribers": sorted(map(graph.node_of, numbers))}

    def service_node(args: JsonObject) -> JsonObject:
        name = _name(args, "service")
        provider = graph.providers.find(name)
        if provider is not None:
            return {"node": graph.node_of(provider.peer.number)}
        return {"node": SERVER_NODE if name in dict(graph.services()) else ""}

    def service_providers(args: JsonObject) -> JsonObject:
        node = service_node(args)["node"]
        return {"providers": [node] if node else []}

    return {
        "nodes": lambda args: {"nodes": list(graph.nodes())},
        "node_details": details,
        "publishers": publishers,
        "subscribers": subscribers,
        "service_node": service_node,
        "service_providers": service_providers,
    }


def _types(graph: Graph) -> dict[str, Answer]:
    def service_of(type_: str) -> Service | None:
        return next(
            (service for service in graph.table if service.type == type_ and service.request), None
        )

    def message_details(args: JsonObject) -> JsonObject:
        type_ = _text(args, "type")
        return {"typedefs": message_typedefs(type_) or [_empty(type_)]}

    def request_details(args: JsonObject) -> JsonObject:
        type_name = _text(args, "type")
        service = service_of(type_name)
        if service is None or service.request is None:
            return {"typedefs": [_empty(f"{type_name}Request")]}
        return {"typedefs": typedefs_of(f"{type_name}Request", service.request)}

    def response_details(args: JsonObject) -> JsonObject:
        type_name = _text(args, "type")
        service = service_of(type_name)
        if service is None or service.answer is None:
            return {"typedefs": [_empty(f"{type_name}Response")]}
        return {"typedefs": typedefs_of(f"{type_name}Response", service.answer)}

    return {
        "message_details": message_details,
        "service_request_details": request_details,
        "service_response_details": response_details,
        "service_request_text": lambda args: {
            "text": full_text(request_details(args)["typedefs"][0])
        },
    }


def _parameters(graph: Graph) -> dict[str, Answer]:
    def get(args: JsonObject) -> JsonObject:
        name = _name(args, "name")
        value = graph.parameters.get(name)
        if value is not None:
            return {"value": value, "successful": True, "reason": ""}
        # Called default in ROS 1 and default_value in ROS 2.
        default = args.get("default") or args.get("default_value")
        if isinstance(default, str):
            return {"value": default, "successful": True, "reason": ""}
        reason = f"parameter {name} does not exist"
        return {"value": "null", "successful": False, "reason": reason}

    return {
        "get_param": get,
        "get_param_names": lambda args: {"names": graph.parameters.names()},
        "has_param": lambda args: {"exists": graph.parameters.get(_name(args, "name")) is not None},
    }


def _parameter_changes(graph: Graph) -> dict[str, Answer]:
    def change(args: JsonObject) -> JsonObject:
        try:
            graph.parameters.set(_name(args, "name"), _text(args, "value"))
        except RtaskError as error:
            return {"successful": False, "reason": str(error)}
        return {"successful": True, "reason": ""}

    def delete(args: JsonObject) -> JsonObject:
        name = _name(args, "name")
        done = graph.parameters.delete(name)
        return {
            "successful": done, "reason": "" if done else f"parameter {name} does not exist",
        }  # fmt: skip

    return {"set_param": change, "delete_param": delete}


def _get_time(args: JsonObject) -> JsonObject:
    """Return the time in the fields of ROS 1 and of ROS 2."""
    seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
    return {
        "time": {
            "secs": seconds,
            "nsecs": nanoseconds,
            "sec": seconds,
            "nanosec": nanoseconds,
        }
    }


def _empty(type_: str) -> JsonObject:
    names = ("fieldnames", "fieldtypes", "fieldarraylen", "examples", "constnames", "constvalues")
    return {"type": type_, **{name: [] for name in names}}


def _text(args: JsonObject, name: str) -> str:
    value: Any = args.get(name)
    if not isinstance(value, str):
        raise UsageError(f"{name}: expected a string")
    return value


def _name(args: JsonObject, name: str) -> str:
    return "/" + _text(args, name).lstrip("/")
