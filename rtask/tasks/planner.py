"""From a goal to a plan: what the graph knows as a planning problem, its search and its reasons."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import ontology
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.tasks.actions import ActionClass, IsOntology, Select, read_actions
from rtask.tasks.facts import last_seen, own_places, read_facts
from rtask.tasks.goals import (
    LOCATED,
    Aim,
    Target,
    goal_text,
    read_aims,
    settled_goal,
    targets,
)
from rtask.tasks.language.reader import read_goal
from rtask.tasks.limits import Limits, read_limits
from rtask.tasks.names import names_of
from rtask.tasks.outcomes import Experience, read_experience
from rtask.tasks.plan import Refusal, TaskPlan
from rtask.tasks.planning.mutexes import CrowdedGoal, crowded_goals
from rtask.tasks.planning.pddl import write_pddl
from rtask.tasks.planning.problem import Action, Atom, Goal, Parameter, Problem, Step
from rtask.tasks.planning.restricting import limits_in_words, objects_within, or_without_limits
from rtask.tasks.planning.search import find_plan, goal_costs
from rtask.tasks.planning.unsolvable import Obstacle, explain_unsolvable
from rtask.tasks.queue.reading import claimed_things
from rtask.tasks.reasons import crowded, refusal
from rtask.tasks.steps import Wording, planned_steps, with_ages

__all__ = ["ASSUMABLE", "plan_goal"]

ASSUMABLE = ontology.NS + "reaches"
"""Property whose statements a plan may assume where nobody has made them."""
_MAX_REFUSALS = 5
_ASSUMED_COST = 1.0


@dataclass(frozen=True)
class _Task:
    """A goal with all that is known about it."""

    actions: tuple[ActionClass, ...]
    aims: tuple[Aim, ...]
    targets: tuple[Target, ...]
    problem: Problem
    experience: Experience
    mendable: Mapping[str, float]
    remarks: tuple[str, ...]
    deadline: dt.datetime | None
    settled: str
    limits: Limits
    everything: Mapping[str, tuple[str, ...]]
    """The objects with those that the limits of the goal leave out; empty where there are none."""


@dataclass(frozen=True)
class _Sequence:
    """Steps of a plan, and the number of the last one of each stage."""

    steps: tuple[Step, ...]
    ends: tuple[int, ...]


def plan_goal(
    select: Select,
    is_ontology: IsOntology,
    given: str | Mapping[str, Any],
    *,
    base: str = "",
    assume_reach: bool = False,
    max_states: int = 200_000,
    require_time: Callable[[], None] = lambda: None,
) -> TaskPlan:
    """Return a plan for a goal in words, as a pattern or as JSON; see :mod:`rtask.tasks.goals`.

    Parameters
    ----------
    select
        Evaluates the queries, with the rights and within the bounds of whoever asks.
    is_ontology
        Whether a named graph holds an ontology: actions are read from these alone.
    base
        What ``kb:`` stands for.
    assume_reach
        Plan as if robots reached places of which that is not known, and say so.
    max_states
        Bound of the search.
    require_time
        Called often; raises once the time is up.

    Raises
    ------
    UsageError, UnknownTermError
        The goal is not understood; the message says what was, and the nearest names.
    DataError
        An action is described in a way that cannot be read.
    SearchLimit
        A bound was reached: whether there is a plan is not known.
    """
    task = _read(select, is_ontology, given, base)
    workers = frozenset(robot for robot, _ in _robots(task))
    problem, assumed = replace(task.problem, workers=workers), tuple[Atom, ...]()
    obstacles = explain_unsolvable(problem, task.mendable, require_time)
    if obstacles and assume_reach:
        problem, assumed = _with_assumptions(task, problem, require_time)
        obstacles = explain_unsolvable(problem, task.mendable, require_time)
    problem = _chosen(select, task, problem)
    # The goals are fewer now: what stood in the way of the others does not matter any more.
    if any(t.aim.number is not None or t.aim.others for t in task.targets):
        obstacles = explain_unsolvable(problem, task.mendable, require_time)
    # A plan for what is possible is worth more than none; what is left out is told as refused.
    possible = _without(problem, obstacles)
    left_over = crowded_goals(possible, require_time)
    possible = _without(possible, left_over)
    solution = None
    if possible.goals:
        solution = _search(task, possible, max_states, require_time)
    elif not problem.goals:
        solution = _Sequence((), ())  # what was asked for hangs on what does not hold
    return _result(select, given, task, problem, (*obstacles, *left_over), solution, assumed)


def _without(problem: Problem, obstacles: Sequence[Obstacle | CrowdedGoal]) -> Problem:
    """Return a problem without the goals that are out of reach, or find no room."""
    refused = {obstacle.goal for obstacle in obstacles}
    return replace(problem, goals=tuple(goal for goal in problem.goals if goal not in refused))


def _search(
    task: _Task, problem: Problem, max_states: int, require_time: Callable[[], None]
) -> _Sequence | None:
    """Return the steps to all goals, stage after stage; None where there is no plan."""
    stages: dict[Goal, int] = {}
    for target in task.targets:
        stages.setdefault(target.goal, target.aim.stage)
    facts, steps, ends = set(problem.facts), list[Step](), list[int]()
    for stage in sorted({stages[goal] for goal in problem.goals}):
        # What an earlier stage has reached is to hold at the end of this one as well.
        goals = tuple(goal for goal in problem.goals if stages[goal] <= stage)
        plan = find_plan(
            replace(problem, facts=frozenset(facts), goals=goals), max_states=max_states,
            require_time=require_time,
        )  # fmt: skip
        if plan is None:
            return None
        for step in plan.steps:
            facts.difference_update(step.deletes)
            facts.update(step.adds)
        steps += plan.steps
        ends.append(len(steps))
    return _Sequence(tuple(steps), tuple(ends))


def _read(
    select: Select, is_ontology: IsOntology, given: str | Mapping[str, Any], base: str
) -> _Task:
    actions = read_actions(select, is_ontology)
    aims = read_aims(given)
    remarks, deadline = tuple[str, ...](), None
    is_words, limits = aims is None, Limits() if aims is None else read_limits(given)
    if aims is None:
        understood = read_goal(select, str(given), base)
        aims, remarks, deadline = understood.aims, understood.remarks, understood.deadline
        limits = understood.limits
    limits = limits.current(select)
    patterns, all_targets = [], list[Target]()
    for aim in aims:
        pattern, of_aim = targets(select, aim)
        if not of_aim:
            how = "" if is_words else f". It was sought by {aim.sparql or aim.pattern}"
            raise UnknownTermError(
                f"nothing in the graph fits the goal {aim.text!r}; that does not mean that there "
                f"is none{how}"
            )
        patterns.append(pattern)
        all_targets += of_aim
    mentioned = {value for item in all_targets for atom in item.goal for value in atom[1:]}
    facts = read_facts(select, actions, patterns, mentioned | set(limits.by))
    objects = objects_within(actions, facts.objects, limits)
    remarks = (*remarks, *limits_in_words(select, limits))
    experience = read_experience(select, actions)
    problem = Problem(
        objects,
        tuple(_action(action, experience) for action in actions),
        facts.atoms,
        tuple(dict.fromkeys(item.goal for item in all_targets)),
        likelier=frozenset(_likelier(select, actions, objects)),
    )
    text = goal_text(given)
    settled = (
        settled_goal(text, all_targets, aims, limits) if is_words else _as_settled(given, text)
    )
    return _Task(
        actions, aims, tuple(all_targets), problem, experience, _mendable(select, actions),
        remarks, deadline, settled, limits, facts.objects if limits else {},
    )  # fmt: skip


def _as_settled(given: str | Mapping[str, Any], text: str) -> str:
    """Return JSON that was made of words, so that it is planned again from that; else nothing."""
    as_json = given if isinstance(given, str) else json.dumps(dict(given))
    return as_json if text != as_json else ""


def _action(action: ActionClass, experience: Experience) -> Action:
    def atoms(patterns: Sequence[Any]) -> tuple[Atom, ...]:
        return tuple((pattern.predicate, *pattern.arguments) for pattern in patterns)

    return Action(
        action.iri, tuple(Parameter(name, kind) for name, kind in action.parameters),
        atoms(action.preconditions), atoms(action.additions), atoms(action.removals),
        experience.estimate(action),
    )  # fmt: skip


def _mendable(select: Select, actions: Sequence[ActionClass]) -> dict[str, float]:
    """Return the predicates whose facts could be made true, and how dear that is."""
    rows = select(f"{PREFIXES}SELECT ?property ?cost WHERE {{ ?property rt:mendingCost ?cost }}")
    costs = {str(row.value("property")): float(str(row.value("cost"))) for row in rows}
    return {
        pattern.predicate: costs[iri]
        for action in actions
        for pattern in action.preconditions
        for iri in pattern.properties & costs.keys()
    }


def _likelier(
    select: Select, actions: Sequence[ActionClass], objects: Mapping[str, tuple[str, ...]]
) -> Iterator[Atom]:
    """Yield that robots reach what they described: that is at hand, others' tables may be far."""
    patterns = {
        pattern.predicate: tuple(dict(action.parameters)[name] for name in pattern.arguments)
        for action in actions
        for pattern in action.preconditions
        if ASSUMABLE in pattern.properties and len(pattern.arguments) == 2
    }
    for predicate, (robots, places) in patterns.items():
        for pair in own_places(select, objects.get(robots, ()), objects.get(places, ())):
            yield predicate, *pair


