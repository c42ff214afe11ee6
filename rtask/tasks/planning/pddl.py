"""Problems as PDDL, and plans of other planners read back and checked.

PDDL 2.1 with types and action costs (Fox and Long 2003), the costs in whole milliseconds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rtask.tasks.planning.grounding import ground
from rtask.tasks.planning.problem import Action, Atom, Goal, Problem, Step

__all__ = ["PddlProblem", "write_pddl"]

_MAX_PLAN_CHARS = 4_000_000
_RESERVED = (
    "object", "number", "total-cost", "and", "or", "not", "imply", "forall", "exists", "when",
    "either", "increase", "assign", "define",
)  # fmt: skip


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
    # In this order, as what comes later gives way: plans are made of actions and objects.
    for action in problem.actions:
        names.of("action", action.name)
    for members in problem.objects.values():
        for member in members:
            names.of("object", member)
    steps = ground(problem)
    has_choice = any(len(goal) > 1 for goal in problem.goals)
    kinds = _kinds(problem.objects, names)
    domain = _domain(problem, names, kinds, " :disjunctive-preconditions" if has_choice else "")
    keys = {
        " ".join(
            (names.of("action", step.action), *(names.of("object", v) for _, v in step.arguments))
        ): step
        for step in steps
    }
    return PddlProblem(domain, _problem(problem, names, kinds, keys), keys, problem)


class _Names:
    """PDDL names of IRIs and words, unique whatever the case of letters.

    They are unique across kinds, too: PDDL keeps types, predicates and actions apart, but readers
    such as that of unified-planning do not. Parameters are known within their action alone.
    """

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], str] = {}
        self._taken: set[tuple[str, str]] = {("", word) for word in _RESERVED}

    def of(self, kind: str, name: str) -> str:
        if (kind, name) not in self._names:
            # The end of an IRI tells more than its beginning, which all share.
            word = re.sub(r"[^a-z0-9_]+", "-", name.lower()).strip("-")[-60:].strip("-")
            base = unique = word if word[:1].isalpha() else f"{kind[0]}-{word}"
            scope = kind if kind == "parameter" else ""
            number = 1
            while (scope, unique) in self._taken or (scope, f"{unique}-cost") in self._taken:
                number += 1
                unique = f"{base}-{number}"
            self._taken.add((scope, unique))
            if kind == "action":
                self._taken.add((scope, f"{unique}-cost"))  # its cost is a function of this name
            self._names[kind, name] = unique
        return self._names[kind, name]

    def atom(self, atom: Atom, kind: str = "object") -> str:
        """Return an atom over objects, or over the parameters of an action."""
        mark = "?" if kind == "parameter" else ""
        arguments = (f"{mark}{self.of(kind, value)}" for value in atom[1:])
        return f"({' '.join((self.of('predicate', atom[0]), *arguments))})"


@dataclass(frozen=True)
class _Kinds:
    """How the classes of objects are written.

    A PDDL object is declared once, with one type. Classes of a graph overlap: a hand is an object
    as well, and whatever can be put down may be a place. So a class becomes a type only if it
    shares no member with those that are types already, and a static predicate otherwise.
    """

    types: Mapping[str, str]
    """PDDL names by class."""
    predicates: Mapping[str, str]
    type_of: Mapping[str, str]
    """PDDL type of each object."""
    facts: tuple[str, ...]

    def parameters(self, action: Action, names: _Names) -> str:
        """Return the parameters of an action with their types."""
        return " ".join(
            f"?{names.of('parameter', p.name)} - {self.types.get(p.type, 'object')}"
            for p in action.parameters
        )

    def conditions(self, action: Action, names: _Names) -> list[str]:
        """Return what the types of the parameters do not say."""
        return [
            f"({self.predicates[p.type]} ?{names.of('parameter', p.name)})"
            for p in action.parameters
            if p.type in self.predicates
        ]


def _kinds(objects: Mapping[str, tuple[str, ...]], names: _Names) -> _Kinds:
    types: dict[str, str] = {}
    predicates: dict[str, str] = {}
    type_of: dict[str, str] = {}
    facts: list[str] = []
    # Narrow classes first: the one above them all, of which all would be members, is the predicate.
    for kind in sorted(objects, key=lambda kind: len(objects[kind])):
        if type_of.keys().isdisjoint(objects[kind]):
            types[kind] = names.of("type", kind)
            type_of.update(dict.fromkeys(objects[kind], types[kind]))
        else:
            predicates[kind] = name = names.of("predicate", f"a {kind}")
            facts += [f"({name} {names.of('object', member)})" for member in objects[kind]]
    everything = {member for members in objects.values() for member in members}
    return _Kinds(
        types, predicates, dict.fromkeys(everything, "object") | type_of, tuple(sorted(facts))
    )


def _domain(problem: Problem, names: _Names, kinds: _Kinds, more: str) -> str:
    types = " ".join(kinds.types.values())
    predicates = [f"({name} ?x0)" for name in kinds.predicates.values()]
    predicates += _predicates(problem, names)
    costs = [
        f"({names.of('action', action.name)}-cost{_before(kinds.parameters(action, names))})"
        " - number"
        for action in problem.actions
    ]
    actions = "".join(_action(action, names, kinds) for action in problem.actions)
    return (
        f"(define (domain rtask)\n  (:requirements :strips :typing :action-costs{more})\n"
        f"  (:types {types} - object)\n  (:predicates{_lines(predicates)})\n"
        f"  (:functions (total-cost) - number{_lines(costs)}){actions})\n"
    )


def _before(text: str) -> str:
    return f" {text}" if text else ""


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


def _action(action: Action, names: _Names, kinds: _Kinds) -> str:
    name = names.of("action", action.name)
    arguments = "".join(f" ?{names.of('parameter', p.name)}" for p in action.parameters)
    atoms = [names.atom(atom, "parameter") for atom in action.preconditions]
    conditions = " ".join((*kinds.conditions(action, names), *atoms))
    effects = [names.atom(atom, "parameter") for atom in action.adds]
    effects += [f"(not {names.atom(atom, 'parameter')})" for atom in action.deletes]
    return (
        f"\n  (:action {name}\n    :parameters ({kinds.parameters(action, names)})\n"
        f"    :precondition (and {conditions})\n"
        f"    :effect (and {' '.join(effects)} (increase (total-cost) ({name}-cost{arguments}))))"
    )


def _problem(problem: Problem, names: _Names, kinds: _Kinds, steps: dict[str, Step]) -> str:
    members = dict.fromkeys(member for kind in problem.objects.values() for member in kind)
    objects = _lines(f"{names.of('object', item)} - {kinds.type_of[item]}" for item in members)
    facts = _lines((*kinds.facts, *(names.atom(fact) for fact in sorted(problem.facts))))
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
