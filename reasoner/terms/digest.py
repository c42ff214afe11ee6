"""Digest of a set of triples: independent of order, updated by adding and subtracting.

It detects accidents (a store and a closure that have diverged), not attacks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from reasoner.terms.dictionary import Dictionary, Fact, Triple

_MASK = (1 << 64) - 1
_ODD = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)


class Digest:
    """Sum of the hashes of triples, and their number.

    Examples
    --------
    >>> from pyoxigraph import NamedNode
    >>> a, b = NamedNode("urn:a"), NamedNode("urn:b")
    >>> one, other = Digest(), Digest()
    >>> one.add([(a, a, b), (b, b, a)])
    >>> other.add([(b, b, a), (a, a, a), (a, a, b)])
    >>> other.subtract([(a, a, a)])
    >>> one == other, one.count
    (True, 2)
    """

    def __init__(self) -> None:
        self.count = 0
        self._lanes = (0, 0)
        self._hashes: dict[object, tuple[int, int]] = {}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Digest) and str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __str__(self) -> str:
        return f"{self.count}:{self._lanes[0]:016x}{self._lanes[1]:016x}"

    def add(self, triples: Iterable[Triple]) -> None:
        """Add triples, none of which may be in the set yet."""
        self._change(triples, 1)

    def subtract(self, triples: Iterable[Triple]) -> None:
        """Remove triples, all of which must be in the set."""
        self._change(triples, -1)

    def _change(self, triples: Iterable[Triple], sign: int) -> None:
        first, second = self._lanes
        for triple in triples:
            a, b = self._hash(triple)
            first, second = (first + sign * a) & _MASK, (second + sign * b) & _MASK
            self.count += sign
        self._lanes = first, second

    def _hash(self, triple: Triple) -> tuple[int, int]:
        parts = [self._hash_term(term) for term in triple]
        first, second = (
            _mix(sum(odd * part[lane] for odd, part in zip(_ODD, parts, strict=True)))
            for lane in (0, 1)
        )
        return first, second

    def _hash_term(self, term: object) -> tuple[int, int]:
        digests = self._hashes.get(term)
        if digests is None:
            raw = hashlib.blake2b(str(term).encode(), digest_size=16).digest()
            digests = int.from_bytes(raw[:8], "little"), int.from_bytes(raw[8:], "little")
            self._hashes[term] = digests
        return digests


def _mix(x: int) -> int:
    """Finalise 64 bits, so that sums of similar triples do not cancel (SplitMix64)."""
    x &= _MASK
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & _MASK
    return x ^ (x >> 31)


def digest_of(facts: Iterable[Fact], terms: Dictionary) -> Digest:
    """Return the digest of facts."""
    digest = Digest()
    digest.add(map(terms.decode_fact, facts))
    return digest
