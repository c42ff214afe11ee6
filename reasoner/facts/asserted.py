"""Asserted facts, as opposed to derived ones."""

from __future__ import annotations

from collections.abc import Iterator

from reasoner.terms.dictionary import Fact


class Asserted:
    """Asserted facts in original terms, with staged changes."""

    __slots__ = ("added", "facts", "removed")

    def __init__(
        self,
        facts: set[Fact],
        added: frozenset[Fact] = frozenset(),
        removed: frozenset[Fact] = frozenset(),
    ) -> None:
        self.facts = facts
        self.added = added
        self.removed = removed

    def __contains__(self, fact: Fact) -> bool:
        return fact in self.added or (fact in self.facts and fact not in self.removed)

    def __iter__(self) -> Iterator[Fact]:
        yield from self.added
        yield from (fact for fact in tuple(self.facts) if fact not in self.removed)

    def is_unchanged(self) -> bool:
        """Tell whether nothing is staged."""
        return not self.added and not self.removed

    def apply(self) -> None:
        """Write the changes into the set."""
        self.facts -= self.removed
        self.facts |= self.added
