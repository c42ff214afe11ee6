"""Log of what robots do at this moment, kept in memory, and the present state of each robot.

The graph remembers what was written. This log adds what is never written: who is connected, what a
robot asks, what it was told, and what its camera sees. It forgets all that when the server ends.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from endpoint.activity.presence import Calls, Links

__all__ = ["ANONYMOUS", "OPERATOR", "ActivityLog", "Event", "Lane", "as_json"]

ANONYMOUS = "anonymous"
OPERATOR = "an operator"
"""Who wrote, where no name is known."""
MAX_EVENTS = 1_000
MAX_LANES = 64
MAX_SEEN = 1_000
LANE_LIFETIME_S = 600.0
PICTURE_TYPES = frozenset(
    ("rtask/Frame", "sensor_msgs/CompressedImage", "sensor_msgs/msg/CompressedImage")
)
"""Types of topics whose last message is kept as a robot's camera picture."""

Listener = Callable[["Event"], None]


@dataclass(frozen=True)
class Event:
    """Something that a robot or a person did.

    Parameters
    ----------
    kind
        ``connected``, ``left``, ``asks``, ``met``, ``answered``, ``refused``, ``frame``,
        ``outcome``, ``verdict`` or ``wrote``.
    who
        Name of the robot or person.
    words, detail
        A sentence, and the reasons for it.
    service
        Called service, for calls.
    object, object_name
        IRI and name of the object concerned.
    held
        Whether an attempt succeeded.
    before, after
        SHA-256 of the pictures of an attempt; empty if there is none.
    seq
        Number of the commit, for what was written; 0 otherwise.
    number
        Number in this log, from 1; 0 for events read back from the graph.
    time_s
        Seconds since the epoch.
    """

    kind: str
    who: str
    words: str
    detail: str = ""
    service: str = ""
    object: str = ""
    object_name: str = ""
    held: bool | None = None
    before: str = ""
    after: str = ""
    seq: int = 0
    number: int = 0
    time_s: float = 0.0


@dataclass(frozen=True)
class Lane:
    """Present state of one robot.

    Parameters
    ----------
    connections
        Open rosbridge connections; 0 after it left.
    doing
        Request in progress; empty between requests.
    met, chosen
        What it recognised last, and the first choice among the grasps that it was offered.
    outcome, held, before, after
        Its last attempt, as in :class:`Event`.
    frame
        Number of its camera's last picture; 0 without any.
    changed_s
        Time of the last event, seconds since the epoch.
    """

    robot: str
    connections: int = 0
    doing: str = ""
    met: str = ""
    chosen: str = ""
    object: str = ""
    outcome: str = ""
    held: bool | None = None
    before: str = ""
    after: str = ""
    frame: int = 0
    changed_s: float = 0.0

    def after_event(self, event: Event) -> Lane:
        """Return the state after an event of the robot."""
        changed = replace(self, changed_s=event.time_s)
        if event.kind == "connected":
            return replace(changed, connections=self.connections + 1)
        if event.kind == "left":
            return replace(changed, connections=max(0, self.connections - 1), doing="")
        if event.kind == "asks":
            return replace(changed, doing=event.words)
        if event.kind == "met":
            return replace(
                changed, doing="", met=event.words, chosen=event.detail, object=event.object
            )
        if event.kind == "outcome":
            return replace(
                changed, outcome=event.words, held=event.held, before=event.before,
                after=event.after,
            )  # fmt: skip
        if event.kind == "frame":
            return replace(changed, frame=self.frame + 1)
        return replace(changed, doing="") if event.kind in ("answered", "refused") else changed


@dataclass
class _State:
    """State of the log, which the lock protects."""

    events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))
    lanes: dict[str, Lane] = field(default_factory=dict)
    pictures: dict[str, dict[str, Any]] = field(default_factory=dict)
    connections: Counter[str] = field(default_factory=Counter)
    seen_s: dict[str, float] = field(default_factory=dict)
    last: int = 0


