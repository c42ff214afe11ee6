"""Handing what was derived in a copy of a closure to the closure itself, which has moved on.

A long derivation is made in a copy (a forked process), while the closure takes other changes. These
are made in the copy afterwards, one by one, as any change is. The copy then holds what follows from
both, and the difference to the closure is that of two differences to the state which both began
with: no reasoning is left to be done, whatever the changes have to do with each other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from reasoner.facts.arrays import Column
from reasoner.facts.changes import FactChange, Renumbering
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Asserted, Layer
from reasoner.facts.relations import Facts
from reasoner.fixpoint.checks import Inconsistency
from reasoner.fixpoint.maintenance import Draft, State
from reasoner.rules.schema import SchemaProblem
from reasoner.rules.strata import Program
from reasoner.rules.user_rules import LabelledRule
from reasoner.saved.rules import (
    distinct_from_data,
    distinct_to_data,
    rules_from_data,
    rules_to_data,
)
from reasoner.terms.dictionary import Dictionary, Fact, Term, Triple

__all__ = ["Difference", "Handover", "Report", "Reporter", "Step"]

MAX_STEP = 20_000
"""Facts of a change above which what a copy derived is not waited for."""


@dataclass(frozen=True)
class Difference:
    """How one state of a closure differs from another.

    Attributes
    ----------
    asserted : FactChange
        In original terms.
    facts : FactChange
        Asserted and derived, on representatives.
    exported : FactChange
        Of the graph of inferred triples.
    """

    asserted: FactChange = field(default_factory=FactChange)
    facts: FactChange = field(default_factory=FactChange)
    exported: FactChange = field(default_factory=FactChange)

    @classmethod
    def of(cls, draft: Draft, state: State, exported: FactChange) -> Difference:
        """Return how a draft, not yet applied, differs from the state."""
        layer, asserted = draft.layer, draft.asserted
        # The layer of a rebuilt draft is the whole new state, not what differs.
        if draft.is_rebuilt:
            facts = FactChange.between(_keys(state.facts), _keys(layer))
        else:
            facts = FactChange(_keys(layer.added), _keys(layer.removed))
        return cls(FactChange.of(asserted.added, asserted.removed), facts, exported)

    def then(self, later: Difference) -> Difference:
        """Return the difference that this one and a later one make together."""
        return Difference(
            self.asserted.then(later.asserted),
            self.facts.then(later.facts),
            self.exported.then(later.exported),
        )

    def undone(self) -> Difference:
        """Return the difference the other way."""
        return Difference(self.asserted.undone(), self.facts.undone(), self.exported.undone())

    def renumbered(self, numbers: Renumbering) -> Difference:
        """Return the difference in the ids of another dictionary."""
        return Difference(
            self.asserted.renumbered(numbers),
            self.facts.renumbered(numbers),
            self.exported.renumbered(numbers),
        )


@dataclass(frozen=True)
class Step:
    """A change that a closure took, for a copy to take as well.

    Attributes
    ----------
    gained, lost : tuple of Triple
        Asserted triples.
    rules : tuple or None
        All user-defined rules from then on; None if they stayed.
    """

    gained: tuple[Triple, ...]
    lost: tuple[Triple, ...]
    rules: tuple[str | LabelledRule, ...] | None = None


@dataclass(frozen=True)
class Report:
    """What a copy has derived since it was made; without objects of the copy's own.

    Attributes
    ----------
    resources, literals : tuple of Term
        Terms that the copy has numbered since the last report.
    difference : Difference
        To the state in which the copy was made, in the ids of the copy.
    classes : tuple
        Representatives of equal terms, with all members.
    program : tuple or None
        Rules, as data or as positions among those that the copy began with, and lists of different
        individuals; None if nothing has changed since the last report.
    problems, clashes : tuple
        Of the state.
    """

    resources: tuple[Term, ...]
    literals: tuple[Term, ...]
    difference: Difference
    classes: tuple[tuple[int, tuple[int, ...]], ...]
    program: tuple[list[Any], list[Any]] | None
    problems: tuple[tuple[int, str], ...]
    clashes: tuple[tuple[str, tuple[Fact, ...], tuple[Fact, ...]], ...]


class Reporter:
    """Reports on a closure that was copied from another; made before the copy takes any change."""

    def __init__(self, terms: Dictionary, state: State) -> None:
        self._terms = terms
        self._state = state
        self._counts = terms.counts()
        self._first = self._reported = state.program
        self._total = Difference()

    def note(self, difference: Difference) -> None:
        """Take note of a change that the copy takes."""
        self._total = self._total.then(difference)

    def report(self) -> Report:
        """Return what has changed since the copy was made."""
        state = self._state
        resources, literals = self._terms.since(self._counts)
        self._counts = self._terms.counts()
        program = None
        # A program is large to send, and most changes leave it as it is.
        if state.program is not self._reported:
            program, self._reported = self._as_data(state.program), state.program
        return Report(
            resources,
            literals,
            self._total,
            tuple(state.equality.classes()),
            program,
            tuple((problem.node, problem.message) for problem in state.problems),
            tuple((c.rule, c.premises, c.because) for c in state.clashes.values()),
        )

    def _as_data(self, program: Program) -> tuple[list[Any], list[Any]]:
        places = {rule: place for place, rule in enumerate(self._first.rules)}
        rules = rules_to_data(program.rules, places)
        return rules, [distinct_to_data(each) for each in program.distinct]


class Handover:
    """What a closure keeps while a copy of it derives what follows from a change.

    Attributes
    ----------
    is_broken : bool
        Whether a change was too large to be made in the copy as well.
    """

    def __init__(self, terms: Dictionary, program: Program) -> None:
        self._terms = terms
        self._first = program
        self._new: Program | None = None
        self._counts = terms.counts()
        self._resources: list[int] = []
        self._literals: list[int] = []
        self._steps: deque[tuple[Step, Difference]] = deque()
        self._taken = Difference()
        self._report: Report | None = None
        self.is_broken = False

    # The closure, while nobody else changes it.

    def record(
        self, draft: Draft, difference: Difference, rules: tuple[str | LabelledRule, ...] | None
    ) -> None:
        """Record a change that the closure takes."""
        # The size of a rebuilt draft is that of the whole state, which says nothing of the step.
        if draft.size > MAX_STEP and not draft.is_rebuilt:
            self.is_broken = True
        asserted = draft.asserted
        if self.is_broken or len(asserted.added) + len(asserted.removed) > MAX_STEP:
            self.is_broken = True
            return
        decode = self._terms.decode_fact
        step = Step(tuple(map(decode, asserted.added)), tuple(map(decode, asserted.removed)), rules)
        self._steps.append((step, difference))

    def encode(self, report: Report) -> None:
        """Give the terms of a report ids of this closure."""
        self._resources += [self._terms.encode(term) for term in report.resources]
        self._literals += [self._terms.encode(term) for term in report.literals]

    # Anybody.

    def take_steps(self) -> list[Step]:
        """Return the changes recorded since the last call, which the copy is to make next."""
        steps = []
        while self._steps:
            step, difference = self._steps.popleft()
            self._taken = self._taken.then(difference)
            steps.append(step)
        return steps

    @property
    def has_steps(self) -> bool:
        """Whether changes were recorded that have not been taken."""
        return bool(self._steps)

    def receive(self, report: Report) -> None:
        """Prepare what the copy reports, whose terms have ids here."""
        if report.program is not None:
            numbers = self._numbers()
            rules, distinct = report.program
            self._new = Program(
                rules_from_data(rules, self._first.rules, numbers),
                [distinct_from_data(each, numbers) for each in distinct],
                self._terms,
            )
        self._report = report

    def _numbers(self) -> Renumbering:
        resources, literals = self._counts
        return Renumbering(
            np.array(self._resources, np.uint64),
            np.array(self._literals, np.uint64),
            resources,
            literals,
        )

    def leaving(self) -> Iterator[Triple]:
        """Yield the inferred triples that go by what the copy reports."""
        if self._report is not None:
            change = self._report.difference.exported.renumbered(self._numbers())
            for p, keys in change.removed.items():
                yield from self._terms.decode_column(p, Column(keys))

    def draft(self, state: State, asserted: Asserted) -> tuple[Draft, FactChange] | None:
        """Return the successor of a state, as the copy has derived it.

        Parameters
        ----------
        state : State
            Of the closure, after all changes that were taken.
        asserted : Asserted
            With the changes that lead to the successor.

        Returns
        -------
        tuple of Draft and FactChange, or None
            The successor and the change of the graph of inferred triples; None if the copy was made
            for other changes, or a change has not been made in the copy.
        """
        report = self._report
        if report is None or self.is_broken or self.has_steps:
            return None
        # The rules have changed here, and the copy has not said which it has now.
        if self._new is None and state.program is not self._first:
            return None
        numbers = self._numbers()
        # From the present state back to the one that both began with, and on to the copy's.
        change = self._taken.undone().then(report.difference.renumbered(numbers))
        # Derived for another change, or without one that has come since: of no use.
        if change.asserted != FactChange.of(asserted.added, asserted.removed):
            return None
        layer = Layer(state.facts)
        layer.added = Facts.of({p: Column(keys) for p, keys in change.facts.added.items()})
        layer.removed = Facts.of({p: Column(keys) for p, keys in change.facts.removed.items()})
        equality = Equality()
        for representative, members in report.classes:
            equality.adopt(numbers(representative), map(numbers, members))
        clashes = [
            Inconsistency(
                rule, tuple(map(numbers.fact, premises)), tuple(map(numbers.fact, because))
            )
            for rule, premises, because in report.clashes
        ]
        draft = Draft(
            asserted,
            layer,
            equality,
            self._new or state.program,
            tuple(SchemaProblem(numbers(node), message) for node, message in report.problems),
            {clash.identity: clash for clash in clashes},
        )
        return draft, change.exported


def _keys(facts: Facts | Layer) -> dict[int, Any]:
    return {p: column.keys for p, column in facts.columns().items()}
