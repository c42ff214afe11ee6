"""Table of terms in arrays: it can be mapped from a file, and terms are made only when asked for.

A term is kept as the bytes of its N-Triples form. Sorted hashes lead from these bytes, and from the
value of a literal, to the id.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pyoxigraph
from numpy.typing import NDArray
from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat

Array = NDArray[np.uint64] | NDArray[np.uint32] | NDArray[np.uint8]
_HASH_BYTES = 8


@dataclass(frozen=True)
class HashIndex:
    """Positions by hash.

    Attributes
    ----------
    hashes : (n,) uint64
        Ascending, with repetitions where hashes collide.
    positions : (n,) uint32
    """

    hashes: NDArray[np.uint64]
    positions: NDArray[np.uint32]

    @classmethod
    def of(cls, hashes: Iterable[int], positions: Iterable[int]) -> HashIndex:
        """Make an index from hashes in any order."""
        return cls(np.fromiter(hashes, np.uint64), np.fromiter(positions, np.uint32))._in_order()

    def _in_order(self) -> HashIndex:
        order = np.argsort(self.hashes, kind="stable")
        return HashIndex(self.hashes[order], self.positions[order])

    def joined(self, other: HashIndex) -> HashIndex:
        """Return an index of the entries of both."""
        return HashIndex(
            np.concatenate((self.hashes, other.hashes)),
            np.concatenate((self.positions, other.positions)),
        )._in_order()

    def candidates(self, target_hash: int) -> Iterator[int]:
        """Yield the positions with a hash."""
        hashes = self.hashes
        at = int(hashes.searchsorted(np.uint64(target_hash)))
        while at < len(hashes) and int(hashes[at]) == target_hash:
            yield int(self.positions[at])
            at += 1


@dataclass(frozen=True)
class TextTable:
    """Texts of terms, one after the other, with an index of their hashes.

    Attributes
    ----------
    data : (m,) uint8
        The texts, UTF-8.
    ends : (n,) uint64
        Where each text ends.
    """

    data: NDArray[np.uint8]
    ends: NDArray[np.uint64]
    index: HashIndex

    @classmethod
    def of(cls, terms: Iterable[object], first: int = 0) -> TextTable:
        """Make a table of terms; `first` is the position of the first of them."""
        texts = [str(term).encode() for term in terms]
        data = np.frombuffer(b"".join(texts), np.uint8)
        ends = np.cumsum(np.fromiter(map(len, texts), np.uint64, len(texts)), dtype=np.uint64)
        index = HashIndex.of(map(hash_of, texts), range(first, first + len(texts)))
        return cls(data, ends, index)

    def __len__(self) -> int:
        return len(self.ends)

    def joined(self, other: TextTable) -> TextTable:
        """Return this table with the texts of another behind its own."""
        return TextTable(
            np.concatenate((self.data, other.data)),
            np.concatenate((self.ends, other.ends + np.uint64(len(self.data)))),
            self.index.joined(other.index),
        )

    def text(self, position: int) -> bytes:
        """Return the text at a position."""
        start = int(self.ends[position - 1]) if position else 0
        return self.data[start : int(self.ends[position])].tobytes()

    def find(self, term: object) -> int | None:
        """Return the position of a term, None if it is not in the table."""
        text = str(term).encode()
        for position in self.index.candidates(hash_of(text)):
            if self.text(position) == text:
                return position
        return None


@dataclass(frozen=True)
class TermTable:
    """Terms of a closure that was saved.

    Attributes
    ----------
    resources, literals : TextTable
    values : HashIndex
        The first literal of each value, by the hash of the value.
    variants : tuple of tuple of int
        Positions of literals that share a value.
    """

    resources: TextTable
    literals: TextTable
    values: HashIndex
    variants: tuple[tuple[int, ...], ...] = ()

    def resource(self, position: int) -> NamedNode | BlankNode:
        """Return an IRI or a blank node."""
        text = self.resources.text(position).decode()
        return BlankNode(text[2:]) if text.startswith("_:") else NamedNode(text[1:-1])

    def literal(self, position: int) -> Literal:
        """Return a literal."""
        line = b"<urn:s> <urn:p> " + self.literals.text(position) + b" ."
        [quad] = pyoxigraph.parse(line, format=RdfFormat.N_TRIPLES)
        literal = quad.object
        assert isinstance(literal, Literal)
        return literal

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by name; see :func:`TermTable.of_arrays`."""
        arrays: dict[str, Array] = {}
        for name, table in (("r", self.resources), ("l", self.literals)):
            arrays[f"{name}_bin"], arrays[f"{name}_off"] = table.data, table.ends
            arrays[f"{name}_hash"], arrays[f"{name}_id"] = table.index.hashes, table.index.positions
        arrays["v_hash"], arrays["v_id"] = self.values.hashes, self.values.positions
        return arrays

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Array], variants: Iterable[Iterable[int]]) -> TermTable:
        """Make a table of what :meth:`arrays` returned."""

        def index(hashes: str, positions: str) -> HashIndex:
            return HashIndex(arrays[hashes].view(np.uint64), arrays[positions].view(np.uint32))

        def texts(name: str) -> TextTable:
            return TextTable(
                arrays[f"{name}_bin"].view(np.uint8),
                arrays[f"{name}_off"].view(np.uint64),
                index(f"{name}_hash", f"{name}_id"),
            )

        return cls(texts("r"), texts("l"), index("v_hash", "v_id"), tuple(map(tuple, variants)))


def hash_of(text: bytes) -> int:
    """Return 64 bits of BLAKE2b."""
    return int.from_bytes(hashlib.blake2b(text, digest_size=_HASH_BYTES).digest(), "little")


def value_hash(key: tuple[object, ...]) -> int:
    """Return the hash of a value's key, equal for equal keys and the same in every process.

    >>> value_hash(("instant", Fraction(5), 0)) == value_hash(("instant", 5, 0))
    True
    """
    return hash_of(repr(tuple(map(_plain, key))).encode())


def _plain(part: object) -> object:
    """Return a whole number as an integer: the two forms are equal, their texts differ."""
    if isinstance(part, Fraction) and part.denominator == 1:
        return part.numerator
    return part
