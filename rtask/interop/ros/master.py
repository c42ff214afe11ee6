"""The ROS master: asking it without hanging, and registering again when it came back.

A master that returns knows nothing of the nodes that were there before, and rospy does not tell
it.
"""

from __future__ import annotations

import http.client
import logging
import os
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Collection
from typing import Any
from urllib.parse import urlsplit
from xml.parsers.expat import ExpatError

from rtask.errors import RemoteUnavailableError, RtaskError, UsageError

__all__ = ["Master", "Watch"]

log = logging.getLogger(__name__)

_ANSWER_S = 2.0
_POLL_S = 1.0
_NO_ANSWER = (OSError, xmlrpc.client.Error, http.client.HTTPException, ExpatError)


class _Timed(xmlrpc.client.Transport):
    """Transport whose connections have a time limit; the standard one has none."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        made = super().make_connection(host)
        made.timeout = _ANSWER_S
        return made


def _answers(uri: str) -> bool:
    """Tell whether a node answers at an address."""
    try:
        with _proxy(uri) as node:
            node.getPid("/rtask_ping")
    except _NO_ANSWER:
        return False
    return True


def _proxy(uri: str) -> Any:
    return xmlrpc.client.ServerProxy(uri, transport=_Timed())


class Master:
    """The master that ``ROS_MASTER_URI`` names (ROS Master API).

    Parameters
    ----------
    uri
        None = as the environment says.
    caller
        Name under which to ask.

    Raises
    ------
    UsageError
        The address is none.
    """

    def __init__(self, uri: str | None = None, caller: str = "/rtask") -> None:
        self.uri = uri or os.environ.get("ROS_MASTER_URI") or "http://localhost:11311"
        self._caller = caller
        parts = urlsplit(self.uri)
        if parts.scheme != "http" or not parts.hostname or not parts.port:
            raise UsageError(f"ROS_MASTER_URI={self.uri!r}: expected http://host:port")

    def ask(self, method: str, *args: Any) -> Any:
        """Call a method of the master and return its value.

        Raises
        ------
        RemoteUnavailableError
            Nobody answers, or what answers is no master.
        UsageError
            The master refused.
        """
        try:
            with _proxy(self.uri) as master:
                code, words, value = getattr(master, method)(self._caller, *args)
        except (*_NO_ANSWER, ValueError, TypeError) as error:
            raise RemoteUnavailableError(
                f"no ROS master answers at {self.uri} ({error}); start roscore, or set "
                "ROS_MASTER_URI"
            ) from error
        if code != 1:
            raise UsageError(f"the ROS master at {self.uri}: {method}: {words}")
        return value

    def wait(self, wait_s: float, ended: threading.Event) -> None:
        """Wait until the master answers.

        Raises
        ------
        RemoteUnavailableError
            It did not within that time.
        """
        deadline = time.monotonic() + wait_s
        while True:
            try:
                self.ask("getPid")
            except RemoteUnavailableError as error:
                if time.monotonic() >= deadline:
                    raise RemoteUnavailableError(f"{error}; waited {wait_s:g} s") from error
            else:
                return
            if ended.wait(0.2):
                raise RemoteUnavailableError("interrupted while waiting for the ROS master")

    def check_free(self, node: str, services: Collection[str]) -> None:
        """Make sure that no living node has a node's name or offers its services.

        Raises
        ------
        UsageError
            One does; ROS would end it, or take the service from it, without a word.
        """
        owner_of: dict[str, str] = {}
        for service, owners in self.ask("getSystemState")[2]:
            for owner in owners:
                if service in services and owner != node:
                    owner_of[owner] = service
        for owner, service in owner_of.items():
            uri = self._node_uri(owner)
            if uri and _answers(uri):
                raise UsageError(
                    f"service {service} is offered by {owner} at {uri}; end that node, or start "
                    "this one in a namespace: __ns:=/robot"
                )
        uri = self._node_uri(node)
        if uri and _answers(uri):
            raise UsageError(
                f"a node {node} runs already, at {uri}; end it, or choose another --name"
            )

    def _node_uri(self, node: str) -> str:
        try:
            return str(self.ask("lookupNode", node))
        except UsageError:
            return ""

    def knows(self, node: str) -> bool:
        """Tell whether a node is registered with all three kinds of names it may have."""
        publishers, subscribers, services = self.ask("getSystemState")
        return any(
            node in nodes for kind in (publishers, subscribers, services) for _, nodes in kind
        )


class Watch(threading.Thread):
    """Registers a node again when the master has come back without knowing it.

    Parameters
    ----------
    register
        Registers everything again.
    every
        Called once in each round, such as for what waits to be sent.
    """

    def __init__(
        self, master: Master, node: str, register: Callable[[], None], every: Callable[[], None]
    ) -> None:
        super().__init__(name="rtask-master-watch", daemon=True)
        self._master, self._node = master, node
        self._register, self._every = register, every
        self._ended = threading.Event()
        self.is_online = True

    def end(self) -> None:
        """End the thread."""
        self._ended.set()

    def run(self) -> None:
        """Check the master every second."""
        run_id = self._run_id()
        while not self._ended.wait(_POLL_S):
            try:
                self._every()
            except RtaskError as error:  # the next round tries again
                log.warning("%s", error)
            now = self._run_id()
            if now is None:
                if self.is_online:
                    log.warning("the ROS master at %s is gone; waiting for it", self._master.uri)
                self.is_online = False
                continue
            try:
                if now != run_id or not self._master.knows(self._node):
                    self._register()
                    log.warning("registered again with the ROS master at %s", self._master.uri)
                run_id, self.is_online = now, True
            except (RemoteUnavailableError, UsageError, OSError) as error:
                log.warning("registering again: %s", error)

    def _run_id(self) -> str | None:
        try:
            return str(self._master.ask("getParam", "/run_id"))
        except UsageError:
            return ""  # a bare rosmaster has none
        except RemoteUnavailableError:
            return None


def hears_itself(wait_s: float) -> bool:
    """Tell whether a node of this process hears what it publishes, over a socket as others do."""
    import rospy
    from std_msgs.msg import String

    rospy.init_node("rtask_doctor", anonymous=True, argv=["rtask"], disable_signals=True)
    heard = threading.Event()
    subscriber = rospy.Subscriber("~heard", String, lambda message: heard.set())
    publisher = rospy.Publisher("~heard", String, queue_size=1, latch=True)
    try:
        publisher.publish("heard")
        return heard.wait(wait_s)
    finally:
        subscriber.unregister()
        rospy.signal_shutdown("looked")
