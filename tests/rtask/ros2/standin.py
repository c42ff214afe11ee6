"""A stand-in for what the node takes of rclpy, and for Python's messages of ROS 2.

It shows the node's own logic only, in one process and without a network: names, types, quality of
service and time are not checked here, but by ``tests/clients/ros2/contract.py`` with a real rclpy.
Its methods have the parameters of rclpy's, listed in ``rclpy_signatures.txt``.
"""

from __future__ import annotations

import queue
import threading
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rtask.interop.ros.convert import fill, make_message, members_of
from rtask.interop.ros.dds.types import RosTypes
from rtask.interop.ros.package import definitions_of, source_files
from rtask.interop.ros.schema import Schema

__all__ = ["World", "install"]

_STATUS = {"succeeded": 4, "canceled": 5, "aborted": 6}


class World:
    """What is on the network of the stand-in: services, publishers, actions by name.

    Parameters
    ----------
    schema
        Of the operations.
    """

    def __init__(self, schema: Schema) -> None:
        self.types = RosTypes(schema)
        goal, result, feedback = source_files(schema)["action/See.action"].split("---\n")
        for name, text in (("Goal", goal), ("Result", result), ("Feedback", feedback)):
            self.types.add_message(f"rtask_msgs/msg/See_{name}", text)
        sampling = source_files(schema)["action/SampleGraspPoses.action"].split("---\n")
        for name, text in zip(("Goal", "Result", "Feedback"), sampling, strict=True):
            self.types.add_message(f"rtask_msgs/msg/SampleGraspPoses_{name}", text)
        service = definitions_of("moveit_msgs")["srv/GetPlanningScene.srv"]
        self.types.add_service("moveit_msgs/srv/GetPlanningScene", service)
        self.planning_scene: Any = None
        """What a move_group answers; None where there is none."""
        self._add_trajectories()
        self.services: dict[str, tuple[Any, Callable[..., Any]]] = {}
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, list[Callable[[Any], None]]] = {}
        self.actions: dict[str, ActionServer] = {}
        self.others: dict[tuple[str, str], list[str]] = {}
        """Services of further nodes, by name and namespace."""
        self.parameters: dict[str, Any] = {"use_sim_time": False}
        self.log: list[str] = []

    def _add_trajectories(self) -> None:
        files = definitions_of("control_msgs")
        action = files.pop("action/FollowJointTrajectory.action").split("---\n")
        for path, text in files.items():
            self.types.add_message(f"control_msgs/{path.removesuffix('.msg')}", text)
        for name, text in zip(("Goal", "Result", "Feedback"), action, strict=True):
            self.types.add_message(f"control_msgs/msg/FollowJointTrajectory_{name}", text)

    def class_of(self, type_: str) -> type:
        """Return the class of a message, ``rtask_msgs/msg/SeeResult``."""
        return type(self.types.make(type_))

    def call(self, service: str, /, **fields: Any) -> Any:
        """Return the response of a service to a request with some fields."""
        kind, handle = self.services[service]
        request = fill(kind.Request(), fields, make_message)
        return handle(request, kind.Response())

    def publish(self, topic: str, message: Any) -> None:
        """Hand a message to everybody who subscribed."""
        for take in self.subscriptions[topic]:
            take(message)


@dataclass
class JumpThreshold:
    """Jumps of time that are told."""

    min_forward: Any
    min_backward: Any


class Publisher:
    """Holds what was published."""

    def __init__(self) -> None:
        self.messages: queue.Queue[Any] = queue.Queue()
        self.listeners = 0

    def publish(self, message: Any) -> None:
        self.messages.put(message)

    def get_subscription_count(self) -> int:
        return self.listeners


