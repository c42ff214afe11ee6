"""Reasoning in a branch: its difference from the trunk is staged on the trunk's closure.

A whole closure of its own would take the memory and the time that a branch is to save. What the
branch asserts and the trunk does not is added, what the trunk asserts and the branch does not is
removed, and what comes of it is kept as a fork: a closure that shares all other facts with the
trunk's. Further changes are staged on the fork, so that they cost what they are about, however much
the branch holds. What follows is exact, whatever the trunk has taken in since.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

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
from rtask.kb.store.quads import InGraph
from rtask.rdf.terms import TripleKey

if TYPE_CHECKING:
    from reasoner import Decision, Fork

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
    staged: Any
    inferred_added: Collection[TripleKey] = ()
    inferred_removed: Collection[TripleKey] = ()
    contradictions: list[Any] = field(default_factory=list)
    clash_causes: list[Any] = field(default_factory=list)
    remaining_inferred: Collection[TripleKey] | None = None

    def causes(self, budget_ms: float) -> list[Any]:
        """Return the causes, which were looked for while the trunk stood still."""
        return self.clash_causes

    def apply(self) -> None:
        """Bring the change into force in the closure of the branch."""
        self.inference.take(self.staged)

    def prove(self, triple: TripleKey) -> Any:
        """Return a proof of a triple that holds with the change, or ``None``."""
        with self.inference.trunk_still():
            return self.staged.prove(triple)

    def discard(self) -> None:
        """Discard the change."""
        with self.inference.trunk_still():
            self.staged.discard()


class BranchInference(Inference):
    """Derives what follows in a branch.

    The first change is staged on the closure of the trunk with all that differs; what comes of it
    stays beside that closure as a :class:`reasoner.Fork`, on which further changes are staged.

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
        self._fork: Fork | None = None
        self._shared: Any = None

    def trunk_still(self) -> AbstractContextManager[object]:
        """Keep the trunk from changing within a block."""
        return self._trunk.exclusive()

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
        with self.trunk_still():
            self._own.catch_up()
            self._others.catch_up()
            if self._current_fork() is not None:
                staged = super().derive(gained, lost, None, budget)
                return self._outcome(staged, staged.inferred_added, staged.inferred_removed)
            added, removed = self._difference(dict.fromkeys(gained), frozenset(lost))
            budget = _for_all(budget, len(added) + len(removed) - len(gained) - len(lost))
            staged = self._of_trunk().derive(added, removed, None, budget)
            try:
                return self._outcome(staged, *self._read(staged))
            except BaseException:
                staged.discard()
                raise

    def _of_trunk(self) -> Inference:
        inference = self._trunk.committer.inference
        if inference is None:
            raise UnsupportedError("the trunk was opened without reasoning")
        return inference

    def _current_fork(self) -> Fork | None:
        """Return the closure of the branch, if it still shares facts with that of the trunk."""
        fork = self._fork
        if fork is not None and (fork.is_lost or self._of_trunk().closure() is not self._shared):
            self._fork = self._shared = fork = None
        return fork

    def take(self, staged: Any) -> None:
        """Bring a change into force."""
        from reasoner import Fork

        with self.trunk_still():
            if self._fork is not None and staged.is_current(self._fork):
                staged.apply()
                return
            trunk = self._of_trunk().closure()
            self._fork, self._shared = Fork.of(trunk, staged), trunk

    def closure(self) -> Any:
        """Return the closure of the branch, while the trunk stands still."""
        fork = self._current_fork()
        if fork is not None:
            return fork
        self._own.catch_up()
        self._others.catch_up()
        added, removed = self._difference({}, frozenset())
        self.take(self._of_trunk().closure().stage(added, removed, accepted=True))
        assert self._fork is not None  # the trunk stands still
        return self._fork

    def explain(self, triple: TripleKey, budget: int) -> Decision:
        """Return whether a triple holds; see :meth:`Inference.explain`."""
        with self.trunk_still():
            return super().explain(triple, budget)

    def entails(self, conclusion: Iterable[TripleKey], budget: int) -> Any:
        """Return whether a conclusion follows; see :meth:`Inference.entails`."""
        with self.trunk_still():
            return super().entails(conclusion, budget)

    def causes(self, budget_ms: float) -> list[dict[str, Any]]:
        """Return the causes of the contradictions; see :meth:`Inference.causes`."""
        with self.trunk_still():
            return super().causes(budget_ms)

    def contradictions(self) -> list[Any]:
        """Return the contradictions; see :meth:`Inference.contradictions`."""
        with self.trunk_still():
            return super().contradictions()

    def difference(self) -> tuple[InGraph, list[Quad]]:
        """Compare the inferred graph with a closure of the branch alone, which is not kept."""
        try:
            return super().difference()
        finally:
            self._closure = None

    def _outcome(
        self, staged: Staged, added: Collection[TripleKey], removed: Collection[TripleKey]
    ) -> _BranchStaged:
        if staged.contradictions:
            causes = staged.causes(budget_ms=CAUSE_BUDGET_MS)
            return _BranchStaged(
                self,
                staged,
                contradictions=list(staged.contradictions),
                clash_causes=causes,
            )
        return _BranchStaged(self, staged, added, removed)

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

    def _read(self, staged: Staged) -> tuple[list[TripleKey], list[TripleKey]]:
        """Return the change of the branch's inferred graph, from that of the trunk's."""
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
        return added, removed

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
