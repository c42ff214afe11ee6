"""Plans for people and programs: steps with reasons, or why there is no plan."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["PlannedStep", "Refusal", "Support", "TaskPlan"]


@dataclass(frozen=True)
class Support:
    """Why a precondition of a step holds when its turn comes.

    Parameters
    ----------
    text
        The precondition.
    step
        Number of the step that makes it true; None if it holds before the plan.
    statement
        Subject, predicate and object, IRIs; None for what is no single statement.
    is_assumed
        Nobody has stated it, and the plan assumes it.
    """

    text: str
    step: int | None
    statement: tuple[str, str, str] | None
    is_assumed: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "text": self.text, "step": self.step, "assumed": self.is_assumed,
            "statement": None if self.statement is None else list(self.statement),
        }  # fmt: skip


@dataclass(frozen=True)
class PlannedStep:
    """One task of a plan.

    Parameters
    ----------
    number
        From 1.
    action
        IRI of its class.
    arguments
        IRIs by parameter.
    statements
        Properties of the task, IRIs, each with its value.
    robots
        IRIs of those who do it.
    text
        A sentence.
    duration_s, chance
        As expected from the outcomes so far.
    successes, attempts
        Outcomes of this kind of hand with this product.
    start_s
        When it can begin if robots work at the same time.
    supports
        Why each precondition holds.
    after
        Numbers of the steps that must have ended before.
    for_hand
        Those of them that it waits for only because of its hand: done by another one, it need not.
    why, outcomes
        What the chance rests on: in words, and the SPARQL query for the outcomes.
    """

    number: int
    action: str
    arguments: Mapping[str, str]
    statements: tuple[tuple[str, str], ...]
    robots: tuple[str, ...]
    text: str
    duration_s: float
    chance: float
    successes: int
    attempts: int
    start_s: float
    supports: tuple[Support, ...]
    after: tuple[int, ...] = ()
    why: str = ""
    outcomes: str = ""
    for_hand: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "step": self.number, "action": self.action, "arguments": dict(self.arguments),
            "robots": list(self.robots), "text": self.text,
            "duration_s": round(self.duration_s, 3), "start_s": round(self.start_s, 3),
            "chance": round(self.chance, 4), "successes": self.successes,
            "attempts": self.attempts, "after": list(self.after),
            "because": [item.to_dict() for item in self.supports],
            "why": self.why, "outcomes": self.outcomes,
        }  # fmt: skip


@dataclass(frozen=True)
class Refusal:
    """Why one goal is out of reach.

    Parameters
    ----------
    goal
        The goal in words.
    text
        What is missing, and how to mend it.
    missing
        Statements, IRIs, under which the goal could be reached: the cheapest; may be empty.
    by_robot
        For each robot, by IRI, what it alone would need.
    """

    goal: str
    text: str
    missing: tuple[tuple[str, str, str], ...]
    by_robot: Mapping[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "goal": self.goal, "text": self.text,
            "missing": [list(item) for item in self.missing], "by_robot": dict(self.by_robot),
        }  # fmt: skip


@dataclass(frozen=True)
class TaskPlan:
    """A plan for a goal, or the reasons why there is none.

    Parameters
    ----------
    goal
        The goal as it was given.
    understood
        The goals that were read in it.
    sparql
        For each of these, the query for what it is about.
    steps
        In order; empty if nothing is to be done, or there is no plan. Where some goals are out of
        reach, those that reach the others.
    refusals
        Goals that are out of reach.
    assumptions
        Statements that nobody has made and that the plan assumes, in words.
    names
        Names of the IRIs.
    domain, problem
        The planning problem as PDDL.
    deadline
        By when, if the goal says so.
    settled
        The goal as JSON with the things that its words meant, where these mean others once a part
        of it is done: what is to be planned again.
    allows_takeover
        Whether an idle robot may take over what another one has not begun; not where the goal names
        who is to do it, or who is not.
    """

    goal: str
    understood: tuple[str, ...]
    sparql: tuple[str, ...]
    steps: tuple[PlannedStep, ...]
    refusals: tuple[Refusal, ...]
    assumptions: tuple[str, ...]
    names: Mapping[str, str]
    is_complete: bool
    domain: str
    problem: str
    deadline: dt.datetime | None = None
    settled: str = ""
    allows_takeover: bool = False

    @property
    def chance(self) -> float:
        """Chance that all steps succeed at the first attempt, taken as independent."""
        return math.prod(step.chance for step in self.steps)

    @property
    def duration_s(self) -> float:
        """How long it takes if robots work at the same time, s."""
        return max((step.start_s + step.duration_s for step in self.steps), default=0.0)

    @property
    def digest(self) -> str:
        """Digest of the steps: two plans of the same tasks have the same."""
        tasks = [[step.action, sorted(step.arguments.items())] for step in self.steps]
        return hashlib.sha256(json.dumps(tasks).encode()).hexdigest()

    @property
    def text(self) -> str:
        """The plan in words."""
        lines = [f"understood: {'; '.join(self.understood)}"]
        for refusal in self.refusals:
            lines += [f"not possible: {refusal.goal}", f"  {refusal.text}"]
            lines += [
                f"  {self.names.get(robot, robot)} alone lacks: {text}"
                for robot, text in refusal.by_robot.items()
            ]
        if not self.is_complete and not self.refusals:
            lines.append("No order of steps reaches all goals, though each could be reached alone.")
        if self.is_complete and not self.steps:
            lines.append("Nothing to do: the goal holds already." if self.sparql or not
                         self.understood else "Nothing to do.")  # fmt: skip
        if self.deadline is not None:
            lines.append(f"by {self.deadline.isoformat(timespec='seconds')}, if it is stored")
            late_s = self.duration_s - (self.deadline - dt.datetime.now(dt.UTC)).total_seconds()
            if self.steps and late_s > 0:
                lines.append(
                    f"which is too soon: begun now, it is expected to end {late_s:.0f} s later"
                )
        if self.refusals and self.steps:
            lines.append("Without that, the rest can be done:")
        for step in self.steps:
            held = f"held {step.successes} of {step.attempts}" if step.attempts else "untried"
            lines.append(
                f"{step.number:3}. {step.text}  "
                f"({step.duration_s:.0f} s, chance {step.chance:.2f}, {held})"
            )
        lines += [f"assumed, for nobody has stated it: {text}" for text in self.assumptions]
        if self.steps:
            lines.append(
                f"{len(self.steps)} steps, {self.duration_s:.0f} s, "
                f"chance that all succeed at once {self.chance:.2f}"
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "goal": self.goal, "understood": list(self.understood), "sparql": list(self.sparql),
            "complete": self.is_complete, "steps": [step.to_dict() for step in self.steps],
            "refusals": [item.to_dict() for item in self.refusals],
            "assumptions": list(self.assumptions), "names": dict(self.names),
            "deadline": None if self.deadline is None else self.deadline.timestamp(),
            "settled": self.settled,
            "duration_s": round(self.duration_s, 3), "chance": round(self.chance, 4),
        }  # fmt: skip
