"""The change feed of the graph as a ROS topic."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from rtask.errors import RtaskError
from rtask.interop.ros.convert import Make, make_message

__all__ = ["ChangeTopic", "Commit", "change_message"]

log = logging.getLogger(__name__)


class Commit(Protocol):
    """The part of a followed change that is published on the topic."""

    @property
    def seq(self) -> int: ...
    @property
    def agent(self) -> str: ...
    @property
    def added(self) -> tuple[tuple[str, str, str, str], ...]: ...
    @property
    def removed(self) -> tuple[tuple[str, str, str, str], ...]: ...
    @property
    def inferred_added(self) -> tuple[tuple[str, str, str, str], ...]: ...


class ChangeTopic:
    """Topic ``rtask/changes``: one message for each commit, while somebody subscribes.

    Parameters
    ----------
    follow
        Returns the commits from now on, over as many connections as it takes.
    """

    def __init__(self, follow: Callable[[], Iterator[Commit]]) -> None:
        import rospy

        self._follow = follow
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        listener = rospy.SubscribeListener()
        listener.peer_subscribe = self._has_listeners
        kind = type(make_message("rtask_msgs/Change"))
        self._topic = rospy.Publisher(
            "rtask/changes", kind, subscriber_listener=listener, queue_size=100
        )

    def _has_listeners(self, *unused: Any) -> None:
        """Start to follow the graph with the first subscriber."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()

    def _run(self) -> None:
        try:
            for commit in self._follow():
                # The next subscriber starts again.
                if self._topic.get_num_connections() == 0:
                    break
                self._topic.publish(change_message(commit, make_message))
        except RtaskError as error:
            log.error("rtask/changes: %s; subscribe again", error)
        finally:
            with self._lock:
                self._thread = None


def change_message(commit: Commit, make: Make) -> Any:
    """Return the message of a commit, ``rtask_msgs/Change``."""
    message = make("rtask_msgs/Change")
    graphs = {row[3].strip("<>") for row in (*commit.added, *commit.removed)}
    message.commit, message.agent, message.graphs = commit.seq, commit.agent, sorted(graphs)
    message.added, message.removed = len(commit.added), len(commit.removed)
    message.derived = len(commit.inferred_added)
    return message
