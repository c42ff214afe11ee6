"""Encounters of a robot with the objects on its table, and its attempts at them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from features.tabletop import TabletopShape
from simulate.agent.decisions import Refusal

__all__ = ["Attempt", "Encounter"]


@dataclass(frozen=True)
class Attempt:
    """One attempt: the grasp, its source and its outcome.

    Parameters
    ----------
    reason
        ``ok`` if held; otherwise why not, or why no grasp could be planned.
    physical
        False if nothing was moved, because no grasp could be planned.
    place_reason
        ``ok`` if placed; otherwise why not; empty if the object was not held.
    told
        Record of this grasp and its neighbours in the graph before the attempt, over all robots:
        held and lost, weighted.
    run
        Number of the physical attempt among all of this robot, from 1; 0 if nothing was moved.
    evidence
        Measurements of the robot and its conclusions.
    alone
        What the graph told of this grasp and where the robot would have grasped without it.
    first_offered
        Source of the grasp that came first in the graph's answer, which the arm may not reach.
    """

    number: int
    source: str
    grasp: str
    reason: str
    held: bool
    placed: bool
    physical: bool
    mean: float
    seconds: Mapping[str, float]
    pictures: tuple[str, ...] = ()
    place_reason: str = ""
    told: tuple[float, float] = (0.0, 0.0)
    run: int = 0
    evidence: str = ""
    alone: str = ""
    first_offered: str = ""


@dataclass
class Encounter:
    """All attempts of one robot at one object, and how it was recognised.

    Parameters
    ----------
    name
        What people call the object; empty = nobody said. No decision depends on it.
    recognised
        IRI that the server recognised in the first view; empty if the object was new to it.
    confidence
        Confidence of the best match in the first view, whether accepted or not.
    object_iri
        IRI of the object in the graph at the end.
    refusals
        Refusals to grasp it, in order.
    lost
        Whether it went out of sight before the robot was done with it, and was not found again.
    """

    number: int
    side: str
    position: tuple[float, float]
    size: tuple[float, float, float]
    is_seen: bool = False
    name: str = ""
    recognised: str = ""
    label: str = ""
    confidence: float = 0.0
    object_iri: str = ""
    lost: bool = False
    attempts: list[Attempt] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def at(cls, number: int, side: str, shape: TabletopShape) -> Encounter:
        """Return the encounter with an object that was just seen."""
        x, y = (float(v) for v in shape.centre)
        return cls(number, side, (x, y), (shape.length, shape.width, shape.height))

    @property
    def title(self) -> str:
        """The object's name; without one, its number on this table."""
        return self.name or f"object {self.number}"

    @property
    def tries(self) -> int:
        """Physical attempts so far."""
        return sum(attempt.physical for attempt in self.attempts)

    @property
    def held(self) -> bool:
        """Whether an attempt held the object."""
        return any(attempt.held for attempt in self.attempts)

    @property
    def tries_to_success(self) -> int | None:
        """Physical attempts up to the first that held and was not lost on the way; or None."""
        for tried, attempt in enumerate((a for a in self.attempts if a.physical), start=1):
            if attempt.held and attempt.place_reason != "slip_transport":
                return tried
        return None

    @property
    def placed(self) -> bool:
        """Whether the object reached the box."""
        return any(attempt.placed for attempt in self.attempts)

    def conclude_placed(self) -> None:
        """Conclude of the last attempt that the object lies in the box, as it is nowhere else."""
        last = self.attempts[-1]
        evidence = f"{last.evidence}; placed: yes (it is nowhere on the table)"
        self.attempts[-1] = replace(last, placed=True, evidence=evidence)

    def summary(self) -> dict[str, Any]:
        """Return the encounter as JSON data."""
        data = asdict(self)
        data.update(
            tries=self.tries,
            tries_to_success=self.tries_to_success,
            held=self.held,
            placed=self.placed,
        )
        return data