class Clock:
    """A clock that stands still, at 100 s of simulated time once it is set."""

    def __init__(self, *, clock_type: Any = None) -> None:
        self.nanoseconds = 0
        self.jumped: list[Callable[[Any], None]] = []

    def now(self) -> Any:
        return types.SimpleNamespace(nanoseconds=self.nanoseconds)

    def create_jump_callback(self, threshold: Any, *, post_callback: Any = None) -> Any:
        self.jumped.append(post_callback)
        return types.SimpleNamespace(unregister=lambda: self.jumped.remove(post_callback))


class GoalHandle:
    """A goal, what came back, and how it ended."""

    def __init__(self, server: ActionServer, request: Any) -> None:
        self.request = request
        self.is_cancel_requested = False
        self.status = ""
        self.feedback: list[Any] = []
        self.result: Any = None
        self.ended = threading.Event()
        self._server = server

    def execute(self, execute_callback: Any = None) -> None:
        def run() -> None:
            self.result = self._server.execute_callback(self)
            self.ended.set()

        threading.Thread(target=run, daemon=True).start()

    def publish_feedback(self, feedback: Any) -> None:
        self.feedback.append(feedback)

    def succeed(self) -> None:
        self.status = "succeeded"

    def abort(self) -> None:
        self.status = "aborted"

    def canceled(self) -> None:
        self.status = "canceled"


class ActionServer:
    """Carries out goals as rclpy does: each in a thread of its own."""

    def __init__(
        self, node: Any, action_type: Any, action_name: str, execute_callback: Any, *,
        callback_group: Any = None, goal_callback: Any = None, handle_accepted_callback: Any = None,
        cancel_callback: Any = None,
    ) -> None:  # fmt: skip
        self.execute_callback = execute_callback
        self._accepts, self._accepted = goal_callback, handle_accepted_callback
        self._world, self._name, self._kind = node.world, action_name, action_type
        self._world.actions[action_name] = self

    def send(self, **fields: Any) -> GoalHandle | None:
        """Send a goal; return its handle, or None where it was rejected."""
        goal = self._kind.Goal()
        for name, value in fields.items():
            setattr(goal, name, value)
        if self._accepts(goal) == "reject":
            return None
        handle = GoalHandle(self, goal)
        self._accepted(handle)
        return handle

    def destroy(self) -> None:
        del self._world.actions[self._name]


class Future:
    """The value of something that ends in another thread."""

    def __init__(self) -> None:
        self._value: Any = None
        self._is_done, self._calls = threading.Event(), list[Callable[[Future], Any]]()
        self._lock = threading.Lock()

    def set_result(self, result: Any) -> None:
        with self._lock:
            self._value = result
            self._is_done.set()
        for call in self._calls:
            call(self)

    def done(self) -> bool:
        return self._is_done.is_set()

    def result(self) -> Any:
        return self._value

    def add_done_callback(self, callback: Callable[[Future], Any]) -> None:
        with self._lock:
            if not self._is_done.is_set():
                self._calls.append(callback)
                return
        callback(self)


class ClientGoalHandle:
    """A goal as its client holds it."""

    def __init__(self, handle: GoalHandle | None) -> None:
        self.accepted, self._handle = handle is not None, handle

    def get_result_async(self) -> Future:
        handle, future = self._handle, Future()
        assert handle is not None

        def wait() -> None:
            handle.ended.wait()
            answer = types.SimpleNamespace(status=_STATUS[handle.status], result=handle.result)
            future.set_result(answer)

        threading.Thread(target=wait, daemon=True).start()
        return future

    def cancel_goal_async(self) -> Future:
        assert self._handle is not None
        self._handle.is_cancel_requested = True
        future = Future()
        future.set_result(None)
        return future


class ActionClient:
    """Sends goals to the action server of its name."""

    def __init__(self, node: Any, action_type: Any, action_name: str) -> None:
        self._world, self._name = node.world, action_name

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        return self._name in self._world.actions

    def send_goal_async(self, goal: Any, feedback_callback: Any = None) -> Future:
        server, future = self._world.actions[self._name], Future()
        fields = {name: getattr(goal, name) for name, _ in members_of(goal) or ()}
        future.set_result(ClientGoalHandle(server.send(**fields)))
        return future


