"""Ownership of names: what a shared key may make one thing.

A key (`owl:hasKey`, `owl:InverseFunctionalProperty`) makes two things one where both have the same
value of it. Where contributors name their own things, anybody could claim another's value for a
thing of its own, and nobody can know who is right. A key then tells nothing: things of different
owners are one only where that is stated or follows otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

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

    def asks(self, rule: Rule) -> bool:
        """Tell whether what a rule makes one is to be asked about."""
        return self._owner is not None and rule.name in _OF_KEYS

    def owners(self, members: Iterable[int]) -> frozenset[str | None]:
        """Return the owners of terms; None stands for those of nobody."""
        owner = self._owner
        if owner is None:
            return frozenset()
        is_blank, iri = self._terms.is_blank, self._terms.iri
        return frozenset(None if is_blank(x) else owner(iri(x)) for x in members)

    def may_merge(self, left: Iterable[int], right: Iterable[int]) -> bool:
        """Tell whether two classes of equal terms have members of one owner, or of none."""
        return not self.owners(left).isdisjoint(self.owners(right))
