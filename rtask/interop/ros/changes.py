"""The change feed of the graph as a ROS topic."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from rtask.errors import EpochChangedError, GoneError, RemoteUnavailableError, RtaskError
from rtask.interop.ros.convert import Make, make_message

__all__ = ["ChangeTopic", "Commit", "Follow", "change_message", "commits_of"]

log = logging.getLogger(__name__)

_PAUSE_S = 1.0


class Commit(Protocol):
    """The part of a followed change that is published on the topic."""

    @property
    def version(self) -> str: ...
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


class Follow(Protocol):
    """Yields the commits since a version, or from now on; the ``follow`` of a client."""

    def __call__(self, *, since: str | None = None) -> Iterator[Commit]: ...


def commits_of(follow: Follow, may_go_on: Callable[[], bool]) -> Iterator[Commit]:
    """Yield the commits of a server from now on, however long it is away in between.

    After a server was away it goes on with the commit after the last one that was yielded; where
    the server no longer has those in between, with the next.

    Parameters
    ----------
    may_go_on
        Asked a moment after each time that the server went away.

    Raises
    ------
    RtaskError
        The server refuses, such as a token that is no longer valid.
    """
    version = None
    while True:
        try:
            for commit in follow(since=version):
                version = commit.version
                yield commit
        except RemoteUnavailableError as error:
            log.warning("rtask/changes: %s; the node goes on when it is back", error)
        except (GoneError, EpochChangedError) as error:
            version = str(error.details["version"])
            log.warning("rtask/changes: %s; commits in between are no messages", error)
        time.sleep(_PAUSE_S)  # a server that ends each connection at once is not asked all the time
        if not may_go_on():
            return


class ChangeTopic:
    """Topic ``rtask/changes``: one message for each commit, while somebody subscribes.

    Parameters
    ----------
    follow
        Returns the commits from now on, over as many connections as it takes.
    """

    def __init__(self, follow: Follow) -> None:
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
            for commit in commits_of(self._follow, self._is_heard):
                # The next subscriber starts again.
                if not self._is_heard():
                    break
                self._topic.publish(change_message(commit, make_message))
        except RtaskError as error:
            log.error("rtask/changes: %s; subscribe again", error)
        finally:
            with self._lock:
                self._thread = None

    def _is_heard(self) -> bool:
        return bool(self._topic.get_num_connections())


def change_message(commit: Commit, make: Make) -> Any:
    """Return the message of a commit, ``rtask_msgs/Change``."""
    message = make("rtask_msgs/Change")
    graphs = {row[3].strip("<>") for row in (*commit.added, *commit.removed)}
    message.commit, message.agent, message.graphs = commit.seq, commit.agent, sorted(graphs)
    message.added, message.removed = len(commit.added), len(commit.removed)
    message.derived = len(commit.inferred_added)
    return message
