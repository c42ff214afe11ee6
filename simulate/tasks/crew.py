"""Several robots carry out stored plans; goals whose plans fail are planned again."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rtask.errors import ConflictError, RtaskError, UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Executor, Graph, Turn
from simulate.tasks.questions import MAX_REPAIRS
from simulate.tasks.rearranging import Rearranging

__all__ = ["Crew", "Ended"]

_MAX_ROUNDS = 10_000


@dataclass(frozen=True)
class Ended:
    """How a goal ended.

    Parameters
    ----------
    goal
        In words.
    result
        reached, declined (a person said no), partly (what could be reached is, and the rest is left
        open), or given_up.
    repairs
        How often it was planned again.
    comment
        Why it was not reached.
    """

    goal: str
    result: str
    repairs: int
    comment: str = ""


@dataclass
class Crew:
    """Robots and whoever plans for them.

    Parameters
    ----------
    planner
        A client that may store plans for all robots.
    robots
        Their executors, by IRI.
    tell
        Called with each turn in which a robot did something, and its IRI.
    agent
        In whose name plans are made again; None for the planner's own.
    wait
        Called when robots have nothing to do but to wait for answers of people; returns whether to
        look again. By default the work ends there, and can be taken up again.
    """

    planner: Graph
    robots: Mapping[str, Executor]
    tell: Callable[[str, Turn], None] = lambda robot, turn: None
    agent: str | None = None
    wait: Callable[[], bool] = lambda: False
    ended: list[Ended] = field(default_factory=list)
    repair_s: list[float] = field(default_factory=list)
    """Processor time of each repair, s."""
    _repairs: Counter[str] = field(default_factory=Counter)

    def work(self) -> list[Ended]:
        """Carry out all open plans until each is done, declined or given up; return all ends.

        Raises
        ------
        RtaskError
            An operation failed, for instance because the server is out of reach or the search for
            a plan met its bound. Plans stay as they are, so that the work can be taken up again.
        """
        plans = self.planner.call("list_plans", state="all")["plans"]
        self._closed |= {plan["task"] for plan in plans if plan["state"] == "done"}
        order = list(self.robots)
        for _ in range(_MAX_ROUNDS):
            taken = {robot: self._turn(robot) for robot in order}
            # Who failed comes last: what another robot does next may be what was in its way.
            order.sort(key=lambda robot: taken[robot].result == "failed")
            turns = list(taken.values())
            if all(turn.result == "idle" for turn in turns):
                stuck = {plan for turn in turns for plan in turn.stuck}
                if not self._settle(stuck) and not (self._is_asking() and self.wait()):
                    break
        return self.ended

    def _turn(self, robot: str) -> Turn:
        turn = self.robots[robot].turn()
        if turn.result != "idle":
            self.tell(robot, turn)
        if turn.result == "done":
            self._rearranging.note_done(turn.task)
        return turn

    def _is_asking(self) -> bool:
        """Whether a step waits for the answer of a person."""
        plans = self.planner.call("list_plans", state="open")["plans"]
        return any(step["question"] for plan in plans for step in plan["steps"])

    def _settle(self, stuck: set[str]) -> bool:
        """End or repair every open plan that nobody works on; return whether any goes on."""
        goes_on = False
        plans = self.planner.call("list_plans", state="all")["plans"]
        for plan in plans:
            if plan["task"] in self._rearranging.helped:
                continue  # else it would be told as a goal that was reached
            if plan["task"] in self._rearranging.helping:
                self._end_help(plan, stuck)
            elif plan["state"] == "done":
                self._close(plan, "reached")
            elif plan["state"] == "declined":
                self._close(plan, "declined", _comment(plan))
                self._cancel(plan, f"declined: {_comment(plan)}")
            elif plan["state"] == "late":
                self._close(plan, "given_up", "its deadline is over")
                self._cancel(plan, "its deadline is over")
            elif plan["state"] == "blocked":
                self._look_for(plan)
                goes_on |= self._plan_again(plan)
            elif plan["state"] == "failed" or plan["task"] in stuck:
                began = time.process_time()
                goes_on |= self._repair(plan)
                self.repair_s.append(time.process_time() - began)
        return goes_on or self._rearranging.bring_back()

    def _close(self, plan: Mapping[str, Any], result: str, comment: str = "") -> None:
        if plan["task"] in self._closed:
            return
        self._closed.add(plan["task"])
        self.ended.append(Ended(plan["goal"], result, self._repairs[plan["goal"]], comment))

    def __post_init__(self) -> None:
        self._closed: set[str] = set()

        def store(**fields: Any) -> Any:
            return self.planner.call("store_plan", agent=self.agent, **fields)

        self._rearranging = Rearranging(self.planner, store)

    def _end_help(self, plan: Mapping[str, Any], stuck: set[str]) -> None:
        """End a plan that was only to move a thing for another one, and did not; or count it."""
        if plan["state"] == "done":
            self._rearranging.note_helped(plan["task"])
        if plan["state"] in ("failed", "declined", "late") or plan["task"] in stuck:
            self._cancel(plan, "the thing could not be moved")
            self._rearranging.note_unhelped(plan)

    def _cancel(self, plan: Mapping[str, Any], reason: str) -> None:
        self.planner.call("cancel_plan", plan=plan["task"], reason=reason[:1000])

    def _repair(self, plan: Mapping[str, Any]) -> bool:
        """Plan the goal again from the graph as it is; return whether there is more to do."""
        self._look_for(plan)
        if self._rearranging.move(plan):
            return True
        goal = plan["goal"]
        self._repairs[goal] += 1
        if self._repairs[goal] > MAX_REPAIRS:
            return self._give_up(plan, f"it was planned again {MAX_REPAIRS} times")
        hopeless = self._rearranging.hopeless(plan)
        return self._give_up(plan, hopeless) if hopeless else self._plan_again(plan)

    def _plan_again(self, plan: Mapping[str, Any]) -> bool:
        """Store a plan for what is within reach now; return whether there is more to do."""
        try:
            # Words such as "the cup on the table" mean another cup once the first is gone.
            goal = plan["settled"] or plan["goal"]
            again = self.planner.call("plan_goal", goal=goal)
            if again["complete"] and not again["steps"]:
                self._close(plan, "reached")
                self._cancel(plan, "the goal holds already")
                return False
            if plan["state"] == "blocked" and not again["steps"]:
                self._close(plan, "partly", "; ".join(plan["open_goals"]))
                return False
            may_be_part = plan["allows_part"] and again["refusals"]
            if not again["complete"] and not may_be_part:
                return self._give_up(plan, _refused(again))
            self.planner.call(
                "store_plan", goal=goal, digest=again["digest"], replaces=plan["task"],
                priority=plan["priority"], deadline=plan["deadline"], agent=self.agent,
                asking_price=plan["asking_price"], failing_price=plan["failing_price"],
                allow_part=plan["allows_part"],
            )  # fmt: skip
        except RtaskError as error:
            if error.answer_status == ConflictError.status:
                return True  # the graph has changed meanwhile: the next round plans again
            if error.answer_status in (UsageError.status, UnknownTermError.status):
                return self._give_up(plan, str(error))
            raise  # such as a server out of reach, which says nothing about the goal
        return True

    def _give_up(self, plan: Mapping[str, Any], why: str) -> bool:
        self._close(plan, "given_up", why)
        self._cancel(plan, f"given up: {why}")
        return False

    def _look_for(self, plan: Mapping[str, Any]) -> None:
        """Let every robot look for the things of a plan of which nobody knows where they are."""
        for row in self.planner.query(_LOST % plan["task"]):
            item = str(row["thing"])
            for executor in self.robots.values():
                place = executor.body.find(item)
                if place is not None:
                    executor.graph.call("state_place", thing=item, place=place)
                    break


def _refused(plan: Mapping[str, Any]) -> str:
    """Return why a goal cannot be reached now, without the steps for the rest of it."""
    refusals = [f"not possible: {item['goal']}: {item['text']}" for item in plan["refusals"]]
    return "; ".join(refusals) or str(plan["text"])


_LOST = f"""{PREFIXES}
SELECT DISTINCT ?thing WHERE {{
  <%s> rt:replacesPlan*/rt:hasSubTask/rt:handlesExemplar ?thing
  FILTER NOT EXISTS {{ ?thing rt:locatedOn ?place }}
}}"""


def _comment(plan: Mapping[str, Any]) -> str:
    steps: Sequence[Mapping[str, Any]] = plan["steps"]
    return next((step["comment"] for step in steps if step["state"] == plan["state"]), "")
