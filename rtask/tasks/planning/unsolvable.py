"""Why a goal is out of reach, and which facts would mend it."""

from __future__ import annotations

import heapq
import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rtask.rdf.namespaces import RT
from rtask.tasks.planning.grounding import bindings, ground, instantiate, unchanging_facts
from rtask.tasks.planning.problem import Action, Atom, Goal, Parameter, Problem, Step

__all__ = ["Obstacle", "explain_unsolvable"]

_MAX_OBJECTS = 40
"""A parameter with more objects is narrowed to those that the goal names, to bound the search."""

_LIKELIER = 0.9
"""Cost of a likelier fact, as a share of that of others: it decides between remedies as dear."""


@dataclass(frozen=True)
class Obstacle:
    """A goal that no plan reaches: the fewest facts under which it could be reached."""

    goal: Goal
    missing: tuple[Atom, ...]
    """Facts to make true; empty if no facts of the given predicates would help."""

    steps: tuple[Step, ...]
    """Steps that would become possible, of which each lacks a missing fact."""


def explain_unsolvable(
    problem: Problem,
    mendable: Mapping[str, float],
    require_time: Callable[[], None] = lambda: None,
) -> tuple[Obstacle, ...]:
    """Return the goals that are out of reach even if nothing were ever deleted.

    Parameters
    ----------
    mendable
        Predicates whose facts could be made true, and how dear one such fact is: a capability, a
        reach, an opening. Facts that steps change are never assumed.
    require_time
        Called before each goal; raises once the time is up.
    """
    reachable, obstacles = _reachable(problem), []
    for goal in problem.goals:
        require_time()
        if reachable.isdisjoint(goal):
            obstacles.append(_obstacle(problem, goal, mendable))
    return tuple(obstacles)


def _reachable(problem: Problem) -> set[Atom]:
    steps = ground(problem)
    fluents = problem.fluents
    users: dict[Atom, list[int]] = defaultdict(list)
    missing, pending = [], list(problem.facts)
    for number, step in enumerate(steps):
        needs = {atom for atom in step.preconditions if atom[0] in fluents}
        missing.append(len(needs))
        for atom in needs:
            users[atom].append(number)
        if not needs:
            pending += step.adds
    reached: set[Atom] = set()
    while pending:
        fact = pending.pop()
        if fact in reached:
            continue
        reached.add(fact)
        for number in users.get(fact, ()):
            missing[number] -= 1
            if not missing[number]:
                pending += steps[number].adds
    return reached


def _obstacle(problem: Problem, goal: Goal, mendable: Mapping[str, float]) -> Obstacle:
    steps = list(_candidates(problem, goal, mendable))
    users: dict[Atom, list[int]] = defaultdict(list)
    missing, sums = [], []
    for number, step in enumerate(steps):
        needs = set(step.preconditions)
        missing.append(len(needs))
        sums.append(1e-6)
        for atom in needs:
            users[atom].append(number)
    order = itertools.count()
    queue: list[tuple[float, int, Atom, int]] = [
        (0.0, next(order), fact, -1) for fact in sorted(problem.facts)
    ]
    hands = frozenset(problem.objects.get(RT.EndEffector.value, ()))
    for atom in sorted(users):
        # A hand is no place to put things into: no statement that a robot reaches it would help.
        is_reach = str(RT.reaches) in atom[0] and atom[-1] in hands
        if atom[0] in mendable and atom not in problem.facts and not is_reach:
            share = _LIKELIER if atom in problem.likelier else 1.0
            queue.append((share * mendable[atom[0]], next(order), atom, -1))
    heapq.heapify(queue)
    causes: dict[Atom, int] = {}
    alternatives = frozenset(goal)
    while queue and alternatives.isdisjoint(causes):
        cost, _, fact, cause = heapq.heappop(queue)
        if fact in causes:
            continue
        causes[fact] = cause
        for number in users.get(fact, ()):
            missing[number] -= 1
            sums[number] += cost
            if not missing[number]:
                for added in steps[number].adds:
                    heapq.heappush(queue, (sums[number], next(order), added, number))
    return _read_off(problem, goal, steps, causes)


def _read_off(
    problem: Problem, goal: Goal, steps: Sequence[Step], causes: Mapping[Atom, int]
) -> Obstacle:
    reached = [atom for atom in goal if atom in causes]
    if not reached:
        return Obstacle(goal, (), ())
    pending, seen, lacking = reached[:1], set[Atom](), list[Atom]()
    while pending:
        fact = pending.pop()
        if fact in seen or fact in problem.facts:
            continue
        seen.add(fact)
        if causes[fact] < 0:
            lacking.append(fact)
        else:
            pending += steps[causes[fact]].preconditions
    used = {causes[fact] for fact in seen if causes[fact] >= 0}
    enabled = tuple(
        steps[number] for number in sorted(used) if set(lacking) & set(steps[number].preconditions)
    )
    return Obstacle(goal, tuple(sorted(lacking)), enabled)


def _candidates(problem: Problem, goal: Goal, mendable: Mapping[str, float]) -> Iterator[Step]:
    """Yield steps whose unchanging preconditions hold or could be made to hold."""
    fluents, named = problem.fluents, {name for atom in goal for name in atom[1:]}
    facts = unchanging_facts(problem)
    for action in problem.actions:
        mentioned = _mentioned(problem, action)
        objects = {}
        for parameter in action.parameters:
            members = problem.objects.get(parameter.type, ())
            # An object that no fact mentions in this place, and no goal, can be of no use there.
            useful = [m for m in members if m in mentioned[parameter.name] or m in named]
            narrow = [m for m in useful if m in named]
            objects[parameter.name] = useful if len(useful) <= _MAX_OBJECTS else narrow or useful
        renamed = replace(
            action, parameters=tuple(Parameter(p.name, p.name) for p in action.parameters)
        )
        conditions = [
            atom
            for atom in action.preconditions
            if atom[0] not in fluents and atom[0] not in mendable
        ]
        for arguments in bindings(objects, renamed, conditions, facts):
            yield instantiate(action, arguments)


def _mentioned(problem: Problem, action: Action) -> dict[str, set[str]]:
    """Return the objects that facts mention where an action has each of its parameters."""
    by_place: dict[tuple[str, int], set[str]] = defaultdict(set)
    for fact in problem.facts:
        for place, value in enumerate(fact[1:]):
            by_place[fact[0], place].add(value)
    mentioned: dict[str, set[str]] = {parameter.name: set() for parameter in action.parameters}
    for atom in (*action.preconditions, *action.adds):
        for place, name in enumerate(atom[1:]):
            mentioned[name] |= by_place.get((atom[0], place), set())
    return mentioned