def _with_assumptions(
    task: _Task, problem: Problem, require_time: Callable[[], None]
) -> tuple[Problem, tuple[Atom, ...]]:
    """Return a problem in which robots reach what they must, and what was assumed for that."""
    permitted = {
        pattern.predicate: _ASSUMED_COST
        for action in task.actions
        for pattern in action.preconditions
        if ASSUMABLE in pattern.properties
    }
    obstacles = explain_unsolvable(problem, permitted, require_time)
    missing = {atom for obstacle in obstacles for atom in obstacle.missing}
    return replace(problem, facts=problem.facts | missing), tuple(sorted(missing))


def _chosen(select: Select, task: _Task, problem: Problem) -> Problem:
    """Return a problem with the goals of those things that are cheapest, where a number is given.

    Things that are there already cost nothing, and out of reach are the last to be chosen.
    """
    if all(target.aim.number is None and not target.aim.others for target in task.targets):
        _require_one_place(select, task.targets)
        return problem
    costs = dict(zip(problem.goals, goal_costs(problem), strict=True))
    chosen: list[Target] = []
    by_aim: dict[Aim, list[Target]] = {}
    for target in task.targets:
        by_aim.setdefault(target.aim, []).append(target)
    for aim, of_aim in sorted(by_aim.items(), key=lambda item: _rank(item[0], item[1])):
        if aim.number is not None:
            if len(of_aim) < aim.number:
                raise UnknownTermError(
                    f"the goal {aim.text!r} needs {aim.number} things, and the graph knows of "
                    f"{len(of_aim)}"
                )
            # What another goal wants elsewhere comes last: one thing is not at two places.
            of_aim = sorted(of_aim, key=lambda target: (_is_wanted(target, chosen),
                                                        _cost_of(costs[target.goal])))  # fmt: skip
            of_aim = of_aim[: aim.number]
        if aim.others:
            taken = {target.subject for target in chosen}
            of_aim = [target for target in of_aim if target.subject not in taken]
        chosen += of_aim
    _require_one_place(select, chosen)
    order = {goal: at for at, goal in enumerate(problem.goals)}
    goals = sorted({target.goal for target in chosen}, key=lambda goal: order[goal])
    return replace(problem, goals=tuple(goals))


