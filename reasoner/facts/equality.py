"""owl:sameAs by rewriting: classes of equal terms, one representative each.

Facts are kept on representatives only and expanded on export (Motik et al. 2015, "Handling
owl:sameAs via Rewriting"). Literals are never members.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import RESERVED, SAME

EXPANDED_MEMBERS = 16
"""Classes with more members are exported as a star around the representative."""

EXPANDED_COMBINATIONS = 1_000
"""A fact with more combinations of members is exported on representatives only."""


class Equality:
    """Classes of terms that denote the same thing.

    Examples
    --------
    >>> same = Equality()
    >>> same.union(300, 301)
    >>> same.find(301), same.members(300)
    (300, (300, 301))
    """

    __slots__ = ("_members", "_representative")

    def __init__(self) -> None:
        self._representative: dict[int, int] = {}
        self._members: dict[int, tuple[int, ...]] = {}

    def __bool__(self) -> bool:
        return bool(self._representative)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Equality) and self._members == other._members

    __hash__ = None  # type: ignore[assignment]

    def copy(self) -> Equality:
        """Return an independent copy."""
        other = Equality()
        other._representative = dict(self._representative)
        other._members = dict(self._members)
        return other

    def find(self, number: int) -> int:
        """Return the representative of a term."""
        return self._representative.get(number, number)

    def rewrite(self, fact: Fact) -> Fact:
        """Return a fact on representatives."""
        find = self._representative.get
        s, p, o = fact
        return find(s, s), find(p, p), find(o, o)

    def members(self, number: int) -> tuple[int, ...]:
        """Return all members of a term's class, sorted."""
        return self._members.get(self.find(number), (number,))

    def is_merged(self, number: int) -> bool:
        """Tell whether a term has a class of two or more."""
        return number in self._representative

    def classes(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Iterate over representatives and members of the classes of two or more."""
        return iter(tuple(self._members.items()))

    def union(self, winner: int, loser: int) -> None:
        """Join two classes, given by their representatives."""
        joining = self._members.pop(loser, (loser,))
        self._members[winner] = tuple(sorted((*self._members.get(winner, (winner,)), *joining)))
        self._representative[winner] = winner
        self._representative.update(dict.fromkeys(joining, winner))

    def adopt(self, representative: int, members: Iterable[int]) -> None:
        """Add a class whose members and representative are known."""
        group = tuple(sorted(members))
        self._members[representative] = group
        self._representative.update(dict.fromkeys(group, representative))

    def dissolve(self, number: int) -> tuple[int, ...]:
        """Take a class apart; return its former members."""
        members = self._members.pop(self.find(number), ())
        for member in members:
            del self._representative[member]
        return members

    def expand(self, fact: Fact) -> Iterator[Fact]:
        """Yield a fact with every combination of members, as far as exports go."""
        if not self._representative:
            yield fact
            return
        choices = [self._spread(part) for part in fact]
        combinations = len(choices[0]) * len(choices[1]) * len(choices[2])
        if combinations == 1 or combinations > EXPANDED_COMBINATIONS:
            yield self.rewrite(fact)
            return
        yield from itertools.product(*choices)

    def forms(self, fact: Fact) -> Iterator[Fact]:
        """Yield a fact with every combination of members, without a bound."""
        if not self._representative:
            yield fact
        else:
            yield from itertools.product(*(self.members(x) for x in fact))

    def _spread(self, number: int) -> tuple[int, ...]:
        members = self.members(number)
        return members if len(members) <= EXPANDED_MEMBERS else (self.find(number),)

    def pairs(self, number: int) -> Iterator[Fact]:
        """Yield the sameAs facts that are exported for a term's class."""
        members = self.members(number)
        if len(members) <= EXPANDED_MEMBERS:
            for a, b in itertools.permutations(members, 2):
                yield a, SAME, b
        else:
            star = self.find(number)
            for member in members:
                if member != star:
                    yield star, SAME, member


def ranking(number: int, terms: Dictionary) -> tuple[bool, bool, str]:
    """Return the key by which a class chooses its representative: the smallest wins.

    Vocabulary before other IRIs before blank nodes, then code points, so that the choice does not
    depend on the order of commits.
    """
    return number >= RESERVED, terms.is_blank(number), terms.iri(number)
