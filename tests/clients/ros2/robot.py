"""A node of a robot, which calls the node under test."""

from __future__ import annotations

import contextlib
import queue
import re
import threading

from tests.clients.ros2.programs import NAMESPACE, WAIT_S, Shell


class Robot:
    """A node of a robot: publishes views and transforms, calls the node under test."""

    def __init__(self):
        import rclpy
        from rclpy.executors import MultiThreadedExecutor
        from rclpy.node import Node

        rclpy.init()
        self.node = Node("contract_robot")
        self.executor = MultiThreadedExecutor(num_threads=4)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()
        self.clients, self.topics, self.publishers = {}, {}, {}

    def _spin(self):
        with contextlib.suppress(Exception):  # the end of the context ends it
            self.executor.spin()

    def close(self):
        import rclpy

        self.executor.shutdown(timeout_sec=5)
        self.node.destroy_node()
        rclpy.try_shutdown()

    def call(self, name, kind, fill=lambda request: None, namespace=NAMESPACE, wait_s=WAIT_S):
        """Call a service and return its response."""
        key = (name, namespace)
        if key not in self.clients:
            full = name if name.startswith("/") else f"{namespace}/{name}"
            self.clients[key] = self.node.create_client(kind, full)
        client = self.clients[key]
        assert client.wait_for_service(timeout_sec=WAIT_S), f"nobody offers {key}"
        request = kind.Request()
        fill(request)
        return self.wait(client.call_async(request), wait_s, name)

    @staticmethod
    def wait(future, wait_s, words):
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(wait_s), f"no answer within {wait_s:g} s: {words}"
        return future.result()

    def operation(self, operation, /, **fields):
        """Call an operation with the fields of its request."""
        return self.operation_in(NAMESPACE, operation, **fields)

    def operation_in(self, namespace, operation, /, **fields):
        """Call an operation of the node in another namespace."""
        import rtask_msgs.srv

        kind = getattr(rtask_msgs.srv, "".join(part.capitalize() for part in operation.split("_")))
        return self.call(
            f"rtask/{operation}", kind, lambda request: set_fields(request, fields), namespace
        )

    def forget_publishers(self, topic):
        """Take the publishers of a topic back, so that another of other quality may follow."""
        for key in [key for key in self.publishers if key[0] == topic]:
            self.node.destroy_publisher(self.publishers.pop(key))

    def hear(self, topic, kind, qos):
        """Return a queue of the messages of a topic from now on."""
        heard = queue.Queue()
        self.topics[topic, id(heard)] = self.node.create_subscription(kind, topic, heard.put, qos)
        return heard

    def publish(self, topic, message, qos):
        key = (topic, type(message))
        if key not in self.publishers:
            self.publishers[key] = self.node.create_publisher(type(message), topic, qos)
        Shell.wait_for(
            lambda: self.publishers[key].get_subscription_count() > 0, f"a subscriber of {topic}"
        )
        self.publishers[key].publish(message)

    def see_again(self, **fields):
        """Send a goal again while a view or its transform was lost: best effort may lose them."""
        for _ in range(5):
            status, result, numbers = self.see(**fields)
            if not re.search("no transform|within 5 s", result.refused):
                break
        return status, result, numbers

    def see(self, cancel_at=0, settle=None, namespace=NAMESPACE, **fields):
        """Send a goal; return its status, its result and the numbers in its feedback."""
        from rclpy.action import ActionClient
        from rtask_msgs.action import See

        client = ActionClient(self.node, See, f"{namespace}/rtask/see")
        assert client.wait_for_server(timeout_sec=WAIT_S), "nobody offers rtask/see"
        goal, numbers, cancelled = See.Goal(), [], threading.Event()
        set_fields(goal, fields)
        handles = queue.Queue()

        def feedback(message):
            numbers.append(message.feedback.number)
            if message.feedback.number == cancel_at:
                handles.get(timeout=WAIT_S).cancel_goal_async()
                cancelled.set()

        handle = self.wait(client.send_goal_async(goal, feedback), WAIT_S, "the goal")
        assert handle.accepted, "the goal was rejected"
        handles.put(handle)
        if settle is not None:
            settle(handle)
        answer = self.wait(handle.get_result_async(), 90.0, "the result")
        client.destroy()
        return answer.status, answer.result, numbers


def set_fields(message, fields):
    """Set fields of a message from plain values; lists of dictionaries become messages."""
    import importlib

    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        base = re.sub(r"^sequence<([^,>]+).*", r"\1", types[name])
        if isinstance(value, dict):
            set_fields(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            package, _, kind = base.partition("/")
            made = getattr(importlib.import_module(f"{package}.msg"), kind)
            setattr(message, name, [set_fields(made(), part) for part in value])
        elif isinstance(value, bytes):
            setattr(message, name, list(value))
        else:
            setattr(message, name, value)
    return message


def sensor(reliable=False):
    from rclpy.qos import QoSProfile, QoSReliabilityPolicy

    policy = QoSReliabilityPolicy
    return QoSProfile(depth=5, reliability=policy.RELIABLE if reliable else policy.BEST_EFFORT)


def latched():
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    return QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
