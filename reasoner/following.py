"""A copy of a closure, in another process, that takes a change and what the original takes."""

from __future__ import annotations

import sys
from collections.abc import Callable

from reasoner.closure import Closure, Staged
from reasoner.handover import Report, Step
from reasoner.rules.work import ChangeBudget

__all__ = ["Follower"]


class Follower:
    """Makes changes in a copy and reports them for :meth:`reasoner.Closure.adopt`.

    Parameters
    ----------
    closure : Closure
        The copy, in the state of the original when :meth:`~reasoner.Closure.hand_over` was called.
    watch : callable
        Called all along; an exception that it raises ends the work.
    """

    def __init__(self, closure: Closure, watch: Callable[[], None]) -> None:
        self._closure = closure
        self._reporter = closure.reporter()
        self._watch = watch

    def apply(self, staged: Staged) -> None:
        """Apply a change of the copy's own."""
        self._reporter.note(staged.difference())
        staged.apply()

    def take(self, step: Step) -> bool:
        """Take a change that the original took; return whether it contradicts nothing.

        Raises
        ------
        ClosureTooLargeError
            More follows from both changes than the configuration allows.
        """
        budget = ChangeBudget(sys.maxsize, sys.maxsize, self._watch)
        staged = self._closure.stage(
            step.gained, step.lost, step.rules, accepted=True, budget=budget
        )
        if staged.contradictions:
            staged.discard()
            return False
        self.apply(staged)
        return True

    def report(self) -> Report:
        """Return all that has changed since the copy was made."""
        return self._reporter.report()
