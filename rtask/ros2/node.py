"""The node of ROS 2: its parameters, its states, its endpoints and its clock."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.client.calling.client import HeldClient
from rtask.errors import RemoteUnavailableError, RtaskError, UsageError
from rtask.interop.ros.convert import fill, make_message
from rtask.interop.ros.looking import SeeOptions
from rtask.interop.ros.operations import OperationHandler, best_grasp
from rtask.interop.ros.schema import REFUSED
from rtask.interop.ros.world_markers import WORLD_TOPIC, WorldDisplay
from rtask.ros2.body import RobotBody
from rtask.ros2.camera import CameraTopics
from rtask.ros2.contract import Contract
from rtask.ros2.qos import events, latched
from rtask.ros2.sampling import SampleAction
from rtask.ros2.scene import SceneClient
from rtask.ros2.seeing import Eyes, SeeAction, SegmentService
from rtask.ros2.transforms import TransformBuffer

__all__ = ["GraphNode", "NodeOptions"]

_TICK_S, _DELIVER_TICKS = 0.2, 5
_CHANGES = "/rtask/changes"
PARAMETERS: dict[str, tuple[Any, str]] = {
    "url": ("", "address of the server; empty: RTASK_SERVER"),
    "frame": ("base_footprint", "frame with z up in which the answers are"),
    "gripper_id": ("", "name or IRI of the end effector, for goals that name none"),
    "table_height": (math.nan, "height of the table in that frame, m; NaN: as seen"),
    "min_confidence": (math.nan, "least confidence to count as recognised; NaN: by the policy"),
    "reliable_views": (False, "hear clouds and images reliably; best-effort cameras are not heard"),
    "use_planning_scene": (True, "keep grasps clear of what MoveIt's planning scene holds"),
    "hand_links": ([""], "links of the hand in MoveIt's scene, which may touch what it grasps"),
    "grasp_target": ("", "name or IRI of the object that grasps are sampled for; empty: the only"),
}
"""Default and meaning of each. The token is none: every node could read it."""


@dataclass(frozen=True)
class NodeOptions:
    """Options with which the node is started; they come before its parameters.

    Parameters
    ----------
    token
        Of the robot.
    timeout_s
        Longest wait for an answer of the server, s.
    outbox
        File that keeps what could not be sent.
    """

    name: str = "rtask_node"
    url: str = ""
    frame: str = ""
    gripper_id: str = ""
    token: str | None = None
    timeout_s: float = 30.0
    outbox: Path | None = None


class GraphNode:
    """A managed node (ROS 2, managed nodes): it connects when it is configured.

    Parameters
    ----------
    contract
        The operations it offers.
    """

    def __init__(self, options: NodeOptions, contract: Contract) -> None:
        from rcl_interfaces.msg import ParameterDescriptor
        from rclpy.clock import JumpThreshold
        from rclpy.duration import Duration

        self._options, self._contract = options, contract
        self._parts: _Parts | None = None
        self.is_active = False
        self.trouble = ""
        self._rival = ""
        self.node = _managed_node(options.name, self)
        for name, (default, words) in PARAMETERS.items():
            self.node.declare_parameter(name, default, ParameterDescriptor(description=words))
        node = self.node
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
        self._jumps = node.get_clock().create_jump_callback(back, post_callback=self._jumped)

    @property
    def full_name(self) -> str:
        """Name with its namespace."""
        return str(self.node.get_fully_qualified_name())

    @property
    def url(self) -> str:
        """Address of the server."""
        given = self._options.url or self.node.get_parameter("url").value
        url = str(given or os.environ.get("RTASK_SERVER", ""))
        if not url:
            raise UsageError("no server: give --server, the parameter url or RTASK_SERVER")
        return url

    def check_free(self, wait_s: float) -> None:
        """Make sure that no other node offers these services.

        Parameters
        ----------
        wait_s
            Time for the discovery of others, s.

        Raises
        ------
        UsageError
            Some are offered; callers would reach either node.
        """
        pause = threading.Event()
        # The graph has no event in rclpy for the arrival of a service.
        for _ in range(max(1, round(wait_s / 0.1))):
            self._refuse_rival(self.node.get_node_names_and_namespaces())
            pause.wait(0.1)

    def watch_for_rival(self) -> None:
        """Say once in the log that another node offers these services as well.

        It came later, or discovery was slow. Neither is ended: which of the two the robot's
        programs mean is for a person to say.
        """
        others = list(self.node.get_node_names_and_namespaces())
        # One of this name is this node; a further one was started with the same name.
        me = (self.node.get_name(), self.node.get_namespace())
        if me in others:
            others.remove(me)
        try:
            self._refuse_rival(others)
        except UsageError as error:
            if str(error) != self._rival:
                self._rival = str(error)
                self.node.get_logger().error(f"{error}; calls reach either")
        else:
            self._rival = ""

    def _refuse_rival(self, others: Iterable[tuple[str, str]]) -> None:
        service = self.node.resolve_service_name("rtask/where_is")
        for name, namespace in others:
            try:
                # The list of all services has those that somebody only wants to call, too.
                offered = self.node.get_service_names_and_types_by_node(name, namespace)
            except RuntimeError:  # it has just left
                continue
            if service in (name for name, _ in offered):
                owner = f"{namespace.rstrip('/')}/{name}"
                raise UsageError(
                    f"service {service} is offered by another node, {owner}; end it, or start this "
                    "one in a namespace: --ros-args -r __ns:=/robot"
                )

    def wait_for_clock(self, wait_s: float) -> None:
        """Wait for the first time on ``/clock``, if time is simulated.

        Raises
        ------
        RemoteUnavailableError
            Nobody published it within that time.
        """
        if not self.node.get_parameter("use_sim_time").value:
            return
        pause = threading.Event()
        for _ in range(max(1, round(wait_s / 0.05))):
            if self.node.get_clock().now().nanoseconds:
                return
            pause.wait(0.05)
        raise RemoteUnavailableError(
            f"use_sim_time is set and nobody published /clock within {wait_s:g} s; start the "
            f"simulator, or `ros2 param set {self.full_name} use_sim_time false`"
        )

    def close(self) -> None:
        """Leave ROS; what was not sent stays in the outbox."""
        self.clean_up()
        self._jumps.unregister()
        self.node.destroy_node()

    def configure(self) -> bool:
        """Connect and make the endpoints; return whether it could."""
        self.trouble = ""
        try:
            self._parts = _Parts(self)
        except RtaskError as error:
            self.trouble = str(error)
        except Exception as error:  # noqa: BLE001 - rclpy would drop it without a word
            self.trouble = f"{error!r}"
        if self.trouble:
            self.node.get_logger().error(self.trouble)
        return not self.trouble

    def clean_up(self) -> None:
        """Take the endpoints back."""
        self.is_active = False
        self._end_parts()

    def _end_parts(self) -> None:
        if self._parts is not None:
            self._parts.end()
            self._parts = None

    def _jumped(self, jump: Any) -> None:
        if self._parts is not None and jump.delta.nanoseconds < 0:
            self._parts.forget()
            self.node.get_logger().warning("the time jumped back: views and transforms are gone")

    def see_options(self) -> SeeOptions:
        """Return the values for what a goal leaves out."""

        def number(name: str) -> float | None:
            value = float(self.node.get_parameter(name).value)
            return None if math.isnan(value) else value

        options = self._options
        return SeeOptions(
            options.frame or str(self.node.get_parameter("frame").value),
            options.gripper_id or str(self.node.get_parameter("gripper_id").value),
            number("table_height"),
            number("min_confidence"),
        )

    def open_client(self) -> HeldClient:
        """Return a new client of the server."""
        options = self._options
        return HeldClient(
            self.url, options.token, options.timeout_s, self._contract.rules, options.outbox
        )

    @property
    def contract(self) -> Contract:
        """The operations that it offers."""
        return self._contract


def _managed_node(name: str, owner: GraphNode) -> Any:
    """Return a node whose transitions are its owner's; rclpy takes them from a subclass only."""
    from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

    class ManagedNode(LifecycleNode):  # type: ignore[misc]
        def on_configure(self, state: Any) -> Any:
            done = owner.configure()
            return TransitionCallbackReturn.SUCCESS if done else TransitionCallbackReturn.FAILURE

        def on_activate(self, state: Any) -> Any:
            owner.is_active = True
            return super().on_activate(state)

        def on_deactivate(self, state: Any) -> Any:
            owner.is_active = False
            return super().on_deactivate(state)

        def on_cleanup(self, state: Any) -> Any:
            owner.clean_up()
            return TransitionCallbackReturn.SUCCESS

        def on_shutdown(self, state: Any) -> Any:
            owner.clean_up()
            return TransitionCallbackReturn.SUCCESS

    return ManagedNode(name)


