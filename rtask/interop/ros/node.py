"""The node: its start, its registrations, its clock and its end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.master import Master, Watch

__all__ = ["NodeOptions", "RosNode"]

log = logging.getLogger(__name__)

_START_S = 10.0


@dataclass(frozen=True)
class NodeOptions:
    """Options with which the node is started.

    Parameters
    ----------
    name
        Of the node.
    remaps
        Arguments of ROS: ``a:=b``, ``__ns:=/robot``, ``_param:=value``.
    wait_s
        Longest wait for the master and for the first time on ``/clock``, s of the wall clock.
    publishes_clock
        Whether this node is the one that publishes ``/clock``, and so must not wait for it.
    """

    name: str = "rtask_node"
    remaps: Sequence[str] = field(default_factory=tuple)
    wait_s: float = 10.0
    publishes_clock: bool = False


class RosNode:
    """A registered node.

    Parameters
    ----------
    options
        Name, remaps, time limits.
    services
        Relative names of the services it will offer, which must be free.

    Raises
    ------
    RemoteUnavailableError
        No master, or nobody publishes the clock.
    UsageError
        The name of the node or of a service is taken, or a remap is no remap.
    """

    def __init__(self, options: NodeOptions, services: Sequence[str] = ()) -> None:
        import rospy

        for remap in options.remaps:
            if ":=" not in remap:
                raise UsageError(f"{remap!r} is no remap of ROS; expected name:=value")
        self.ended = threading.Event()
        self.reason = ""
        self._every: list[Callable[[], None]] = []
        self._master = Master()
        self._master.wait(options.wait_s, self.ended)
        namespace, name = _names(options)
        self.name = f"{namespace}{name}"
        if self.name == "/rtask":
            raise UsageError("a node called /rtask would mix its services with the operations'")
        self._master.check_free(self.name, [_resolved(namespace, s, options) for s in services])
        self._start(name, list(options.remaps))
        rospy.core.add_preshutdown_hook(self._on_shutdown_request)
        if not options.publishes_clock:
            self._wait_for_clock(options.wait_s)
        self._watch = Watch(self._master, self.name, self._register_again, self._each_second)
        self._watch.start()

    def each_second(self, action: Callable[[], None]) -> None:
        """Register a function that is called about once a second."""
        self._every.append(action)

    def spin(self) -> str:
        """Wait for the end and return its reason; empty if :meth:`end` was called."""
        # A wait without end could not be interrupted by a signal on every system.
        while not self.ended.wait(0.5):
            pass
        return self.reason

    def end(self) -> None:
        """Leave the master and end."""
        import rospy

        self.ended.set()
        self._watch.end()
        rospy.signal_shutdown("ended")

    def _on_shutdown_request(self, reason: str) -> None:
        """Take note that rospy ends, and why: another node took the name, for one."""
        if not self.ended.is_set():
            self.reason = str(reason)
        self.ended.set()

    def _start(self, name: str, remaps: list[str]) -> None:
        """Call init_node, which has no time limit of its own."""
        import rospy

        failed: list[BaseException] = []

        def start() -> None:
            try:
                rospy.init_node(name, argv=["rtask", *remaps], disable_signals=True)
            except (rospy.ROSException, ValueError, OSError) as error:
                failed.append(error)

        thread = threading.Thread(target=start, daemon=True, name="rtask-init-node")
        thread.start()
        thread.join(_START_S)
        if thread.is_alive():
            raise RemoteUnavailableError(
                f"the ROS master at {self._master.uri} stopped answering while the node started"
            )
        if failed:
            raise UsageError(f"the node could not start: {failed[0]}") from failed[0]

    def _wait_for_clock(self, wait_s: float) -> None:
        import rospy

        if not rospy.get_param("/use_sim_time", False):
            return
        deadline = time.monotonic() + wait_s
        # rospy has no event for the first message on /clock.
        while rospy.Time.now().is_zero():
            if time.monotonic() >= deadline:
                rospy.signal_shutdown("no clock")
                raise RemoteUnavailableError(
                    f"/use_sim_time is set and nobody published /clock within {wait_s:g} s; start "
                    "the simulator, or `rosparam set use_sim_time false`"
                )
            time.sleep(0.05)

    def _each_second(self) -> None:
        for action in self._every:
            action()

    def _register_again(self) -> None:
        """Tell the master of all publishers, subscribers and services of this process."""
        from rospy.impl import registration as impl

        listeners = impl.get_registration_listeners()
        kinds = (
            (impl.get_topic_manager().get_publications(), impl.Registration.PUB),
            (impl.get_topic_manager().get_subscriptions(), impl.Registration.SUB),
            (impl.get_service_manager().get_services(), impl.Registration.SRV),
        )
        for listed, kind in kinds:
            for name, type_or_uri in listed:
                listeners.notify_added(name, type_or_uri, kind)


def _names(options: NodeOptions) -> tuple[str, str]:
    """Return the namespace, ending in a slash, and the name of the node as ROS will have them."""
    import rosgraph.names

    namespace: str = rosgraph.names.get_ros_namespace(argv=list(options.remaps))
    given = [remap.partition(":=")[2] for remap in options.remaps if remap.startswith("__name:=")]
    return namespace, given[-1] if given else options.name


def _resolved(namespace: str, name: str, options: NodeOptions) -> str:
    """Return the full name of a service after remapping."""
    import rosgraph.names

    mappings = {
        rosgraph.names.resolve_name(key, f"{namespace}node"): value
        for key, value in rosgraph.names.load_mappings(list(options.remaps)).items()
        if not key.startswith("_")
    }
    full = rosgraph.names.resolve_name(name, f"{namespace}node")
    return str(rosgraph.names.resolve_name(mappings.get(full, full), f"{namespace}node"))
