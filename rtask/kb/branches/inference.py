"""Reasoning in a branch: its difference from the trunk is staged on the trunk's closure.

A closure of its own would take the memory and the time that a branch is to save. What the branch
asserts and the trunk does not is added, what the trunk asserts and the branch does not is removed,
and the consequences are read off and discarded. They are exact, whatever the trunk has taken in
since the branch was made.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pyoxigraph import Quad

from rtask.errors import UnsupportedError
from rtask.kb.branches.touched import Touched
from rtask.kb.commit.budget import OF_ROBOTS
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.committer import Committer
from rtask.kb.commit.inference import CAUSE_BUDGET_MS, Inference, Staged
from rtask.kb.commit.writer import Writer
from rtask.kb.rules.rule import Rule
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import TripleKey

__all__ = ["BranchCommitter", "BranchInference"]


class BranchCommitter(Committer):
    """Stores the changes of a branch; what follows is derived at once, and never tried aside."""

    @staticmethod
    def _is_tried(request: Any, size: int) -> bool:
        return False


@dataclass
class _BranchStaged:
    """What follows from a change of a branch."""

    inference: BranchInference
    inferred_added: Collection[TripleKey] = ()
    inferred_removed: Collection[TripleKey] = ()
    contradictions: list[Any] = field(default_factory=list)
    clash_causes: list[Any] = field(default_factory=list)
    remaining_inferred: Collection[TripleKey] | None = None

    def causes(self, budget_ms: float) -> list[Any]:
        """Return the causes, which were looked for while the trunk stood still."""
        return self.clash_causes

    def apply(self) -> None:
        """Forget a closure that was built to explain the state before."""
        self.inference.forget()

    def prove(self, triple: TripleKey) -> None:
        """Return no proof: the trunk's closure keeps nothing of what it derived."""

    def discard(self) -> None:
        """Do nothing: the trunk's closure keeps nothing of it."""


class BranchInference(Inference):
    """Derives what follows in a branch.

    Explanations need a closure of the branch's own, which is built when the first is asked for.

    Parameters
    ----------
    store, graphs, catalogue
        The branch.
    trunk
        Writer of the trunk, whose closure is used.
    own, others
        What the branch, and the trunk since, has touched.
    """

    def __init__(
        self,
        store: GraphStore,
        graphs: Graphs,
        catalogue: Catalogue,
        trunk: Writer,
        own: Touched,
        others: Touched,
    ) -> None:
        super().__init__(store, graphs, catalogue)
        self._trunk = trunk
        self._own = own
        self._others = others

    def forget(self) -> None:
        """Forget the closure, because the branch has changed."""
        self._closure = None

    def derive(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Rule] | None,
        budget: Any,
    ) -> Staged:
        """Return what follows from a change; see :meth:`Inference.derive`.

        Raises
        ------
        UnsupportedError
            The change concerns rules, or the trunk was loaded in bulk since.
        TooMuchFollowsError
            More follows from all that differs from the trunk than from a change of that size may.
        """
        if rules is not None:
            raise UnsupportedError("a branch has the rules of its trunk; change them there")
        with self._trunk.exclusive():
            inference = self._trunk.committer.inference
            if inference is None:
                raise UnsupportedError("the trunk was opened without reasoning")
            self._own.catch_up()
            self._others.catch_up()
            added, removed = self._difference(dict.fromkeys(gained), frozenset(lost))
            budget = _for_all(budget, len(added) + len(removed) - len(gained) - len(lost))
            staged = inference.derive(added, removed, None, budget)
            try:
                return self._read(staged)
            finally:
                staged.discard()

    def _difference(
        self, gained: dict[TripleKey, None], lost: frozenset[TripleKey]
    ) -> tuple[list[TripleKey], list[TripleKey]]:
        """Return the triples that only the branch will assert, and those that only the trunk does.

        Only what either has touched since the base can differ.
        """
        added, removed = [], []
        touched = self._others.asserted, self._own.asserted, gained, dict.fromkeys(lost)
        for triple in {triple: None for part in touched for triple in part}:
            here = triple in gained or (triple not in lost and self._holds(triple))
            there = self._holds_in_trunk(triple)
            if here and not there:
                added.append(triple)
            elif there and not here:
                removed.append(triple)
        return added, removed

    def _holds_in_trunk(self, triple: TripleKey) -> bool:
        quads = self._trunk.committer.store.quads_for_pattern(*triple, None)
        return any(self._graphs.is_input(quad.graph_name) for quad in quads)

    def _read(self, staged: Staged) -> _BranchStaged:
        """Return the change of the branch's inferred graph, from that of the trunk's."""
        if staged.contradictions:
            causes = staged.causes(budget_ms=CAUSE_BUDGET_MS)
            return _BranchStaged(
                self, contradictions=list(staged.contradictions), clash_causes=causes
            )
        gained, lost = set(staged.inferred_added), set(staged.inferred_removed)
        added: list[TripleKey] = []
        removed: list[TripleKey] = []
        for triple in self._candidates(gained, lost):
            quad = Quad(*triple, self._graphs.inferred)
            is_derived = triple in gained or (
                triple not in lost and quad in self._trunk.committer.store
            )
            if is_derived != (quad in self._store):
                (added if is_derived else removed).append(triple)
        return _BranchStaged(self, added, removed)

    def _candidates(self, *more: Collection[TripleKey]) -> Iterator[TripleKey]:
        """Yield each triple once that the branch may derive and did not, or the reverse."""
        parts = (self._others.inferred, self._own.inferred, *more)
        yield from {triple: None for part in parts for triple in part}


def _for_all(budget: Any, others: int) -> Any:
    """Return the budget of a change for all that differs from the trunk.

    What was written before in the branch is derived again, and is allowed as much as when it was.
    """
    if budget is None or others <= 0:
        return budget
    return replace(
        budget,
        derived=min(sys.maxsize, budget.derived + others * OF_ROBOTS.derived_each),
        firings=min(sys.maxsize, budget.firings + others * OF_ROBOTS.firings_each),
    )
