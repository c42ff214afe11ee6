"""Services as objects with their methods, for clients in process and across a network."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any

from rtask.services.proxy import Proxy, offer_read

__all__ = ["proxy_of"]

_POSE = "geometry_msgs/Pose"


def proxy_of(
    described: Mapping[str, Any],
    call: Callable[..., dict[str, Any]],
    data: Mapping[str, str] | None,
) -> Proxy:
    """Return the proxy of a service, made from its description.

    Parameters
    ----------
    described
        As :meth:`rtask.client.Client.describe_service` returns it.
    call
        :meth:`rtask.client.Client.call_service`.
    data
        Datasets for its data resources.
    """
    exact = f"{described['name']}@{described['version']}"
    methods = described["methods"]

    def carry_out(method: str, args: dict[str, Any]) -> Any:
        fields = methods[method]["request"].get("properties", {})
        given = {
            own: _sent(value, fields[own].get("x-ros-type", ""))
            for own, value in args.items()
            if value is not None
        }
        may_repeat = methods[method].get("effect") in ("reads", "records")
        return call(exact, method, given, data, described["timeout_s"], may_repeat)

    return Proxy(
        exact,
        [offer_read(own, described_method) for own, described_method in methods.items()],
        carry_out,
    )


def _sent(value: Any, kind: str = "") -> Any:
    """Return a value as JSON carries it: arrays as lists, bytes as base64, (4, 4) as a pose."""
    if isinstance(value, bytes | bytearray | memoryview):
        return base64.b64encode(value).decode("ascii")
    if isinstance(value, Mapping):
        return {name: _sent(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_sent(part) for part in value]
    if hasattr(value, "tolist"):
        if kind.startswith(_POSE) and getattr(value, "shape", ()) == (4, 4):
            from grasp.messages import pose_message

            return pose_message(value)
        return value.tolist()
    return value
