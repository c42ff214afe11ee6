"""A closure of its own for a branch, which shares the facts of the closure that it began with.

What differs is kept beside the shared facts, so that a fork costs what its branch has changed, and
a change of the branch costs what that change is about. Before the trunk takes a change, each fork
takes note of it the other way round, and so stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Self

from reasoner.closure import Closure, Exported, Rules, Staged
from reasoner.facts.arrays import Column
from reasoner.facts.changes import FactChange
from reasoner.facts.layer import Layer
from reasoner.facts.relations import Facts, Ids
from reasoner.fixpoint.maintenance import Draft, State
from reasoner.handover import Handover
from reasoner.terms.dictionary import Fact

__all__ = ["Fork", "SharedFacts"]

MAX_SHIFT = 100_000
"""Facts of one change of the trunk above which a fork is cheaper to make anew."""


class SharedFacts(Facts):
    """Facts of another set, with own additions and removals.

    Examples
    --------
    >>> base = Facts([(300, 301, 302)])
    >>> shared = SharedFacts(base, Facts([(300, 301, 303)]))
    >>> shared.before(added=[(300, 301, 304)], removed=[(300, 301, 302)])
    >>> base.add(300, 301, 304), base.discard(300, 301, 302), sorted(shared)
    (True, True, [(300, 301, 302), (300, 301, 303)])
    """

    __slots__ = ("_layer",)

    def __init__(self, base: Facts, added: Facts | None = None, removed: Facts | None = None):
        super().__init__()
        self._layer = Layer(base)
        if added is not None:
            self._layer.added = added
        if removed is not None:
            self._layer.removed = removed

    def before(self, added: Iterable[Fact], removed: Iterable[Fact]) -> None:
        """Stay as it is while the shared facts are about to change."""
        layer = self._layer
        for fact in added:
            # A fact that the trunk takes and the branch had added is shared from now on; any other
            # is hidden.
            if not layer.added.discard(*fact):
                layer.removed.add(*fact)
        for fact in removed:
            if not layer.removed.discard(*fact):
                layer.added.add(*fact)

    def replace(self, facts: Iterable[Fact]) -> None:
        """Hold these facts instead, and share those that both sets have."""
        held = Facts()
        held.replace(facts)
        self.hold(held)

    def hold(self, facts: Facts | Layer) -> None:
        """Hold the facts of another set instead, and share those that both sets have."""
        was, now = (
            {p: column.keys for p, column in each.columns().items()}
            for each in (self._layer.base, facts)
        )
        # Compared as columns, since a rebuild does not list what it changed.
        change = FactChange.between(was, now)
        self._layer = Layer(self._layer.base)
        self._layer.added, self._layer.removed = (
            Facts.of({p: Column(keys) for p, keys in part.items()})
            for part in (change.added, change.removed)
        )

    def __len__(self) -> int:
        return len(self._layer)

    def __iter__(self) -> Iterator[Fact]:
        return iter(self._layer)

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact is in the set."""
        return self._layer.has(s, p, o)

    def among(self, facts: set[Fact]) -> set[Fact]:
        """Return the given facts that are in the set."""
        return {fact for fact in facts if self._layer.has(*fact)}

    def objects(self, p: int, s: int) -> Ids:
        """Return the objects of a subject; not to be changed by the caller."""
        return self._layer.objects(p, s)

    def subjects(self, p: int, o: int) -> Ids:
        """Return the subjects of an object; not to be changed by the caller."""
        return self._layer.subjects(p, o)

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over the subjects and objects of a property."""
        return self._layer.pairs(p)

    def size(self, p: int) -> int:
        """Return about how many facts a property has."""
        return self._layer.size(p)

    def columns(self) -> dict[int, Column]:
        """Return all facts as columns, by property."""
        return self._layer.columns()

    def predicates(self) -> tuple[int, ...]:
        """Return the properties that may have facts."""
        return self._layer.predicates()

    def add(self, s: int, p: int, o: int) -> bool:
        """Add a fact; False if it was there."""
        return self._layer.add(s, p, o)

    def update(self, p: int, pairs: Iterable[tuple[int, int]]) -> None:
        """Add facts of one property."""
        for s, o in pairs:
            self.add(s, p, o)

    def discard(self, s: int, p: int, o: int) -> bool:
        """Remove a fact; False if it was not there."""
        return self._layer.discard(s, p, o)

    def about(self, number: int) -> list[Fact]:
        """Return the facts that mention an id as subject, predicate or object."""
        return self._layer.about(number)


class Fork(Closure):
    """The closure of a branch; made by :meth:`of`, and read while the trunk does not change.

    It numbers its terms in the dictionary of the trunk, which keeps them until it is made anew, as
    it keeps those of statements that were withdrawn.

    Attributes
    ----------
    is_lost
        Whether the trunk changed in a way that a fork does not follow: other rules, everything
        derived anew, or too much at once.
    """

    def __init__(self, trunk: Closure, draft: Draft) -> None:
        super().__init__(trunk._rules, trunk._config)
        state, asserted, layer = trunk._state, draft.asserted, draft.layer
        self._terms = trunk._terms
        # A copy: either side skips statements about the reifiers that it has met itself.
        self._reifiers = set(trunk._reifiers)
        if draft.is_rebuilt:
            self._facts = SharedFacts(state.facts)
            self._facts.hold(layer)
        else:
            self._facts = SharedFacts(state.facts, layer.added, layer.removed)
        self._asserted = SharedFacts(state.asserted, Facts(asserted.added), Facts(asserted.removed))
        self._state = State(
            self._asserted,
            self._facts,
            draft.equality,
            draft.program,
            draft.problems,
            draft.clashes,
        )
        self.is_lost = False

    @classmethod
    def of(cls, trunk: Closure, staged: Staged) -> Self | None:
        """Make a fork in the state that a staged change would lead to, instead of applying it.

        Returns
        -------
        Fork or None
            None if the trunk has changed since.
        """
        draft = staged.taken()
        if draft is None or not staged.is_current(trunk):
            return None
        fork = cls(trunk, draft)
        trunk.follow_with(fork)
        return fork

    def before(self, draft: Draft, has_other_rules: bool) -> None:
        """Stay as it is while the trunk is about to take a change."""
        # A rebuilt draft lists no changes, and with other rules something else follows from the
        # branch.
        if self.is_lost or draft.is_rebuilt or has_other_rules or draft.size > MAX_SHIFT:
            self.is_lost = True
            return
        self._facts.before(draft.layer.added, draft.layer.removed)
        self._asserted.before(draft.asserted.added, draft.asserted.removed)

    def _take(
        self, draft: Draft, exported: Exported, rules: Rules, origin: Handover | None
    ) -> None:
        """Make a draft the state, and go on sharing what the trunk has as well."""
        super()._take(draft, exported, rules, origin)
        # A rebuild makes a set of its own, which would end the sharing.
        if self._state.facts is not self._facts:
            self._facts.hold(self._state.facts)
            self._state.facts = self._facts
