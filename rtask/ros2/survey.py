"""Survey of the graph of ROS 2, as a program for the Python that has rclpy.

``rtask ros2 doctor`` hands its text to that Python, which may be another than its own and need not
have RTASK: nothing but the standard library and rclpy is imported. It prints one object of JSON.
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

__all__ = ["survey"]

_NAME, _TOPIC = "rtask_doctor", "/rtask_doctor"
_CLOUD = "sensor_msgs/msg/PointCloud2"
_OURS = "/rtask/where_is"
_ANSWER_S, _HEARD_S = 5.0, 10.0


def survey(node: Any, spin: Callable[[float], None], wait_s: float) -> dict[str, Any]:
    """Return what a node sees of the others, and whether it hears itself.

    Parameters
    ----------
    node
        Node of its own for the survey.
    spin
        Serves the node for a while, s.
    wait_s
        Time for the discovery of others, s.
    """
    is_heard = _hears_itself(node, spin)
    spin(wait_s)
    names = sorted(set(node.get_node_names_and_namespaces()) - {(_NAME, node.get_namespace())})
    ours = [(name, space) for name, space in names if _offers(node, name, space)]
    return {
        "heard": is_heard,
        "nodes": [_full(*name) for name in names],
        "clocks": node.count_publishers("/clock"),
        "ours": [_about(node, spin, *name) for name in ours],
        "mismatches": list(_mismatches(node)),
    }


def _full(name: str, space: str) -> str:
    return f"{space.rstrip('/')}/{name}"


def _hears_itself(node: Any, spin: Callable[[float], None]) -> bool:
    from std_msgs.msg import String

    heard: list[Any] = []
    publisher = node.create_publisher(String, _TOPIC, 1)
    subscription = node.create_subscription(String, _TOPIC, heard.append, 1)
    deadline = time.monotonic() + _HEARD_S
    while not heard and time.monotonic() < deadline:
        publisher.publish(String(data="hello"))
        spin(0.1)
    node.destroy_subscription(subscription)
    node.destroy_publisher(publisher)
    return bool(heard)


def _offers(node: Any, name: str, space: str) -> bool:
    try:
        offered = node.get_service_names_and_types_by_node(name, space)
    except RuntimeError:  # it has just left
        return False
    return any(service.endswith(_OURS) for service, _ in offered)


def _about(node: Any, spin: Callable[[float], None], name: str, space: str) -> dict[str, Any]:
    """Return what one of RTASK's nodes says of itself, and who publishes views for it."""
    from lifecycle_msgs.srv import GetState
    from rcl_interfaces.srv import GetParameters

    full = _full(name, space)
    values = _ask(node, spin, f"{full}/get_parameters", GetParameters, names=["use_sim_time"])
    state = _ask(node, spin, f"{full}/get_state", GetState)
    heard = node.get_subscriber_names_and_types_by_node(name, space)
    return {
        "name": full,
        "services": [service for service, _ in node.get_service_names_and_types_by_node(name, space)
                     if "/rtask/" in service and "/_action/" not in service],
        "use_sim_time": values.values[0].bool_value if values is not None else None,
        "state": state.current_state.label if state is not None else None,
        "publishers": {
            topic: node.count_publishers(topic)
            for topic, kinds in heard
            if any(kind.startswith("sensor_msgs/") for kind in kinds)
        },
        "lossy": [
            {"topic": topic, "is_reliable": is_reliable}
            for topic, kinds in heard
            if _CLOUD in kinds
            for is_reliable in _lossy(node, full, topic)
        ],
    }  # fmt: skip


def _lossy(node: Any, name: str, topic: str) -> list[bool]:
    """Return whether the publishers of a topic are reliable; empty if the node hears it so."""
    from rclpy.qos import QoSReliabilityPolicy as Policy

    subscriptions = [
        each.qos_profile.reliability
        for each in node.get_subscriptions_info_by_topic(topic)
        if _full(each.node_name, each.node_namespace) == name
    ]
    publishers = [each.qos_profile.reliability for each in node.get_publishers_info_by_topic(topic)]
    if not publishers or not subscriptions or Policy.RELIABLE in subscriptions:
        return []
    return [all(policy == Policy.RELIABLE for policy in publishers)]


def _ask(node: Any, spin: Callable[[float], None], name: str, kind: Any, **fields: Any) -> Any:
    """Return the response of a service, or None if it does not come."""
    client = node.create_client(kind, name)
    try:
        if not client.wait_for_service(timeout_sec=_ANSWER_S):
            return None
        future = client.call_async(kind.Request(**fields))
        deadline = time.monotonic() + _ANSWER_S
        while not future.done() and time.monotonic() < deadline:
            spin(0.05)
        return future.result() if future.done() else None
    finally:
        node.destroy_client(client)


def _mismatches(node: Any) -> Iterable[dict[str, str]]:
    """Yield each publisher that a node subscribes to in vain, with the reason."""
    for topic, _ in node.get_topic_names_and_types():
        publishers = node.get_publishers_info_by_topic(topic)
        by_node: dict[str, list[Any]] = {}
        for subscription in node.get_subscriptions_info_by_topic(topic):
            subscriber = _full(subscription.node_name, subscription.node_namespace)
            by_node.setdefault(subscriber, []).append(subscription)
        for publisher in publishers:
            for subscriber, ends in by_node.items():
                reasons = [_reason(publisher, end) for end in ends]
                # A node may subscribe twice, so as to match both kinds of publishers.
                if all(reasons):
                    source = _full(publisher.node_name, publisher.node_namespace)
                    yield {"topic": topic, "publisher": source, "subscriber": subscriber,
                           "reason": reasons[0]}  # fmt: skip


def _reason(publisher: Any, subscription: Any) -> str:
    """Return why the one is not heard by the other; empty if it is."""
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    if publisher.topic_type != subscription.topic_type:
        return f"the types differ: {publisher.topic_type} and {subscription.topic_type}"
    hashes = [getattr(end, "topic_type_hash", None) for end in (publisher, subscription)]
    if all(hashes) and str(hashes[0]) != str(hashes[1]) and not any(map(_is_unset, hashes)):
        return f"{publisher.topic_type} was built from two definitions"
    state, reason = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
    return str(reason).strip("; ") if state == QoSCompatibility.ERROR else ""


def _is_unset(type_hash: Any) -> bool:
    """Whether a node did not say its hash, as those of other DDS programs do not."""
    return getattr(type_hash, "version", 1) < 1


def main() -> int:
    """Print the survey, or why there is none."""
    try:
        import rclpy
        from rclpy.utilities import get_rmw_implementation_identifier

        rmw = get_rmw_implementation_identifier()
    except Exception as error:  # noqa: BLE001 - libraries that do not load fail in many ways
        print(json.dumps({"error": f"{error}"}))  # noqa: T201
        return 0
    versions = []
    for name in ("rclpy", "ros-rclpy"):
        try:
            versions.append(importlib.metadata.version(name))
        except importlib.metadata.PackageNotFoundError:
            continue
    about = {"python": platform.python_version(), "rmw": rmw, "rclpy": max(versions, default="?")}
    rclpy.init(args=[])
    node = rclpy.create_node(_NAME)

    def spin(for_s: float) -> None:
        deadline = time.monotonic() + for_s
        while (left_s := deadline - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=left_s)

    try:
        print(json.dumps({**about, **survey(node, spin, float(sys.argv[1]))}))  # noqa: T201
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
