"""Steps that are possible at all: actions joined with the facts that no action changes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from rtask.errors import TooLargeError
from rtask.tasks.planning.problem import Action, Atom, Problem, Step

__all__ = ["MAX_STEPS", "bindings", "ground", "instantiate", "unchanging_facts"]

MAX_STEPS = 500_000
"""Most steps of one action that are possible at all."""


def ground(problem: Problem) -> tuple[Step, ...]:
    """Return the steps whose unchanging preconditions hold, in a fixed order."""
    fluents = problem.fluents
    facts = unchanging_facts(problem)
    steps = []
    for action in problem.actions:
        # What no action changes is decided once, before the search multiplies by it.
        conditions = [atom for atom in action.preconditions if atom[0] not in fluents]
        for arguments in bindings(problem.objects, action, conditions, facts):
            steps.append(instantiate(action, arguments))
    return tuple(steps)


def unchanging_facts(problem: Problem) -> dict[str, list[Atom]]:
    """Return the facts that no action changes, by predicate, in a fixed order."""
    fluents = problem.fluents
    facts: dict[str, list[Atom]] = defaultdict(list)
    for fact in sorted(problem.facts):
        if fact[0] not in fluents:
            facts[fact[0]].append(fact)
    return facts


def instantiate(action: Action, arguments: Mapping[str, str]) -> Step:
    """Return an action with its parameters filled in."""

    def fill(atoms: Sequence[Atom]) -> tuple[Atom, ...]:
        return tuple((atom[0], *(arguments[name] for name in atom[1:])) for atom in atoms)

    duration_s, chance = action.estimate(arguments)
    return Step(
        action.name,
        tuple((parameter.name, arguments[parameter.name]) for parameter in action.parameters),
        fill(action.preconditions), fill(action.adds), fill(action.deletes), duration_s, chance,
    )  # fmt: skip


def bindings(
    objects: Mapping[str, Sequence[str]], action: Action, conditions: Sequence[Atom],
    facts: Mapping[str, Sequence[Atom]],
) -> Iterator[dict[str, str]]:  # fmt: skip
    """Yield the arguments of an action under which conditions hold, objects of the right types.

    Raises
    ------
    TooLargeError
        There are more than :data:`MAX_STEPS`.
    """
    types = {parameter.name: set(objects.get(parameter.type, ()))
             for parameter in action.parameters}  # fmt: skip
    rows: list[dict[str, str]] = [{}]
    for condition in conditions:
        # Asked after each join: the product of all would be too large to be counted afterwards.
        rows = _join(rows, condition, facts.get(condition[0], ()), types)
        _require_few(action, rows)
    for parameter in action.parameters:
        rows = [
            row if parameter.name in row else {**row, parameter.name: value}
            for row in rows
            for value in (("",) if parameter.name in row else objects.get(parameter.type, ()))
        ]
        _require_few(action, rows)
    yield from rows


def _require_few(action: Action, rows: Sequence[dict[str, str]]) -> None:
    if len(rows) > MAX_STEPS:
        raise TooLargeError(f"more than {MAX_STEPS} steps of {action.name} are possible")


def _join(
    rows: Sequence[dict[str, str]], condition: Atom, facts: Sequence[Atom],
    types: Mapping[str, set[str]],
) -> list[dict[str, str]]:  # fmt: skip
    if not rows:
        return []
    names = condition[1:]
    bound = [place for place, name in enumerate(names) if name in rows[0]]
    # Indexed by what is bound already, so that a join costs what it yields.
    by_key: dict[tuple[str, ...], list[Atom]] = defaultdict(list)
    for fact in facts:
        values = fact[1:]
        if len(values) == len(names) and all(
            value in types[name] for name, value in zip(names, values, strict=True)
        ):
            by_key[tuple(values[place] for place in bound)].append(values)
    joined = []
    for row in rows:
        for values in by_key.get(tuple(row[names[place]] for place in bound), ()):
            merged = dict(row)
            # A parameter may stand twice in one condition.
            if all(merged.setdefault(n, v) == v for n, v in zip(names, values, strict=True)):
                joined.append(merged)
    return joined
