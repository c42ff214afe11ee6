"""Decisions whose outcome has not been heard of yet."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition
    from rtask.engine.memory.choice import Option

__all__ = ["Decision", "Decisions"]


@dataclass(frozen=True)
class Decision:
    """What the engine answered for one task.

    Parameters
    ----------
    object
        IRI of the object, empty when it was unknown.
    options
        Offered grasps by id.
    times
        Durations of the steps, s.
    """

    object: str
    recognition: Recognition | None
    options: Mapping[str, Option] = field(default_factory=dict)
    times: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0


class Decisions:
    """Remembers recent decisions by task, so that an outcome can be stored with its reasons.

    Memory only: after a restart an outcome is stored without them.
    """

    def __init__(self, size: int = 2048) -> None:
        self._size = size
        self._kept: OrderedDict[str, Decision] = OrderedDict()
        self._lock = threading.Lock()

    def put(self, task: str, decision: Decision) -> None:
        """Remember a decision."""
        with self._lock:
            self._kept[task] = decision
            while len(self._kept) > self._size:
                self._kept.popitem(last=False)

    def get(self, task: str | None) -> Decision | None:
        """Return a decision, or None when it is forgotten."""
        with self._lock:
            return None if task is None else self._kept.get(task)
