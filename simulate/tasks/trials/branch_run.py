"""One try on one branch: state the changed fact, plan, carry out, and judge."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import NamedNode
from rtask.tasks.diagnosis.attempt import Failure, Hand
from simulate.tasks.executor import Executor
from simulate.tasks.lab import Lab, read_lab
from simulate.tasks.trials.believed import BelievedCause, BelievedRobot, Hidden
from simulate.tasks.trials.supposed import Supposition, goal_of, stated

__all__ = ["BranchRun", "run_on_branch"]

_MAX_ROUNDS = 200
_MAX_PLACES = 3
"""Places to which things in the way are tried to be moved, the emptiest first."""
_REASON = "set aside while a change is tried on this branch"


@dataclass(frozen=True)
class BranchRun:
    """What came of one try.

    Parameters
    ----------
    held
        Whether every step of the plan held, and the goal is reached.
    steps
        The plan in words.
    failed_with
        What the robots said of the first failure.
    is_physical
        Whether physics decided a grasp.
    refusal
        Why there was nothing to carry out; empty if there was.
    """

    held: bool = False
    steps: tuple[str, ...] = ()
    failed_with: str = ""
    is_physical: bool = False
    refusal: str = ""


def run_on_branch(
    kb: KnowledgeBase, hidden: Hidden, supposition: Supposition, cause: BelievedCause
) -> BranchRun:
    """Try a change on a branch, which is written.

    Raises
    ------
    RtaskError
        The branch can no longer be written, or its disk is full.
    """
    failure = hidden.failure
    with Engine(kb) as engine:
        planner = rtask.connect(engine)
        goal = goal_of(planner.call("list_plans", state="all")["plans"], failure)
        if not goal:
            return BranchRun(refusal="the graph does not say which thing it was")
        if not failure.origin:
            return BranchRun(refusal="the graph does not say where the thing stood")
        _set_aside(planner)
        planner.call("state_place", thing=failure.tried.thing, place=failure.origin)
        if supposition.facts:
            kb.update(stated(supposition.facts))
        # The same draws for each change of one cause.
        rng = np.random.default_rng(cause.noise)
        lab = read_lab(planner.query, rng)
        if cause.is_moved:
            lab.where[failure.tried.thing] = _true_place(lab, failure, rng)
        picked: list[bool] = []
        robots = {
            iri: BelievedRobot(
                lab, iri, hidden, cause, supposition.along, supposition.grasp, picked
            )
            for iri in sorted(lab.hands)
        }  # fmt: skip
        if supposition.looks:
            is_seen = _looked(planner, robots, failure.tried.thing)
            if not is_seen:
                return BranchRun(failed_with="no robot sees it within its reach")
        if supposition.clears:
            cleared = _clear(planner, lab, robots, goal, failure)
            if not cleared.held:
                return cleared
        if not supposition.facts:
            kb.update(stated(_others_do_not(failure, hidden.hands)))
        return _carry_out(planner, robots, goal, picked)


def _others_do_not(failure: Failure, hands: Mapping[str, Hand]) -> str:
    """Return facts by which the hand that failed takes the thing again, where it was.

    All but the changed fact is as it was: after a failure the planner would take another hand.
    """
    own, origin = failure.tried.hand.iri, failure.origin
    if not own or origin in hands:
        return ""
    others = (iri for iri in hands if iri != own)
    return " ".join(f"{NamedNode(origin)} rt:beyondReachOf {NamedNode(iri)} ." for iri in others)


def _set_aside(planner: Any) -> None:
    """End all open plans of the branch, or robots would carry those out as well."""
    for plan in planner.call("list_plans", state="open")["plans"]:
        for step in plan["steps"]:
            if step["state"] == "claimed":
                planner.call(
                    "end_step", task=step["task"], result="released", robot=step["claimed_by"],
                    comment=_REASON,
                )  # fmt: skip
        planner.call("cancel_plan", plan=plan["task"], reason=_REASON)


def _true_place(lab: Lab, failure: Failure, rng: np.random.Generator) -> str:
    """Return where a thing is that was not where it was believed to be."""
    if failure.seen_at and failure.seen_at != failure.origin:
        return failure.seen_at
    places = sorted({place for within in lab.reach.values() for place in within})
    others = [place for place in places if place != failure.origin]
    return others[int(rng.integers(len(others)))] if others else ""


def _looked(planner: Any, robots: Mapping[str, BelievedRobot], item: str) -> bool:
    """Let robots look for a thing and state where it is; return whether one sees it."""
    for robot in robots.values():
        place = robot.find(item)
        if place is not None:
            planner.call("state_place", thing=item, place=place)
            return True
    return False


def _clear(
    planner: Any, lab: Lab, robots: Mapping[str, BelievedRobot], goal: str, failure: Failure
) -> BranchRun:
    """Let robots move what stands beside the thing, to a place of which the goal does not speak."""
    origin, item = failure.origin, failure.tried.thing
    beside = sorted(other for other, at in lab.where.items() if at == origin and other != item)
    within = {place for places in lab.reach.values() if origin in places for place in places}
    load = Counter(lab.where.values())
    nobody = BranchRun(refusal="no robot can move what stands beside it")
    for place in sorted(within - {origin}, key=lambda each: (load[each], each))[:_MAX_PLACES]:
        if place in goal:
            continue
        goals = [{"achieve": f"<{other}> rt:locatedOn <{place}>"} for other in beside]
        moved = _carry_out(planner, robots, json.dumps({"goals": goals}), [])
        if moved.steps:
            return moved
    return nobody


def _carry_out(
    planner: Any, robots: Mapping[str, BelievedRobot], goal: str, picked: list[bool]
) -> BranchRun:
    """Plan a goal by the ordinary planner, and let the ordinary executors carry it out once."""
    plan = planner.call("plan_goal", goal=goal)
    steps = tuple(step["text"] for step in plan["steps"])
    if not plan["complete"]:
        # What would mend the supposition is no advice: it is cut off.
        reasons = "; ".join(refusal["text"].split(";")[0] for refusal in plan["refusals"])
        return BranchRun(refusal=f"there is no plan: {reasons or 'no order of steps does it'}")
    if not steps:
        return BranchRun(refusal="nothing is left to do: the goal holds already")
    stored = planner.call("store_plan", goal=goal, digest=plan["digest"])
    executors = [Executor(planner, robot, iri) for iri, robot in robots.items()]
    for _ in range(_MAX_ROUNDS):
        turns = [executor.turn() for executor in executors]
        failed = next((turn for turn in turns if turn.result not in ("done", "idle")), None)
        if failed is not None:
            comment = f"{failed.text}: {failed.comment}"
            return BranchRun(False, steps, comment, any(picked))
        if all(turn.result == "idle" for turn in turns):
            break
    state = _state(planner, stored["task"])
    # Judged by what the graph says, as any plan is: each step has ended, and the goal holds.
    if state == "done" and not planner.call("plan_goal", goal=goal)["steps"]:
        return BranchRun(True, steps, "", any(picked))
    return BranchRun(False, steps, f"the plan stays {state}", any(picked))


def _state(planner: Any, task: str) -> str:
    plans = planner.call("list_plans", state="all")["plans"]
    return next(str(plan["state"]) for plan in plans if plan["task"] == task)
