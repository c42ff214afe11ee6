"""Planning problems: actions with typed parameters, the facts that hold now, and the goal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

__all__ = ["FAILURE_COST_S", "Action", "Atom", "Goal", "Parameter", "Problem", "Step",
           "expected_cost_s"]  # fmt: skip

Atom: TypeAlias = tuple[str, ...]
"""A predicate and its arguments: objects, or names of parameters in an action."""

Goal: TypeAlias = tuple[Atom, ...]
"""Facts of which any is to hold."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an action: its name, and the type of the objects that may fill it."""

    name: str
    type: str


Estimate: TypeAlias = Callable[[Mapping[str, str]], tuple[float, float]]
"""Duration, s, and chance of success of an action with these arguments."""


@dataclass(frozen=True)
class Action:
    """A class of actions: when one is possible, what it changes, and how it usually ends."""

    name: str
    parameters: tuple[Parameter, ...]
    preconditions: tuple[Atom, ...]
    adds: tuple[Atom, ...]
    deletes: tuple[Atom, ...]
    estimate: Estimate

    def __post_init__(self) -> None:
        """Refuse atoms over names that are no parameters.

        Raises
        ------
        ValueError
            An atom names a variable that no parameter declares.
        """
        declared = {parameter.name for parameter in self.parameters}
        for atom in (*self.preconditions, *self.adds, *self.deletes):
            for name in atom[1:]:
                if name not in declared:
                    raise ValueError(
                        f"action {self.name}: {atom[0]} names {name}, which is no parameter"
                    )


FAILURE_COST_S = 60.0
"""What a failed step costs, s."""


def expected_cost_s(
    duration_s: float, chance: float, failure_cost_s: float = FAILURE_COST_S
) -> float:
    """Return the cost of a step, s, in which a lower chance of success costs time."""
    # Costs add up along a plan, and chances multiply: their logarithms add.
    return duration_s - failure_cost_s * math.log(max(chance, 1e-6))


@dataclass(frozen=True)
class Problem:
    """Objects by type, actions, the facts that hold, and the goals, all of which are to hold.

    ``failure_cost_s`` is what a failed step costs, s: a step of duration *d* and chance *p*
    costs ``d - failure_cost_s * log(p)``. ``workers`` are the objects that do one step at a time
    and work beside each other, so that steps are shared out among them. Where a fact has to be
    assumed, ``likelier`` ones are before others of their predicate.
    """

    objects: Mapping[str, tuple[str, ...]]
    actions: tuple[Action, ...]
    facts: frozenset[Atom]
    goals: tuple[Goal, ...]
    failure_cost_s: float = FAILURE_COST_S
    workers: frozenset[str] = frozenset()
    likelier: frozenset[Atom] = frozenset()

    @property
    def fluents(self) -> frozenset[str]:
        """Predicates that some action changes."""
        return frozenset(
            atom[0] for action in self.actions for atom in (*action.adds, *action.deletes)
        )


@dataclass(frozen=True)
class Step:
    """An action with its arguments, as it stands in a plan."""

    action: str
    arguments: tuple[tuple[str, str], ...]
    preconditions: tuple[Atom, ...]
    adds: tuple[Atom, ...]
    deletes: tuple[Atom, ...]
    duration_s: float
    chance: float

    def cost_s(self, failure_cost_s: float) -> float:
        """Return the expected cost, s, in which a lower chance costs time."""
        return expected_cost_s(self.duration_s, self.chance, failure_cost_s)

    def __str__(self) -> str:
        return f"{self.action}({', '.join(value for _, value in self.arguments)})"
