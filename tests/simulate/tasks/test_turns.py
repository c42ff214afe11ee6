"""In which order the robots of a crew take their turns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from simulate.tasks.crew import Crew
from simulate.tasks.executor import Turn


class _NoPlans:
    def call(self, operation: str, **fields: Any) -> dict[str, Any]:
        assert operation == "list_plans"
        return {"plans": []}


@dataclass
class _Scripted:
    """Takes the turns that it is given, then has nothing to do."""

    results: Iterator[str]
    name: str
    taken: list[str] = field(default_factory=list)

    def turn(self) -> Turn:
        self.taken.append(self.name)
        return Turn(next(self.results, "idle"))


def test_who_failed_takes_the_next_turn_last() -> None:
    """The other may hold what is in its way, and puts it down if it comes first."""
    order: list[str] = []
    robots: Any = {
        "nao": _Scripted(iter(["failed", "failed", "done"]), "nao", order),
        "panda": _Scripted(iter(["done", "done"]), "panda", order),
    }
    Crew(_NoPlans(), robots).work()  # type: ignore[arg-type]
    assert order[:6] == ["nao", "panda", "panda", "nao", "panda", "nao"]
