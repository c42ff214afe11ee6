"""Why a goal is out of reach, and which facts would mend it."""

from __future__ import annotations

import heapq
import itertools
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rtask.tasks.planning.grounding import ground, instantiate
from rtask.tasks.planning.problem import Action, Atom, Problem, Step

__all__ = ["Obstacle", "explain_unsolvable"]

_MAX_OBJECTS = 50
"""Types with more objects are narrowed to those that the goal names, to bound the search."""


@dataclass(frozen=True)
class Obstacle:
    """A goal that no plan reaches: the fewest facts under which it could be reached."""

    goal: Atom
    missing: tuple[Atom, ...]
    """Facts to make true; empty if no facts of the given predicates would help."""

    steps: tuple[Step, ...]
    """Steps that would become possible, of which each lacks a missing fact."""


def explain_unsolvable(problem: Problem, mendable: Mapping[str, float]) -> tuple[Obstacle, ...]:
    """Return the goals that are out of reach even if nothing were ever deleted.

    Parameters
    ----------
    mendable
        Predicates whose facts could be made true, and how dear one such fact is: a capability, a
        reach, an opening. Facts that steps change are never assumed.
    """
    reachable = _reachable(problem)
    return tuple(
        _obstacle(problem, goal, mendable) for goal in problem.goals if goal not in reachable
    )


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


def _obstacle(problem: Problem, goal: Atom, mendable: Mapping[str, float]) -> Obstacle:
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
    for atom in sorted(users):
        if atom[0] in mendable and atom not in problem.facts:
            queue.append((mendable[atom[0]], next(order), atom, -1))
    heapq.heapify(queue)
    causes: dict[Atom, int] = {}
    while queue and goal not in causes:
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
    problem: Problem, goal: Atom, steps: Sequence[Step], causes: Mapping[Atom, int]
) -> Obstacle:
    if goal not in causes:
        return Obstacle(goal, (), ())
    pending, seen, lacking = [goal], set[Atom](), list[Atom]()
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


def _candidates(problem: Problem, goal: Atom, mendable: Mapping[str, float]) -> Iterator[Step]:
    """Yield steps whose unchanging preconditions hold or could be made to hold."""
    fluents, named = problem.fluents, set(goal[1:])
    objects = {
        kind: members if len(members) <= _MAX_OBJECTS else tuple(m for m in members if m in named)
        for kind, members in problem.objects.items()
    }
    for action in problem.actions:
        for arguments in _bindings(action, objects):
            step = instantiate(action, arguments)
            if all(
                atom[0] in fluents or atom[0] in mendable or atom in problem.facts
                for atom in step.preconditions
            ):
                yield step


def _bindings(action: Action, objects: Mapping[str, Sequence[str]]) -> Iterator[dict[str, str]]:
    domains = [objects.get(parameter.type, ()) for parameter in action.parameters]
    for values in itertools.product(*domains):
        names = (parameter.name for parameter in action.parameters)
        yield dict(zip(names, values, strict=True))
