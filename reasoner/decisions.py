"""The two answers that are no proof: a statement does not hold, or the budget did not decide it.

A budget counts work (goals, and the rows that rules looked at), so that an answer is the same on
an idle and on a loaded machine. Processor time only guards against work that costs more than it
counts. Where a budget ends a search, the answer is "not decided", never "no".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NoReturn

from reasoner.terms.dictionary import Triple

__all__ = ["DEFAULT_BUDGET", "Budget", "Need", "OutOfBudgetError", "Refutation", "Undecided"]

DEFAULT_BUDGET = 50_000
"""Goals and rows of one proof; about a second of processor time; most proofs take a hundred."""
GUARD_S = 60.0
"""Processor time of one search, whatever its work, s."""


class OutOfBudgetError(Exception):
    """The search exceeded its budget."""


class Budget:
    """Count the work of one search, and end it at a limit.

    Parameters
    ----------
    limit : int
        Goals and rows that may be looked at.

    Examples
    --------
    >>> budget = Budget(10)
    >>> budget.spend(7)
    >>> budget.spent
    7
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.spent = 0
        self._calls = 0
        self._deadline = time.thread_time() + GUARD_S

    @property
    def is_spent(self) -> bool:
        """Whether the search was ended."""
        return self.spent > self.limit or time.thread_time() > self._deadline

    def spend(self, candidates: int, steps: Sequence[Any] = ()) -> None:
        """Count the rows that one step of a rule looks at.

        Raises
        ------
        OutOfBudgetError
            There is not that much left.
        """
        self.spent += candidates
        if self.spent > self.limit:
            raise OutOfBudgetError
        self._calls += 1
        # Reading the clock costs more than looking at a row.
        if self._calls % 256 == 0 and time.thread_time() > self._deadline:
            raise OutOfBudgetError

    def count(self, candidates: int, rule: Any = None) -> None:
        """Count work outside of the steps of rules.

        Raises
        ------
        OutOfBudgetError
            There is not that much left.
        """
        self.spend(candidates)


@dataclass(frozen=True)
class Need:
    """What one rule lacks to derive a statement.

    Attributes
    ----------
    rule : str
        Name in OWL 2 Profiles 4.3, or `rule:<name>` of a user's rule.
    missing : tuple of str
        Premises that do not hold, in short form; `?x` stands for anything.
    present : tuple of str
        Premises that do.
    condition : str
        Why the rule does not fire although all its premises hold; else empty.
    """

    rule: str
    missing: tuple[str, ...]
    present: tuple[str, ...] = ()
    condition: str = ""

    def __str__(self) -> str:
        if self.condition:
            return f"by {self.rule}: {self.condition}"
        also = f" (and these hold: {'; '.join(self.present)})" if self.present else ""
        return f"by {self.rule}, if: {'; '.join(self.missing)}{also}"

    def to_dict(self) -> dict[str, Any]:
        """Return the need as plain data."""
        out: dict[str, Any] = {
            "rule": self.rule,
            "missing": list(self.missing),
            "present": list(self.present),
        }
        return {**out, "condition": self.condition} if self.condition else out


@dataclass(frozen=True)
class Refutation:
    """A statement does not hold: nobody asserts it, and no rule derives it.

    Attributes
    ----------
    triple : Triple
    gloss : str
        The triple in short form.
    needs : tuple of Need
        What would make it hold, the least first; empty if no rule derives such a statement.
    unknown : tuple of str
        Terms of the triple that no statement mentions; empty if something would make it hold.
    """

    triple: Triple
    gloss: str
    needs: tuple[Need, ...] = ()
    unknown: tuple[str, ...] = ()

    holds: ClassVar[bool] = False

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.render()

    def render(self) -> str:
        """Return the refutation as text, one line per way to make the statement hold."""
        lines = [f"{self.gloss} does not hold"]
        lines += [f"|- nothing is known of {term}" for term in self.unknown]
        if self.needs:
            lines += [f"|- it would follow {need}" for need in self.needs]
        elif not self.unknown:
            lines.append("|- no rule derives it; it would have to be asserted")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the refutation as plain data, terms in N-Triples."""
        return {
            "triple": [str(x) for x in self.triple],
            "needs": [need.to_dict() for need in self.needs],
            "unknown": list(self.unknown),
        }


@dataclass(frozen=True)
class Undecided:
    """The budget ended the search before it found a proof: neither yes nor no.

    Attributes
    ----------
    triple : Triple
    gloss : str
        The triple in short form.
    spent, budget : int
        Work done and allowed: goals, and rows that rules looked at.
    """

    triple: Triple
    gloss: str
    spent: int
    budget: int

    holds: ClassVar[None] = None

    def __bool__(self) -> NoReturn:
        raise TypeError(f"{self.render()}; compare .holds with True, False or None")

    def __str__(self) -> str:
        return self.render()

    def render(self) -> str:
        """Return in one line what was not decided, and how to ask for more."""
        return (
            f"{self.gloss} is not decided within a budget of {self.budget} steps; "
            f"ask again with a larger one, such as {self.more}"
        )

    @property
    def more(self) -> int:
        """A budget to try next."""
        return max(10 * self.budget, DEFAULT_BUDGET)

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain data, terms in N-Triples."""
        return {
            "triple": [str(x) for x in self.triple],
            "spent": self.spent,
            "budget": self.budget,
            "try": self.more,
        }