def _rank(aim: Aim, of_aim: Sequence[Target]) -> tuple[bool, bool, int]:
    """Return what puts the goals first that have the least choice among things."""
    return aim.others, aim.number is not None, len(of_aim) - (aim.number or 0)


def _cost_of(cost: float | None) -> float:
    return float("inf") if cost is None else cost


def _is_wanted(target: Target, others: Sequence[Target]) -> bool:
    """Tell whether another goal wants a thing at other places."""
    return any(
        other.subject == target.subject and other.aim.pattern == target.aim.pattern == LOCATED
        and not set(other.goal) & set(target.goal)
        for other in others
    )  # fmt: skip


def _require_one_place(select: Select, chosen: Sequence[Target]) -> None:
    """Refuse goals that exclude each other, which the search would find out only at its bound.

    Raises
    ------
    UsageError
        One thing is to be at two places in the end.
    """
    by_subject: dict[str, list[Target]] = {}
    for target in chosen:
        same = by_subject.setdefault(target.subject, [])
        for other in same:
            if _is_wanted(target, [other]):
                # Of two red cups, each is told by what differs in its IRI.
                names = names_of(select, [item.subject for item in chosen])
                raise UsageError(
                    f"{other.aim.text!r} and {target.aim.text!r} cannot both hold in the end: "
                    f"{names[target.subject]} would have to be at two places; what is reached "
                    "first is to stay so, also in a goal with 'then'"
                )
        same.append(target)


