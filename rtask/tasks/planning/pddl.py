"""Problems as PDDL, and plans of other planners read back and checked.

PDDL 2.1 with types and action costs (Fox and Long 2003), the costs in whole milliseconds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from rtask.tasks.planning.grounding import ground
from rtask.tasks.planning.problem import Action, Atom, Goal, Problem, Step

__all__ = ["PddlProblem", "write_pddl"]

_MAX_PLAN_CHARS = 4_000_000


@dataclass(frozen=True)
class PddlProblem:
    """A domain and a problem as text, and what is needed to read plans for them."""

    domain: str
    problem: str
    _steps: dict[str, Step]
    _source: Problem

    def read_plan(self, text: str) -> tuple[Step, ...]:
        """Return the steps of a plan: one ``(action argument ...)`` a line, ``;`` begins a comment.

        Raises
        ------
        ValueError
            A line is no step of the problem, a step is not possible when its turn comes, or the
            goal does not hold at the end.
        """
        if len(text) > _MAX_PLAN_CHARS:
            raise ValueError(f"the plan is longer than {_MAX_PLAN_CHARS} characters")
        facts, steps = set(self._source.facts), []
        for number, line in enumerate(text.splitlines(), 1):
            # PDDL takes no notice of case, and planners write what they like.
            words = line.partition(";")[0].strip().lower()
            if not words:
                continue
            step = self._steps.get(" ".join(words.strip("()").split()))
            if step is None:
                raise ValueError(f"line {number}: {words[:200]} is no step of the problem")
            lacking = [atom for atom in step.preconditions if atom not in facts]
            if lacking:
                raise ValueError(f"line {number}: {step} needs {_words(lacking[0])}")
            # Deletes first: what a step both deletes and adds holds after it (PDDL 2.1).
            facts = facts.difference(step.deletes).union(step.adds)
            steps.append(step)
        for goal in self._source.goals:
            if facts.isdisjoint(goal):
                raise ValueError(f"at the end of the plan {_words(goal[0])} does not hold")
        return tuple(steps)


def write_pddl(problem: Problem) -> PddlProblem:
    """Return a problem as PDDL text, with names that PDDL permits."""
    names = _Names()
    for members in problem.objects.values():
        for member in members:
            names.of("object", member)
    steps = ground(problem)
    has_choice = any(len(goal) > 1 for goal in problem.goals)
    domain = _domain(problem, names, " :disjunctive-preconditions" if has_choice else "")
    keys = {
        " ".join(
            (names.of("action", step.action), *(names.of("object", v) for _, v in step.arguments))
        ): step
        for step in steps
    }
    return PddlProblem(domain, _problem(problem, names, keys), keys, problem)


class _Names:
    """PDDL names of IRIs and words, unique within their kind whatever the case of letters."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], str] = {}
        self._taken: set[tuple[str, str]] = set()

    def of(self, kind: str, name: str) -> str:
        if (kind, name) not in self._names:
            # The end of an IRI tells more than its beginning, which all share.
            word = re.sub(r"[^a-z0-9_]+", "-", name.lower()).strip("-")[-60:].strip("-")
            base = unique = word if word[:1].isalpha() else f"{kind[0]}-{word}"
            number = 1
            while (kind, unique) in self._taken:
                number += 1
                unique = f"{base}-{number}"
            self._taken.add((kind, unique))
            self._names[kind, name] = unique
        return self._names[kind, name]

    def atom(self, atom: Atom, kind: str = "object") -> str:
        """Return an atom over objects, or over the parameters of an action."""
        mark = "?" if kind == "parameter" else ""
        arguments = (f"{mark}{self.of(kind, value)}" for value in atom[1:])
        return f"({' '.join((self.of('predicate', atom[0]), *arguments))})"


def _domain(problem: Problem, names: _Names, more: str) -> str:
    types = " ".join(names.of("type", kind) for kind in problem.objects)
    predicates = "".join(f"\n    {line}" for line in _predicates(problem, names))
    costs = "".join(
        f"\n    ({names.of('action', action.name)}-cost{_typed(action, names)}) - number"
        for action in problem.actions
    )
    actions = "".join(_action(action, names) for action in problem.actions)
    return (
        f"(define (domain rtask)\n  (:requirements :strips :typing :action-costs{more})\n"
        f"  (:types {types} - object)\n  (:predicates{predicates})\n"
        f"  (:functions (total-cost) - number{costs}){actions})\n"
    )


def _predicates(problem: Problem, names: _Names) -> list[str]:
    sizes: dict[str, int] = {}
    for action in problem.actions:
        for atom in (*action.preconditions, *action.adds, *action.deletes):
            sizes[atom[0]] = len(atom) - 1
    # Predicates that no action mentions have to be declared as well.
    for atom in (*sorted(problem.facts), *(atom for goal in problem.goals for atom in goal)):
        sizes.setdefault(atom[0], len(atom) - 1)
    return [
        f"({' '.join((names.of('predicate', name), *(f'?x{n}' for n in range(size))))})"
        for name, size in sizes.items()
    ]


def _typed(action: Action, names: _Names) -> str:
    return "".join(
        f" ?{names.of('parameter', p.name)} - {names.of('type', p.type)}" for p in action.parameters
    )


def _action(action: Action, names: _Names) -> str:
    name = names.of("action", action.name)
    arguments = "".join(f" ?{names.of('parameter', p.name)}" for p in action.parameters)
    conditions = " ".join(names.atom(atom, "parameter") for atom in action.preconditions)
    effects = [names.atom(atom, "parameter") for atom in action.adds]
    effects += [f"(not {names.atom(atom, 'parameter')})" for atom in action.deletes]
    return (
        f"\n  (:action {name}\n    :parameters ({_typed(action, names).strip()})\n"
        f"    :precondition (and {conditions})\n"
        f"    :effect (and {' '.join(effects)} (increase (total-cost) ({name}-cost{arguments}))))"
    )


def _problem(problem: Problem, names: _Names, steps: dict[str, Step]) -> str:
    objects = "".join(
        f"\n    {names.of('object', member)} - {names.of('type', kind)}"
        for kind, members in problem.objects.items()
        for member in members
    )
    facts = _lines(names.atom(fact) for fact in sorted(problem.facts))
    costs = _lines(
        f"(= ({key.replace(' ', '-cost ', 1) if ' ' in key else f'{key}-cost'}) "
        # Milliseconds: Fast Downward takes whole numbers only.
        f"{round(1000 * step.cost_s(problem.failure_cost_s))})"
        for key, step in steps.items()
    )
    goals = " ".join(_goal(goal, names) for goal in problem.goals)
    return (
        f"(define (problem rtask-problem) (:domain rtask)\n  (:objects{objects})\n"
        f"  (:init{facts}\n    (= (total-cost) 0){costs})\n"
        f"  (:goal (and {goals}))\n  (:metric minimize (total-cost)))\n"
    )


def _goal(goal: Goal, names: _Names) -> str:
    atoms = [names.atom(atom) for atom in goal]
    return atoms[0] if len(atoms) == 1 else f"(or {' '.join(atoms)})"


def _lines(texts: Iterable[str]) -> str:
    return "".join(f"\n    {text}" for text in texts)


def _words(atom: Atom) -> str:
    return f"{atom[0]}({', '.join(atom[1:])})"