class Client:
    """Asks for the planning scene of the stand-in's move_group."""

    def __init__(self, world: World, kind: Any, name: str) -> None:
        self.world, self._kind, self.srv_name = world, kind, name

    def service_is_ready(self) -> bool:
        return self.world.planning_scene is not None

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        return self.service_is_ready()

    def call_async(self, request: Any) -> Future:
        future, answer = Future(), self._kind.Response()
        answer.scene = self.world.planning_scene
        if answer.scene != "silent":
            future.set_result(answer)
        return future

    def remove_pending_request(self, future: Future) -> None:
        pass


def _node_of(world: World) -> type:
    class LifecycleNode:
        def __init__(self, node_name: str) -> None:
            self.world, self._name = world, node_name
            self.clock = Clock()
            self.timers: list[Callable[[], None]] = []

        def get_name(self) -> str:
            return self._name

        def get_namespace(self) -> str:
            return "/robot"

        def get_fully_qualified_name(self) -> str:
            return f"/robot/{self._name}"

        def get_clock(self) -> Clock:
            return self.clock

        def get_logger(self) -> Any:
            def log(words: str, **options: Any) -> None:
                world.log.append(words)

            return types.SimpleNamespace(error=log, warning=log, info=log)

        def declare_parameter(self, name: str, value: Any = None, descriptor: Any = None) -> None:
            world.parameters.setdefault(name, value)

        def get_parameter(self, name: str) -> Any:
            return types.SimpleNamespace(value=world.parameters[name])

        def create_lifecycle_publisher(self, kind: Any, topic: str, qos: Any) -> Publisher:
            return world.publishers.setdefault(topic, Publisher())

        def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any) -> Publisher:
            return world.publishers.setdefault(topic, Publisher())

        def create_service(
            self, srv_type: Any, srv_name: str, callback: Any, *, callback_group: Any = None
        ) -> str:
            world.services[srv_name] = (srv_type, callback)
            return srv_name

        def create_subscription(
            self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, *,
            callback_group: Any = None,
        ) -> tuple[str, Any]:  # fmt: skip
            world.subscriptions.setdefault(topic, []).append(callback)
            return topic, callback

        def create_client(
            self, srv_type: Any, srv_name: str, *, callback_group: Any = None
        ) -> Client:
            return Client(world, srv_type, srv_name)

        def destroy_client(self, client: Client) -> None:
            pass

        def create_timer(
            self, timer_period_sec: float, callback: Any, callback_group: Any = None,
            clock: Any = None,
        ) -> Any:  # fmt: skip
            self.timers.append(callback)
            return callback

        def destroy_timer(self, timer: Any) -> None:
            self.timers.remove(timer)

        def destroy_service(self, service: str) -> None:
            del world.services[service]

        def destroy_subscription(self, subscription: tuple[str, Any]) -> None:
            topic, callback = subscription
            world.subscriptions[topic].remove(callback)

        def destroy_lifecycle_publisher(self, publisher: Publisher) -> None:
            [topic] = [name for name, made in world.publishers.items() if made is publisher]
            del world.publishers[topic]

        def destroy_node(self) -> None:
            self.timers.clear()

        def count_publishers(self, topic_name: str) -> int:
            return 0

        def resolve_topic_name(self, topic: str) -> str:
            return topic.replace("~", f"/robot/{self._name}")

        def resolve_service_name(self, service: str) -> str:
            return f"/robot/{service}"

        def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
            return [(self._name, "/robot"), *world.others]

        def get_service_names_and_types_by_node(
            self, node_name: str, node_namespace: str
        ) -> list[tuple[str, list[str]]]:
            return [(name, []) for name in world.others.get((node_name, node_namespace), ())]

        def trigger_configure(self) -> str:
            return str(self.on_configure(None))

        def trigger_activate(self) -> str:
            return str(self.on_activate(None))

        def on_configure(self, state: Any) -> str:
            return "success"

        def on_activate(self, state: Any) -> str:
            return "success"

        def on_deactivate(self, state: Any) -> str:
            return "success"

    return LifecycleNode