def _result(
    select: Select,
    given: str | Mapping[str, Any],
    task: _Task,
    problem: Problem,
    obstacles: Sequence[Obstacle | CrowdedGoal],
    solution: _Sequence | None,
    assumed: tuple[Atom, ...],
) -> TaskPlan:
    steps = () if solution is None else solution.steps
    robots = _robots(task)
    # All have names, so that those of a plan and of its reasons are told apart from all others.
    members = {value for values in problem.objects.values() for value in values}
    names = names_of(select, members | {v for goal in problem.goals for a in goal for v in a[1:]})
    wording = Wording(names, _property_labels(select, task))
    pddl = write_pddl(problem)
    refusals: list[Refusal] = []
    for obstacle in obstacles[:_MAX_REFUSALS]:
        if isinstance(obstacle, CrowdedGoal):
            refusals.append(crowded(obstacle, wording))
        else:
            lack = refusal(select, problem, obstacle, task.mendable, robots, wording)
            refusals.append(
                or_without_limits(task.limits, task.everything, problem, lack, obstacle, wording)
            )
    if len(obstacles) > _MAX_REFUSALS:
        goal = f"{len(obstacles) - _MAX_REFUSALS} more goals"
        refusals.append(Refusal(goal, "out of reach, too; ask for each alone to see why", (), {}))
    ends = () if solution is None else solution.ends
    planned = planned_steps(
        task.actions, problem, steps, task.experience, assumed, wording, ends
    )  # fmt: skip
    now = dt.datetime.now(dt.UTC)
    return TaskPlan(
        goal=goal_text(given),
        understood=(
            *(aim.text for aim in task.aims),
            *task.remarks,
            *_claimed(select, task, steps, names),
        ),
        sparql=tuple(aim.sparql for aim in task.aims if aim.variables),
        steps=with_ages(planned, last_seen(select, _handled(task, steps)), now),
        refusals=tuple(refusals),
        assumptions=tuple(wording.atom(atom) for atom in assumed) if solution is not None else (),
        names=_mentioned(names, problem, steps, refusals),
        is_complete=solution is not None and not obstacles,
        domain=pddl.domain,
        problem=pddl.problem,
        deadline=task.deadline,
        settled=task.settled,
        allows_takeover=not (task.limits.by or task.limits.not_by),
    )


def _claimed(
    select: Select, task: _Task, steps: Sequence[Step], names: Mapping[str, str]
) -> Iterator[str]:
    """Yield which things of a plan a robot has for another one now: its steps wait for that."""
    things = _handled(task, steps)
    for thing, claim in claimed_things(select, things, dt.datetime.now(dt.UTC)).items():
        who = names.get(claim.robot) or local_name(claim.robot)
        yield (
            f"{who} has {names.get(thing, thing)} for another step now: steps with it begin after "
            f"that, at {claim.until:%H:%M} UTC at the latest unless {who} asks for more time"
        )


def _handled(task: _Task, steps: Sequence[Step]) -> set[str]:
    """Return the things that steps are about."""
    handled = {action.iri: action.parameter("handlesExemplar") for action in task.actions}
    return {
        value for step in steps for name, value in step.arguments if name == handled[step.action]
    }


def _mentioned(
    names: Mapping[str, str], problem: Problem, steps: Sequence[Step], refusals: Sequence[Refusal]
) -> dict[str, str]:
    """Return the names of what a plan mentions."""
    iris = {value for step in steps for _, value in step.arguments}
    iris |= {value for goal in problem.goals for atom in goal for value in atom[1:]}
    iris |= {part for item in refusals for statement in item.missing for part in statement}
    iris |= {robot for item in refusals for robot in item.by_robot}
    return {iri: names[iri] for iri in sorted(iris) if iri in names}


def _robots(task: _Task) -> tuple[tuple[str, str], ...]:
    """Return the class of those who do tasks, and each of them."""
    kinds = {
        dict(action.parameters)[action.parameter("assignedTo")]
        for action in task.actions
        if action.parameter("assignedTo")
    }
    return tuple((robot, kind) for kind in sorted(kinds)
                 for robot in task.problem.objects.get(kind, ()))  # fmt: skip


def _property_labels(select: Select, task: _Task) -> dict[str, str]:
    """Return the labels of the properties in the patterns of actions."""
    iris = {
        iri
        for action in task.actions
        for pattern in (*action.preconditions, *action.additions, *action.removals)
        for iri in pattern.properties
    }
    labels = names_of(select, iris)
    return {iri: labels.get(iri, local_name(iri)) for iri in iris}
