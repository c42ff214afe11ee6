"""Topics, published by robots and the server and delivered to every subscriber."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from endpoint.rosbridge.calls import Deadlines
from endpoint.rosbridge.messages import encode
from rtask.errors import UsageError

RESERVED = ("/rtask/", "/rosapi/", "/services/")
MAX_SUBSCRIPTIONS = 500
MAX_TOPICS_PER_SESSION = 200
MAX_LATCHED = 1_000
MAX_LATCHED_BYTES = 1 << 20
MAX_HELD = 1_000

Deliver = Callable[[str, str], None]


@dataclass
class Subscriber:
    """One session's subscription to a topic; it gets one copy of each message.

    Parameters
    ----------
    deliver
        Receives the text of a message and its topic.
    throttles_ms
        Requested pause between messages in ms, by subscription id; the shortest applies.
    queues
        Requested queue length while throttled, by subscription id; the longest applies, and the
        newest message is always kept.
    last_sent
        Time of the last message, on the monotonic clock.
    held
        Messages held until the pause ends.
    """

    deliver: Deliver
    throttles_ms: dict[Any, float] = field(default_factory=dict)
    queues: dict[Any, int] = field(default_factory=dict)
    last_sent: float = float("-inf")
    held: deque[str] = field(default_factory=deque)

    @property
    def pause_s(self) -> float:
        """Requested time between two messages in s."""
        # A session gets one copy for all its subscriptions, as often as the least patient one asks
        # (rosbridge 2.0, 3.4.4).
        return min(self.throttles_ms.values(), default=0.0) / 1_000

    def is_due(self, now: float) -> bool:
        """Tell whether a message may be sent now; if so, record that it is."""
        if now - self.last_sent < self.pause_s:
            return False
        self.last_sent = now
        return True

    def hold(self, text: str) -> bool:
        """Hold a message for later, dropping the oldest; tell whether it is the only one."""
        # A length of 0 still keeps the newest: a robot that wants no queue wants the current state.
        room = min(max(1, *self.queues.values()) if self.queues else 1, MAX_HELD)
        while len(self.held) >= room:
            self.held.popleft()
            # The queue was full with one message, which is replaced: its delivery is scheduled
            # already.
            if not self.held:
                self.held.append(text)
                return False
        self.held.append(text)
        return len(self.held) == 1


@dataclass
class Topic:
    """A topic that was advertised, published to or subscribed to."""

    type: str = ""
    advertisers: set[int] = field(default_factory=set)
    latching: set[int] = field(default_factory=set)
    subscribers: dict[int, Subscriber] = field(default_factory=dict)
    latched: str = ""

    @property
    def is_unused(self) -> bool:
        """Whether it has neither advertisers nor subscribers."""
        return not self.advertisers and not self.subscribers and not self.latched


class Topics:
    """All topics of a server; sessions are identified by number, and sending never holds the lock.

    Parameters
    ----------
    deadlines
        Delivers messages held for throttled subscribers; without it they are dropped.

    Examples
    --------
    >>> topics, heard = Topics(), []
    >>> topics.subscribe(1, "/battery", None, 0, lambda text, topic: heard.append(text))
    >>> topics.publish(2, "/battery", {"percent": 80})
    >>> heard
    ['{"op":"publish","topic":"/battery","msg":{"percent":80}}']
    """

    def __init__(self, deadlines: Deadlines | None = None) -> None:
        self._lock = threading.Lock()
        self._deadlines = deadlines
        self._topics: dict[str, Topic] = {}

    def advertise(self, session: int, name: str, type_: str, *, latch: bool = False) -> None:
        """Advertise a topic; the first advertiser fixes its type.

        Parameters
        ----------
        latch
            Whether later subscribers receive the session's last message.

        Raises
        ------
        UsageError
            The name is reserved, the type differs, or the session has too many topics.
        """
        refuse_reserved(name)
        with self._lock:
            topic = self._topics.setdefault(name, Topic())
            if topic.type and type_ and topic.type != type_:
                raise UsageError(f"topic {name} has type {topic.type}, not {type_}")
            count = sum(session in other.advertisers for other in self._topics.values())
            if count >= MAX_TOPICS_PER_SESSION:
                raise UsageError(f"more than {MAX_TOPICS_PER_SESSION} topics advertised")
            topic.type = topic.type or type_
            topic.advertisers.add(session)
            (topic.latching.add if latch else topic.latching.discard)(session)

    def unadvertise(self, session: int, name: str) -> bool:
        """Withdraw an advertisement; tell whether there was one."""
        with self._lock:
            topic = self._topics.get(name)
            if topic is None or session not in topic.advertisers:
                return False
            topic.advertisers.discard(session)
            topic.latching.discard(session)
            self._tidy(name)
            return True

    def subscribe(
        self,
        session: int,
        name: str,
        id_: Any,
        throttle_ms: float,
        deliver: Deliver,
        queue_length: int = 0,
    ) -> None:
        """Subscribe to a topic, which need not exist yet.

        Raises
        ------
        UsageError
            The session has too many subscriptions.
        """
        with self._lock:
            topic = self._topics.setdefault(name, Topic())
            held = sum(session in other.subscribers for other in self._topics.values())
            if held >= MAX_SUBSCRIPTIONS and session not in topic.subscribers:
                raise UsageError(f"more than {MAX_SUBSCRIPTIONS} subscriptions")
            subscriber = topic.subscribers.setdefault(session, Subscriber(deliver))
            subscriber.throttles_ms[id_] = throttle_ms
            subscriber.queues[id_] = queue_length
            subscriber.deliver = deliver
            latched = topic.latched
        # Outside of the lock, like every delivery: a slow robot would hold up all topics.
        if latched:
            deliver(latched, name)

    def unsubscribe(self, session: int, name: str, id_: Any = None) -> None:
        """End one subscription to a topic or, without an id, all of the session's."""
        with self._lock:
            topic = self._topics.get(name)
            subscriber = topic.subscribers.get(session) if topic else None
            if topic is None or subscriber is None:
                return
            if id_ is not None:
                subscriber.throttles_ms.pop(id_, None)
                subscriber.queues.pop(id_, None)
            if id_ is None or not subscriber.throttles_ms:
                del topic.subscribers[session]
            self._tidy(name)

    def publish(self, session: int, name: str, message: Any, *, latch: bool = False) -> None:
        """Deliver a robot's message to all subscribers, itself included."""
        refuse_reserved(name)
        topic = self._topics.get(name)
        # Some clients latch when they advertise, others when they publish.
        latch = latch or (topic is not None and session in topic.latching)
        self._send(name, message, latch)

    def announce(self, name: str, type_: str, message: Any) -> None:
        """Deliver a message of the server itself."""
        with self._lock:
            self._topics.setdefault(name, Topic(type_)).type = type_
        self._send(name, message, latch=False)

    def _send(self, name: str, message: Any, latch: bool) -> None:
        text = encode({"op": "publish", "topic": name, "msg": message})
        now = time.monotonic()
        late: list[tuple[int, Subscriber]] = []
        with self._lock:
            topic = self._topics.setdefault(name, Topic())
            if latch and len(text) <= MAX_LATCHED_BYTES:
                self._latch(topic, text)
            due = []
            for session, subscriber in topic.subscribers.items():
                # Never past what is waiting: order of messages is kept.
                if not subscriber.held and subscriber.is_due(now):
                    due.append(subscriber)
                elif self._deadlines is not None and subscriber.hold(text):
                    late.append((session, subscriber))
            self._tidy(name)
        for subscriber in due:
            subscriber.deliver(text, name)
        for session, subscriber in late:
            self._flush_later(session, name, subscriber, now)

    def _flush_later(self, session: int, name: str, subscriber: Subscriber, now: float) -> None:
        assert self._deadlines is not None
        wait_s = max(subscriber.last_sent + subscriber.pause_s - now, 0.0)
        self._deadlines.after(wait_s, lambda: self._flush(session, name))

    def _flush(self, session: int, name: str) -> None:
        """Send the oldest message held back by a subscriber's throttle."""
        now = time.monotonic()
        with self._lock:
            topic = self._topics.get(name)
            subscriber = topic.subscribers.get(session) if topic else None
            if subscriber is None or not subscriber.held:
                return
            text = subscriber.held.popleft()
            subscriber.last_sent = now
            more = bool(subscriber.held)
        subscriber.deliver(text, name)
        if more:
            self._flush_later(session, name, subscriber, now)

    def _latch(self, topic: Topic, text: str) -> None:
        topic.latched = text
        latched = [other for other in self._topics.values() if other.latched]
        if len(latched) > MAX_LATCHED:
            # The oldest topic, since dictionaries keep the order of arrival; a robot cannot fill
            # the memory by latching on ever new names.
            latched[0].latched = ""

    def leave(self, session: int) -> None:
        """Forget a session that ended."""
        with self._lock:
            for name in list(self._topics):
                topic = self._topics[name]
                topic.advertisers.discard(session)
                topic.latching.discard(session)
                topic.subscribers.pop(session, None)
                self._tidy(name)

    def listing(self) -> list[tuple[str, str]]:
        """Return names and types, sorted."""
        with self._lock:
            return sorted((name, topic.type) for name, topic in self._topics.items())

    def advertised(self, session: int, name: str) -> bool:
        """Tell whether a session advertised a topic."""
        with self._lock:
            topic = self._topics.get(name)
            return topic is not None and session in topic.advertisers

    def type_of(self, name: str) -> str:
        """Return the type of a topic; empty if it is not known."""
        topic = self._topics.get(name)
        return topic.type if topic is not None else ""

    def is_heard(self, name: str) -> bool:
        """Tell whether anybody subscribes to a topic."""
        topic = self._topics.get(name)
        return topic is not None and bool(topic.subscribers)

    def sessions(self, name: str) -> tuple[set[int], set[int]]:
        """Return the sessions that advertise a topic and those that subscribe to it."""
        with self._lock:
            topic = self._topics.get(name)
            return (set(topic.advertisers), set(topic.subscribers)) if topic else (set(), set())

    def of(self, session: int) -> tuple[list[str], list[str]]:
        """Return the topics that a session advertises and those it subscribes to, sorted."""
        with self._lock:
            items = sorted(self._topics.items())
            return (
                [name for name, topic in items if session in topic.advertisers],
                [name for name, topic in items if session in topic.subscribers],
            )

    def _tidy(self, name: str) -> None:
        if self._topics[name].is_unused and not name.startswith(RESERVED):
            del self._topics[name]


def refuse_reserved(name: str) -> None:
    """Refuse names reserved for the server.

    Raises
    ------
    UsageError
        The name is reserved.
    """
    if name.startswith(RESERVED):
        raise UsageError(f"names below {', '.join(RESERVED)} belong to the server: {name}")