class _Parts:
    """The connection and the endpoints of a configured node."""

    def __init__(self, owner: GraphNode) -> None:
        from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
        from rclpy.clock import Clock, ClockType
        from tf2_msgs.msg import TFMessage

        self._owner, node = owner, owner.node
        self._node = node
        self.client = owner.open_client()
        calls, sensors = ReentrantCallbackGroup(), MutuallyExclusiveCallbackGroup()
        poses = MutuallyExclusiveCallbackGroup()  # not behind clouds, which wait for them
        self._grasps = node.create_lifecycle_publisher(
            type(make_message("moveit_msgs/Grasp")), "rtask/grasps", latched()
        )
        self._changes = node.create_lifecycle_publisher(
            type(make_message("rtask_msgs/Change")), "rtask/changes", events(100)
        )
        self._markers = node.create_lifecycle_publisher(
            type(make_message("visualization_msgs/MarkerArray")), WORLD_TOPIC, latched()
        )
        self._world = WorldDisplay(
            lambda: self.client.call("show_world"),
            self._markers.publish,
            lambda: self._is_active() and self._markers.get_subscription_count() > 0,
            make_message,
        )
        schema = owner.contract.schema
        self._handler = OperationHandler(schema, self.client, make_message, self._heard)
        self._services = [
            self._serve(name, service.name, calls) for name, service in schema.services.items()
        ]
        self._transforms = TransformBuffer()
        options = owner.see_options()
        self._camera = CameraTopics(node, sensors, bool(node.get_parameter("reliable_views").value))
        self._subscriptions = [
            *self._camera.subscriptions,
            node.create_subscription(
                TFMessage, "/tf", self._transforms.take, events(100), callback_group=poses
            ),
            node.create_subscription(
                TFMessage,
                "/tf_static",
                lambda message: self._transforms.take(message, is_static=True),
                latched(100),
                callback_group=poses,
            ),
        ]
        body = RobotBody(node, poses)
        self._subscriptions.append(body.subscription)
        eyes = Eyes(self._camera, self._transforms, self.client, options.frame, body)
        self._services.append(SegmentService(node, eyes, calls, self._is_active).service)
        self._scene = self._scene_client(calls)
        self._see = SeeAction(
            node, eyes, self.client, options, self._heard, calls, self._is_active,
            self._scene.source if self._scene is not None else None,
        )  # fmt: skip
        self._sample = SampleAction(node, self._see, calls, self._is_active)
        self._ticks, self._follows = 0, False
        # ROS time may stand still; what waits is sent all the same.
        self._timer = node.create_timer(
            _TICK_S, self._tick, callback_group=MutuallyExclusiveCallbackGroup(),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )  # fmt: skip

    def forget(self) -> None:
        """Forget what belongs to another time."""
        self._transforms.clear()
        self._camera.forget()

    def end(self) -> None:
        """Take all endpoints back and close the connection."""
        node = self._node
        node.destroy_timer(self._timer)
        for server in (self._see.server, *self._sample.servers):
            server.destroy()
        if self._scene is not None:
            node.destroy_client(self._scene.client)
            node.destroy_subscription(self._scene.subscription)
        for service in self._services:
            node.destroy_service(service)
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        for publisher in (self._grasps, self._changes, self._markers, *self._see.publishers):
            node.destroy_lifecycle_publisher(publisher)
        self.client.close()

    def _scene_client(self, group: Any) -> SceneClient | None:
        node = self._node
        if not node.get_parameter("use_planning_scene").value:
            return None
        links = tuple(str(link) for link in node.get_parameter("hand_links").value if link)
        return SceneClient(node, group, links)

    def _is_active(self) -> bool:
        return self._owner.is_active

    def _serve(self, operation: str, type_: str, group: Any) -> Any:
        import rtask_msgs.srv

        kind = getattr(rtask_msgs.srv, type_)

        def handle(request: Any, response: Any) -> Any:
            if not self._is_active():
                setattr(response, REFUSED, "the node is not active")
                return response
            return self._handler.answer_or_refuse(operation, request, kind.Response)

        return self._node.create_service(
            kind, f"rtask/{operation}", self._guarded(handle, kind), callback_group=group
        )

    def _guarded(self, handle: Callable[[Any, Any], Any], kind: Any) -> Callable[[Any, Any], Any]:
        """Return a handler whose unexpected errors are answers, for rclpy would end the node."""

        def guarded(request: Any, response: Any) -> Any:
            try:
                return handle(request, response)
            except Exception as error:  # noqa: BLE001 - one request must not end the node
                self._node.get_logger().error(f"{kind.__name__}: {error!r}")
                failed = kind.Response()
                setattr(failed, REFUSED, f"an unexpected error: {error!r:.200}")
                return failed

        return guarded

    def _heard(self, operation: str, answer: Mapping[str, Any]) -> None:
        grasp = best_grasp(operation, answer, make_message)
        if grasp is not None:
            self._grasps.publish(grasp)

    def _tick(self) -> None:
        """Follow the commits while somebody subscribes; once a second send what waits."""
        is_heard = self._is_active() and self._changes.get_subscription_count() > 0
        if is_heard and not self._follows:
            self.client.subscribe(_CHANGES, self._change)
        if self._follows and not is_heard:
            self.client.unsubscribe(_CHANGES)
        self._follows = is_heard
        self._ticks += 1
        if self._ticks % _DELIVER_TICKS == 0:
            self._world.refresh()
        if self._ticks % _DELIVER_TICKS == 0 and self.client.waiting:
            try:
                self.client.deliver()
            except RtaskError as error:
                self._node.get_logger().warning(
                    f"{self.client.waiting} calls wait in the outbox: {error}",
                    throttle_duration_sec=60.0,
                )

    def _change(self, message: Mapping[str, Any]) -> None:
        self._changes.publish(fill(make_message("rtask_msgs/Change"), message, make_message))