class ActivityLog:
    """The last events of a server and the state of each robot; safe for all threads.

    Parameters
    ----------
    clock
        Returns seconds since the epoch.

    Attributes
    ----------
    run
        Identifier of this log, which tells its numbers from those of an earlier server.
    links, calls
        Open connections of robots, and how long their calls take.

    Examples
    --------
    >>> log = ActivityLog()
    >>> log.tell(Event("connected", "nao-1", "connected"))
    >>> log.tell(Event("asks", "nao-1", "what is this, and how to grasp it?"))
    >>> [event.kind for event in log.after(0)], log.lanes()[0].doing
    (['connected', 'asks'], 'what is this, and how to grasp it?')
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self.run = secrets.token_hex(4)
        self._clock = clock
        self._lock = threading.Lock()
        self._state = _State()
        self._listeners: list[Listener] = []
        self.links, self.calls = Links(), Calls()

    @property
    def last(self) -> int:
        """Number of the last event; 0 before the first."""
        return self._state.last

    def tell(self, *events: Event) -> None:
        """Append events; each gets a number and, unless it has one, the present time."""
        state = self._state
        logged: list[Event] = []
        with self._lock:
            for event in events:
                state.last += 1
                time_s = event.time_s or self._clock()
                numbered = replace(event, number=state.last, time_s=time_s)
                if event.kind not in ("verdict", "wrote") or event.who in state.lanes:
                    lane = state.lanes.pop(event.who, Lane(event.who))
                    state.lanes[event.who] = lane.after_event(numbered)
                    state.seen_s.pop(event.who, None)
                    state.seen_s[event.who] = time_s
                state.events.append(numbered)
                logged.append(numbered)
            self._forget_lanes()
        for event in logged:
            for listener in tuple(self._listeners):
                listener(event)

    def connected(self, robot: str) -> None:
        """Note that a robot opened a connection; further ones of its own are counted only."""
        self._count(robot, 1)

    def left(self, robot: str) -> None:
        """Note that a robot closed a connection."""
        self._count(robot, -1)

    def _count(self, robot: str, step: int) -> None:
        with self._lock:
            self._state.connections[robot] += step
            now = self._state.connections[robot]
            if now <= 0:
                del self._state.connections[robot]
        if step > 0 and now == 1:
            self.tell(Event("connected", robot, "connected"))
        elif step < 0 and now == 0:
            self.tell(Event("left", robot, "left"))

    def picture(self, robot: str, topic: str, type_: str, message: Any) -> None:
        """Keep the last picture of a robot's camera; other topics are ignored."""
        if type_ not in PICTURE_TYPES or not isinstance(message, dict):
            return
        who = robot if robot != ANONYMOUS else topic.strip("/").partition("/")[0]
        with self._lock:
            pictures = self._state.pictures
            pictures.pop(who, None)
            pictures[who] = {"type": type_, "data": message.get("data")}
            while len(pictures) > MAX_LANES:
                del pictures[next(iter(pictures))]
        self.tell(Event("frame", who, "sees something new"))

    def last_picture(self, robot: str) -> dict[str, Any] | None:
        """Return type and data of a robot's last camera picture, as the robot sent them."""
        with self._lock:
            return self._state.pictures.get(robot)

    @property
    def first_seq(self) -> int:
        """Number of the first commit that it tells of; 0 if it tells of none."""
        with self._lock:
            return next((event.seq for event in self._state.events if event.seq), 0)

    def after(self, number: int) -> Sequence[Event]:
        """Return the events after one, the oldest first; older ones may have been forgotten."""
        with self._lock:
            if self._state.last <= number:
                return ()
            return [event for event in self._state.events if event.number > number]

    def lanes(self) -> list[Lane]:
        """Return the state of each robot: connected ones first, then by name."""
        with self._lock:
            return sorted(
                self._state.lanes.values(), key=lambda lane: (not lane.connections, lane.robot)
            )

    def lane(self, robot: str) -> Lane | None:
        """Return the state of a robot; none if it was never seen."""
        with self._lock:
            return self._state.lanes.get(robot)

    def seen_s(self, robot: str) -> float | None:
        """Return when a robot was last heard of, seconds since the epoch; none if never."""
        with self._lock:
            return self._state.seen_s.get(robot)

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call back after each event, in the thread that caused it; return a function to stop."""
        self._listeners.append(listener)

        def stop() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return stop

    def _forget_lanes(self) -> None:
        """Drop robots that left long ago, and the oldest if there are too many."""
        lanes, now = self._state.lanes, self._clock()
        gone = [
            name for name, lane in lanes.items()
            if not lane.connections and now - lane.changed_s > LANE_LIFETIME_S
        ]  # fmt: skip
        for name in gone:
            del lanes[name]
        while len(lanes) > MAX_LANES:
            del lanes[next(iter(lanes))]
        while len(self._state.seen_s) > MAX_SEEN:
            del self._state.seen_s[next(iter(self._state.seen_s))]


def as_json(event: Event) -> dict[str, Any]:
    """Return an event as JSON data, without what is empty."""
    return {name: value for name, value in asdict(event).items() if value not in ("", None)}
