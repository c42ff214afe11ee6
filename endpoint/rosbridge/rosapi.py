"""The part of `/rosapi` that clients ask for: which time, topics and services there are."""

from __future__ import annotations

import time
from typing import Any

from endpoint.rosbridge.services import JsonObject, Service, ServiceTable
from endpoint.rosbridge.topics import Topics
from rtask.errors import UsageError


def rosapi_services(table: ServiceTable, topics: Topics) -> list[Service]:
    """Return the services; they read the tables as they are when they are called."""

    def list_topics(args: JsonObject) -> JsonObject:
        listed = topics.listing()
        return {"topics": [name for name, _ in listed], "types": [type_ for _, type_ in listed]}

    def list_services(args: JsonObject) -> JsonObject:
        return {"services": [service.name for service in table]}

    def topic_type(args: JsonObject) -> JsonObject:
        wanted = "/" + _text(args, "topic").lstrip("/")
        return {"type": dict(topics.listing()).get(wanted, "")}

    def topics_for_type(args: JsonObject) -> JsonObject:
        wanted = _text(args, "type")
        return {"topics": [name for name, type_ in topics.listing() if type_ == wanted]}

    def service_type(args: JsonObject) -> JsonObject:
        wanted = "/" + _text(args, "service").lstrip("/")
        return {"type": next((s.type for s in table if s.name == wanted), "")}

    def services_for_type(args: JsonObject) -> JsonObject:
        wanted = _text(args, "type")
        return {"services": [s.name for s in table if s.type == wanted]}

    answers = {
        "get_time": _get_time,
        "topics": list_topics,
        "services": list_services,
        "topic_type": topic_type,
        "topics_for_type": topics_for_type,
        "service_type": service_type,
        "services_for_type": services_for_type,
        "nodes": lambda args: {"nodes": ["/rtask"]},
        "action_servers": lambda args: {"action_servers": []},
        "get_param_names": lambda args: {"names": []},
    }
    types = {"action_servers": "rosapi/GetActionServers"}
    return [
        Service(
            f"/rosapi/{name}",
            types.get(name, "rosapi/" + "".join(part.title() for part in name.split("_"))),
            "read",
            _without_access(answer),
            inline=True,
        )
        for name, answer in answers.items()
    ]


def _without_access(answer: Any) -> Any:
    return lambda args, access: answer(args)


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


def _text(args: JsonObject, name: str) -> str:
    value = args.get(name)
    if not isinstance(value, str):
        raise UsageError(f"{name}: a string is wanted")
    return value