def install(world: World, set_module: Callable[[str, Any], None]) -> None:
    """Put the stand-in in the place of rclpy and of the messages.

    Parameters
    ----------
    set_module
        Takes the name of a module and what is to be imported under it.
    """

    modules: dict[str, types.ModuleType] = {}

    def module(name: str, **members: Any) -> None:
        made = modules[name] = types.ModuleType(name)
        vars(made).update(members)
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(modules[parent], child, made)
        set_module(name, made)

    def enum(*names: str) -> Any:
        return types.SimpleNamespace(**{name: name.lower() for name in names})

    def record(**values: Any) -> Any:
        return types.SimpleNamespace(**values)

    module("rclpy", ok=lambda: True)
    answers = enum("ACCEPT", "REJECT")
    module(
        "rclpy.action", ActionClient=ActionClient, ActionServer=ActionServer,
        CancelResponse=answers, GoalResponse=answers,
    )  # fmt: skip
    module("rclpy.action.client", ClientGoalHandle=ClientGoalHandle)
    module("rclpy.client", Client=Client)
    module("rclpy.task", Future=Future)
    groups = ("MutuallyExclusiveCallbackGroup", "ReentrantCallbackGroup")
    module("rclpy.callback_groups", **dict.fromkeys(groups, record))
    module("rclpy.clock", Clock=Clock, ClockType=enum("STEADY_TIME"), JumpThreshold=JumpThreshold)
    module("rclpy.duration", Duration=record)
    module(
        "rclpy.lifecycle",
        LifecycleNode=_node_of(world),
        TransitionCallbackReturn=enum("SUCCESS", "FAILURE"),
    )
    module(
        "rclpy.qos",
        QoSProfile=record,
        QoSDurabilityPolicy=enum("VOLATILE", "TRANSIENT_LOCAL"),
        QoSReliabilityPolicy=enum("BEST_EFFORT", "RELIABLE"),
    )
    module("rcl_interfaces")
    module("rcl_interfaces.msg", ParameterDescriptor=record)
    packages: dict[str, dict[str, type]] = {}
    for name in list(world.types.store.fielddefs):
        package, kind, short = name.split("/")
        if kind == "msg" and package != "rcl_interfaces":
            packages.setdefault(package, {})[short] = world.class_of(name)
    for package, members in packages.items():
        module(package)
        module(f"{package}.msg", **members)
    half_of = "rtask_msgs/srv/{}_{}".format
    names = {
        name.removeprefix("rtask_msgs/srv/").removesuffix("_Request")
        for name in world.types.store.fielddefs
        if name.startswith("rtask_msgs/srv/") and name.endswith("_Request")
    }
    halves = ("Request", "Response")
    services = {
        name: type(name, (), {half: world.class_of(half_of(name, half)) for half in halves})
        for name in names
    }
    module("rtask_msgs.srv", **services)
    halves_of = {
        half: world.class_of(f"moveit_msgs/srv/GetPlanningScene_{half}") for half in halves
    }
    module("moveit_msgs.srv", GetPlanningScene=type("GetPlanningScene", (), halves_of))
    for package, actions in (
        ("rtask_msgs", ("See", "SampleGraspPoses")), ("control_msgs", ("FollowJointTrajectory",))
    ):  # fmt: skip
        made = {
            name: {
                part: world.class_of(f"{package}/msg/{name}_{part}")
                for part in ("Goal", "Result", "Feedback")
            }
            for name in actions
        }
        module(f"{package}.action", **{name: type(name, (), parts) for name, parts in made.items()})
