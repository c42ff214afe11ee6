"""Ownership of names: what a shared key may make one thing.

A key (`owl:hasKey`, `owl:InverseFunctionalProperty`) makes two things one where both have the same
value of it. Where contributors name their own things, anybody could claim another's value for a
thing of its own, and nobody can know who is right. A key then tells nothing: things of different
owners are one only where that is stated or follows otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

from reasoner.facts.equality import Equality
from reasoner.rules.rule import Rule
from reasoner.terms.dictionary import Dictionary

__all__ = ["Ownership"]

_OF_KEYS = frozenset({"prp-key", "prp-ifp"})


class Ownership:
    """Decides what a shared key may make one.

    Parameters
    ----------
    owner : callable, optional
        Returns the owner of an IRI, or None; without it keys are taken at their word.
    """

    def __init__(self, owner: Callable[[str], str | None] | None, terms: Dictionary) -> None:
        self._owner = owner
        self._terms = terms
        self._cached: dict[int, frozenset[str | None]] = {}

    def asks(self, rule: Rule) -> bool:
        """Tell whether what a rule makes one is to be asked about."""
        return self._owner is not None and rule.name in _OF_KEYS

    def may_merge(self, equality: Equality, left: int, right: int) -> bool:
        """Tell whether the classes of two terms have members of one owner, or of none."""
        return not self._owners(equality, left).isdisjoint(self._owners(equality, right))

    def join(self, equality: Equality, winner: int, loser: int) -> bool:
        """Note that two classes are about to be one; tell whether they have different owners."""
        if self._owner is None:
            return False
        left, right = self._owners(equality, winner), self._owners(equality, loser)
        # Owners are cached by representative, and the winner stays one.
        if left != right:
            self._cached[winner] = left | right
        self._cached.pop(loser, None)
        return left != right

    def forget(self) -> None:
        """Look at all names again, after a class was taken apart."""
        self._cached.clear()

    def _owners(self, equality: Equality, term: int) -> frozenset[str | None]:
        """Return the owners of a term's class; None stands for those of nobody."""
        representative = equality.find(term)
        owners = self._cached.get(representative)
        if owners is None:
            members = equality.members(representative)
            owners = self._cached[representative] = frozenset(map(self._owner_of, members))
        return owners

    def _owner_of(self, number: int) -> str | None:
        # A blank node has no IRI that anybody could own.
        if self._owner is None or self._terms.is_blank(number):
            return None
        return self._owner(self._terms.iri(number))
