"""Goals in a lab with slippery things and a person, carried out under several rules of asking.

Robots know of each product what earlier attempts at it gave; its chance to slip they do not know.
The same lab, with the same chances, is worked in under each rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.study.tasks.trial import lab_update
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor, Turn
from simulate.tasks.lab import Lab, read_lab
from simulate.world.seeds import stream

__all__ = ["run_trial"]

_BASE = "https://example.org/kb/"
_STREAM, _PERSON_STREAM, _SLIP_STREAM = 83, 84, 85
_SLIPS = (0.02, 0.02, 0.1, 0.3, 0.6, 0.9)
"""Chances to slip, of which each product has one."""
_PAST = 6
"""Attempts at each product that the graph knows."""
_KNOWS, _ANSWERS = 0.9, 0.85
"""Chance that a person knows how to help, or where a thing is; and that anybody answers."""


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return what came of the goals of one lab under each rule.

    Parameters
    ----------
    settings
        seed; things; goals: their number; moved: chance that a person has moved a thing where the
        graph has it not; failing: price of a failed step; asking: prices of a question.
    """
    # Without prices nobody is asked; a question that costs nothing is always worth it.
    prices: dict[str, float | None] = {"never": None, "always": 0.0}
    prices |= {f"{price:g}": price for price in settings["asking"]}
    made = {
        price: _carry_out(settings, number, price).figures() for price in set(prices.values())
    }  # fmt: skip
    return {rule: made[price] for rule, price in prices.items()}


@dataclass
class _Work:
    """The goals of one lab, a person, and what came of them."""

    planner: Any
    lab: Lab
    person: np.random.Generator
    goals: int
    questions: int = 0
    failed: int = 0
    reached: int = 0
    declined: int = 0

    def figures(self) -> dict[str, int]:
        """Return counts."""
        return {"goals": self.goals, "questions": self.questions, "failed": self.failed,
                "reached": self.reached, "declined": self.declined}  # fmt: skip

    def count(self, robot: str, turn: Turn) -> None:
        """Count what a robot did."""
        self.questions += turn.result == "asked"
        self.failed += turn.result == "failed"

    def answer(self) -> bool:
        """Let a person answer what is asked; return whether anything was."""
        asked = self.planner.call("list_questions")["questions"]
        for question in asked:
            self.planner.call(
                "answer_question", question=question["question"], operator="ann",
                choice=self._choice(question),
            )  # fmt: skip
        return bool(asked)

    def _choice(self, question: Mapping[str, Any]) -> int:
        """Return the number of what a person says who knows things as they are, or not."""
        code, place = "go_on", ""
        if self.person.random() < _ANSWERS and self.person.random() < _KNOWS:
            item = question["thing"]
            if question["kind"] == "act":
                code = "helped"
                self.lab.helped.add(item)
            else:
                code, place = (
                    ("at", self.lab.where[item]) if item in self.lab.where else ("gone", "")
                )
        return next(
            int(choice["number"]) for choice in question["choices"]
            if choice["code"] == code and choice["place"] == place
        )  # fmt: skip


def _carry_out(settings: Mapping[str, Any], number: int, asking: float | None) -> _Work:
    rng = stream(settings["seed"], _STREAM, number)
    with rtask.open(":memory:", base=_BASE) as kb, Engine(kb) as engine:
        kb.update(lab_update(rng, settings["things"]))
        slips = rng.choice(_SLIPS, settings["things"])
        kb.update(_past(rng, slips))
        planner = rtask.connect(engine)
        lab = read_lab(planner.query, stream(settings["seed"], _SLIP_STREAM, number))
        lab.slips = {f"{_BASE}thing/{item}": float(chance) for item, chance in enumerate(slips)}
        goals = _goals(rng, planner, lab, settings["goals"])
        for item in sorted(lab.where):
            if rng.random() < settings["moved"]:
                places = sorted({place for reach in lab.reach.values() for place in reach})
                lab.where[item] = places[int(rng.integers(len(places)))]
        person = stream(settings["seed"], _PERSON_STREAM, number)
        work = _Work(planner, lab, person, len(goals))
        prices = {} if asking is None else {
            "asking_price": asking, "failing_price": settings["failing"],
        }  # fmt: skip
        for goal in goals:
            planner.call("store_plan", goal=goal, **prices)
        robots = {
            robot: Executor(rtask.connect(engine, agent=robot.rpartition("/")[2]), lab.robot(robot))
            for robot in sorted(lab.hands)
        }
        for ended in Crew(planner, robots, work.count, wait=work.answer).work():
            work.reached += ended.result == "reached"
            work.declined += ended.result == "declined"
        return work


def _past(rng: np.random.Generator, slips: np.ndarray[Any, Any]) -> str:
    """Return the update with earlier attempts of the Pandas and Naos at each product."""
    rows = []
    for item, slip in enumerate(slips):
        for turn in range(_PAST):
            hand = f"{_BASE}robot/{('nao-1', 'panda-1')[turn % 2]}/hand"
            held = "true" if rng.random() >= slip else "false"
            task, attempt = (f"{_BASE}{part}/past-{item}-{turn}" for part in ("task", "attempt"))
            rows.append(
                f"<{task}> a rt:Grasp ; rt:carriedOutBy <{attempt}> ; "
                f"rt:assignedTo <{hand.removesuffix('/hand')}> ; "
                f"rt:handles <{_BASE}object/{item}> . <{attempt}> a rt:GraspAttempt ; "
                f"rt:activates <{hand}> ; rt:performedBy <{hand.removesuffix('/hand')}> ; "
                f"rt:hasOutcome <{attempt}/outcome> . <{attempt}/outcome> a rt:GraspOutcome ; "
                f"rt:success {held} ; rt:judgedSuccess {held} ."
            )
    return f"{PREFIXES} INSERT DATA {{ GRAPH <{_BASE}graph/shared> {{ {' '.join(rows)} }} }}"


def _goals(rng: np.random.Generator, planner: Any, lab: Lab, number: int) -> list[str]:
    """Draw goals for different things, each of which takes at least one step."""
    places = sorted({place for reach in lab.reach.values() for place in reach})
    goals = []
    for item in rng.permutation(sorted(lab.where)):
        for place in rng.permutation(places):
            goal = f"<{item}> rt:locatedOn <{place}>"
            plan = planner.call("plan_goal", goal=goal)
            if plan["complete"] and plan["steps"]:
                goals.append(goal)
                break
        if len(goals) == number:
            break
    return goals
