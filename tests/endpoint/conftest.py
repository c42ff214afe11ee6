"""Fixtures: an engine whose answers are known beforehand, and sessions that talk to it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from endpoint.rosbridge.session import Bridge, Session
from rtask.engine.operations.search import SearchObject, SimilarObjects
from rtask.errors import DataError
from rtask.kb.commit.access import Access
from rtask.wire.effect import Effect
from rtask.wire.message import Answer, Message

SIMILAR = [
    {"class": "1", "X": 0.5, "Y": 2.5, "Z": 1.5, "rad": 0.314, "label": "coke can"},
    {"class": "2", "X": None, "Y": None, "Z": None, "rad": None, "label": "no grasp yet"},
]


@dataclass(frozen=True)
class StandInOperation:
    """Stand-in for an operation, as far as it is asked before it is called."""

    scope: str
    effect: Effect = "reads"
    summary: str = "for tests"
    request: type[Message] = Message
    answer: type[Answer] = Answer


class Known(Answer, extra="allow"):
    """An answer of any members."""


class StandInEngine:
    """An engine whose answers are known; it remembers what it was asked."""

    def __init__(self) -> None:
        self.operations = {
            "search_object": StandInOperation("read", request=SearchObject, answer=SimilarObjects),
            "insert_object": StandInOperation("write", "writes"),
            "wait": StandInOperation("read"),
            "fail": StandInOperation("read"),
            "not_a_number": StandInOperation("read"),
        }
        self.asked: list[tuple[str, dict[str, Any], Access]] = []
        self.gate = threading.Event()

    def call(self, name: str, args: dict[str, Any], access: Access) -> Answer:
        """Answer an operation."""
        self.asked.append((name, args, access))
        if name == "wait":
            self.gate.wait(60)
            return Known(waited=True)
        if name == "fail":
            raise RuntimeError("a secret of the inside")
        if name == "not_a_number":
            return Known(value=float("nan"))
        if name == "search_object":
            if args.get("data", "").startswith("zc5p81"):
                raise DataError("not a point cloud (unknown first bytes)")
            return Known(similar_objects=SIMILAR)
        stored = [
            {"object": f"urn:object:{i}", "class": "4", "new": True, "features": 212, "grasp": None}
            for i, _ in enumerate(args["objects"])
        ]
        return Known(stored=len(stored), commit=1, objects=stored)

    def close(self) -> None:
        """Nothing to let go."""


class Robot:
    """One end of a conversation without sockets: says messages, keeps what it hears."""

    def __init__(self, bridge: Bridge, access: Access) -> None:
        self.heard: list[dict[str, Any]] = []
        self.session = Session(bridge, self._hear, access)

    def _hear(self, text: str, topic: str = "") -> None:
        self.heard.append(json.loads(text))

    def say(self, message: Any) -> None:
        """Send a message: an object, or text as it is."""
        self.session.feed(message if isinstance(message, str) else json.dumps(message))

    def ask(self, message: Any) -> dict[str, Any]:
        """Send a message and wait for what comes next."""
        before = len(self.heard)
        self.say(message)
        deadline = time.monotonic() + 60
        while len(self.heard) == before:
            assert time.monotonic() < deadline, f"no answer to {str(message)[:200]}"
            time.sleep(0.001)
        return self.heard[before]


@pytest.fixture
def engine() -> StandInEngine:
    return StandInEngine()


@pytest.fixture
def bridge(engine: StandInEngine) -> Iterator[Bridge]:
    bridge = Bridge(engine)
    yield bridge
    engine.gate.set()
    bridge.close()


@pytest.fixture
def connect(bridge: Bridge) -> Callable[..., Robot]:
    """Connect a robot: ``connect()`` or ``connect(Access("nao-1", "robot"))``."""

    def make(access: Access | None = None) -> Robot:
        return Robot(bridge, access or Access(None, "anonymous"))

    return make
