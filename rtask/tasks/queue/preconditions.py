"""Whether the preconditions of a stored step hold in the graph as it is now."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from rtask.rdf.terms import iri
from rtask.tasks.actions import ActionClass
from rtask.tasks.names import names_of
from rtask.tasks.patterns import Pattern
from rtask.tasks.planning.problem import Atom
from rtask.tasks.queue.reading import QueuedStep
from rtask.tasks.steps import Wording, statement_of

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["effects_of", "failing"]


def failing(
    kb: GraphCore, actions: Sequence[ActionClass], step: QueuedStep, *,
    made: Collection[Atom] = (), undone: Collection[Atom] = (),
) -> str:  # fmt: skip
    """Return the first precondition of a step that does not hold now, in words; else "".

    A precondition that an action of the plan was to make true is asked of the graph like all
    others: the graph is what robots saw and reported.

    Parameters
    ----------
    made, undone
        Facts that hold, and that do not hold any more, when the turn of the step comes: effects of
        a step right before it.
    """
    action = next((item for item in actions if item.iri == step.action), None)
    if action is None:
        return f"there is an action {step.action}"
    for pattern in action.preconditions:
        values = [step.arguments.get(name, "") for name in pattern.arguments]
        if not all(values):
            return f"the step has all of {', '.join(pattern.arguments)}"
        atom = (pattern.predicate, *values)
        if atom in made:
            continue
        if atom in undone or not _holds(kb, pattern, values):
            iris = {*values, *(statement_of(atom) or ())}
            names = names_of(kb.select, iris)
            return Wording(names, names).atom(atom)
    return ""


def _holds(kb: GraphCore, pattern: Pattern, values: Sequence[str]) -> bool:
    bound = {f"p{n}": iri(value) for n, value in enumerate(values, 1)}
    # Joined to the pattern, not written into its text: an IRI is data, whatever it consists of.
    rows = " ".join(str(value) for value in bound.values())
    variables = " ".join(f"?{name}" for name in bound)
    return bool(kb.query(f"ASK {{ VALUES ({variables}) {{ ({rows}) }} {pattern.sparql} }}"))


def effects_of(action: ActionClass, step: QueuedStep) -> tuple[frozenset[Atom], frozenset[Atom]]:
    """Return the facts that a step makes true, and those that it ends."""

    def atoms(patterns: Sequence[Pattern]) -> frozenset[Atom]:
        return frozenset(
            (pattern.predicate, *(step.arguments.get(name, "") for name in pattern.arguments))
            for pattern in patterns
        )

    return atoms(action.additions), atoms(action.removals)
