"""Bounds on the work that one change causes: statements derived and candidates tried, not seconds.

A rule whose patterns share no variable tries every pair of facts and may derive nothing, so that a
bound on facts alone never stops it. What is counted depends on the facts and the rules alone: a
change is refused on every machine or on none. What depends on the machine (a deadline, memory, a
request to stop) is looked at by `ChangeBudget.watch`, which is called all along.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from reasoner.rules.rule import Atom, Rule, Step
from reasoner.terms.dictionary import Fact, Triple

__all__ = ["ChangeBudget", "ClosureTooLargeError", "NeedsRebuildError", "Work"]

_ROWS_AT_ONCE = 64
_WATCHED_EVERY = 2_000
"""Candidates between two calls of the watch, about a millisecond of work."""
_REBUILT = 15
"""Candidates for each asserted fact when everything is derived again on a narrow budget."""
_CALL = 4
"""Candidates that one step of a rule counts as, however few it finds."""
_USER = "rule:"


class ClosureTooLargeError(RuntimeError):
    """The closure would outgrow the configured bounds, or the work to find it would.

    Attributes
    ----------
    rule : str or None
        Name of the rule that was at work.
    statement : Triple or None
        The axiom that the rule was compiled from, else the last fact that it was applied to.
    limit : int or None
        The bound that was passed.
    """

    def __init__(
        self,
        message: str,
        rule: str | None = None,
        statement: Triple | None = None,
        limit: int | None = None,
    ) -> None:
        super().__init__(message)
        self.rule = rule
        self.statement = statement
        self.limit = limit


class NeedsRebuildError(RuntimeError):
    """Everything would have to be derived again, which the change's budget does not include."""


def _never() -> None:
    """Let the work go on."""


@dataclass(frozen=True, slots=True)
class ChangeBudget:
    """Bounds of what may follow from one change.

    Attributes
    ----------
    derived : int
        Facts that may be derived.
    firings : int
        Candidates that all rules together may try; those of a change that has everything derived
        again may be more, by `Config.max_joins` and 20 for each asserted fact.
    watch : callable
        Called about every millisecond of work; an exception that it raises ends the work and
        leaves nothing changed.
    rebuild_up_to : int or None
        Number of asserted facts up to which everything may be derived again, within 15 more
        candidates for each of them; a change to more that needs it is refused with
        :class:`NeedsRebuildError`.
    """

    derived: int
    firings: int
    watch: Callable[[], None] = _never
    rebuild_up_to: int | None = None

    def firings_to_rebuild(self, asserted: int, joins: int) -> int:
        """Return the candidates for deriving everything again from so many facts.

        Parameters
        ----------
        asserted : int
        joins : int
            Bound of the closure for one rule, which is added where any rebuild is allowed.

        Raises
        ------
        NeedsRebuildError
            If that is not part of the budget.
        """
        if self.rebuild_up_to is None:
            return self.firings + joins
        if asserted > self.rebuild_up_to:
            raise NeedsRebuildError(f"everything has to be derived again from {asserted} facts")
        return self.firings + _REBUILT * asserted


class Work:
    """Candidates that rules have tried in one change.

    Parameters
    ----------
    limit
        Number of candidates of one user-defined rule after which the change is refused.
    firings
        Number of candidates of all rules after which the change is refused, if it is bounded.
    watch
        Called about every millisecond of work; may raise to end it.
    decode
        Returns the terms of a fact, for the error.
    """

    __slots__ = ("_decode", "_done", "_rules", "_total", "_unwatched", "firings", "limit", "watch")

    def __init__(
        self,
        limit: int,
        firings: int | None = None,
        watch: Callable[[], None] = _never,
        decode: Callable[[Fact], Triple] | None = None,
    ) -> None:
        self.limit = limit
        self.firings = firings
        self.watch = watch
        self._decode = decode
        self._done: dict[int, int] = {}
        self._rules: Sequence[Rule] = ()
        self._total = 0
        self._unwatched = 0

    @property
    def spent(self) -> int:
        """Candidates tried so far."""
        return self._total + self._unwatched

    def use(self, rules: Sequence[Rule]) -> None:
        """Take note of the rules in force, the users' last; counting by rule restarts."""
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
            The limit of a rule of the user or that of all rules is exceeded; the message names
            the rule.
        """
        key = id(steps)
        done = self._done.get(key, 0) + candidates
        if done > self.limit:
            name = self._name(steps)
            if name is not None:
                raise ClosureTooLargeError(
                    f"the rule {name} tries more than {self.limit} combinations of facts in one "
                    "change; let its patterns share variables, or begin it with a rarer one",
                    rule=name,
                    limit=self.limit,
                )
            done = (
                0  # a rule of ours has no limit of its own; its name is asked for rarely this way
            )
        self._done[key] = done
        self._unwatched += candidates + _CALL
        if self._unwatched >= _WATCHED_EVERY:
            self._look(steps, None)

    def spend_rows(self, rows: int, steps: Sequence[Step]) -> None:
        """Count rows of a join of whole relations, which is quicker a row."""
        self.spend(rows // _ROWS_AT_ONCE, steps)

    def count(self, candidates: int, rule: Rule | None = None) -> None:
        """Count work outside of the steps of rules: compiling one, merging, comparing."""
        self._unwatched += candidates
        if self._unwatched >= _WATCHED_EVERY:
            self._look((), rule)

    def _look(self, steps: Sequence[Step], rule: Rule | None) -> None:
        self._total += self._unwatched
        self._unwatched = 0
        self.watch()
        if self.firings is not None and self._total > self.firings:
            rule = rule or self._rule(steps)
            message = f"rules try more than {self.firings} combinations of facts in this change"
            name, statement = None, None
            if rule is not None:
                name = rule.name.removeprefix(_USER)
                message += f", the last of them {name}"
                if rule.because and self._decode is not None:
                    statement = self._decode(rule.because[0])
                    message += f" from the statement {' '.join(map(str, statement))}"
            raise ClosureTooLargeError(message, name, statement, self.firings)

    def _rule(self, steps: Sequence[Step]) -> Rule | None:
        """Return a rule that has these steps."""
        atoms = {step for step in steps if isinstance(step, Atom)}
        if not atoms:
            return None
        return next((rule for rule in self._rules if atoms <= {*rule.body}), None)

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
