"""A bound on the work of joins: candidates tried, not facts found and not seconds.

A rule whose patterns share no variable tries every pair of facts and may derive nothing, so that a
bound on facts never stops it. What is counted depends on the facts and the rules alone: a change is
refused on every machine or on none.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from reasoner.rules.rule import Atom, Rule, Step

__all__ = ["ClosureTooLargeError", "Work"]

_ROWS_AT_ONCE = 64
_USER = "rule:"


class ClosureTooLargeError(RuntimeError):
    """The closure would outgrow the configured bounds, or the work to find it would."""


class Work:
    """Candidates that the users' rules have tried in one change.

    Rules of the schema are not bounded: what they try is bounded by what they derive.

    Parameters
    ----------
    limit
        Number of candidates of one rule after which the change is refused.
    """

    __slots__ = ("_done", "_rules", "limit")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._done: dict[int, int] = {}
        self._rules: Sequence[Rule] = ()

    def use(self, rules: Sequence[Rule]) -> None:
        """Take note of the rules in force, the users' last; counting restarts."""
        self._rules = rules
        self._done = {}

    def spend(self, candidates: int, steps: Sequence[Step]) -> None:
        """Count candidates of one step of a rule.

        Parameters
        ----------
        steps
            The rule's steps; a cached tuple, which identifies them.

        Raises
        ------
        ClosureTooLargeError
            The limit is exceeded by a rule of the user, which the message names.
        """
        done = self._done.get(id(steps), 0) + candidates
        if done > self.limit:
            name = self._name(steps)
            if name is not None:
                raise ClosureTooLargeError(
                    f"the rule {name} tries more than {self.limit} combinations of facts in one "
                    "change; let its patterns share variables, or begin it with a rarer one"
                )
            done = 0
        self._done[id(steps)] = done

    def spend_rows(self, rows: int, steps: Sequence[Step]) -> None:
        """Count rows of a join of whole relations, which is quicker a row."""
        self.spend(rows // _ROWS_AT_ONCE, steps)

    def _name(self, steps: Sequence[Step]) -> str | None:
        """Return the label of the user's rule that has these steps, or None."""
        atoms = {step for step in steps if isinstance(step, Atom)}
        for rule in reversed(self._rules):
            if not rule.name.startswith(_USER):
                continue
            groups = (group.atoms for group in rule.absences)
            parts = {*rule.body, rule.head, *itertools.chain.from_iterable(groups)}
            if atoms <= parts:
                return rule.name.removeprefix(_USER)
        return None
