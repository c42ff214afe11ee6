"""Collections of quads that are put together, or made while somebody looks at them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import Protocol, TypeGuard

from pyoxigraph import Quad, RdfFormat, serialize

from rtask.rdf.terms import (
    DEFAULT,
    DefaultGraph,
    GraphName,
    NamedNode,
    TripleKey,
    is_ground,
    triple_key,
)

__all__ = [
    "Derived",
    "InGraph",
    "QuadChain",
    "WrittenTriples",
    "ground_text",
    "parts_of",
    "quads_written",
    "with_properties",
]

_BLOCK = 5_000


class _Writable(Collection[TripleKey], Protocol):
    """Triples that can be written faster than their terms are made, like :mod:`reasoner`'s."""

    def ntriples(self) -> bytes:
        """Return their N-Triples text."""

    def parts(self, size: int) -> Iterator[_Writable]:
        """Yield them in parts of at most so many."""

    def having(self, predicate: NamedNode) -> Iterator[TripleKey]:
        """Yield those with a predicate."""


def _is_writable(triples: object) -> TypeGuard[_Writable]:
    # `isinstance` with a protocol looks at all its members each time, 50 us that each commit paid.
    return hasattr(triples, "ntriples")


class InGraph(Collection[Quad]):
    """Triples as quads of one graph.

    Parameters
    ----------
    triples
        Each pass over the quads is a pass over these.
    """

    def __init__(self, triples: Collection[TripleKey], graph: GraphName) -> None:
        self.triples = triples
        self.graph = graph

    @property
    def written(self) -> WrittenTriples | None:
        """The triples, if they have their text."""
        return self.triples if isinstance(self.triples, WrittenTriples) else None

    def text(self) -> bytes | None:
        """Return the N-Triples text of the triples, if that takes less than making their terms."""
        if _is_writable(self.triples):
            return self.triples.ntriples()
        return None if self.written is None else self.written.text

    def having(self, predicate: NamedNode) -> Iterator[TripleKey]:
        """Yield the triples with a predicate."""
        if _is_writable(self.triples):
            return self.triples.having(predicate)
        return (triple for triple in self.triples if triple[1] == predicate)

    def parts(self, size: int) -> Iterator[InGraph]:
        """Yield derived quads in parts of at most so many, with their text."""
        if not _is_writable(self.triples):
            yield self
            return
        for part in self.triples.parts(size):
            yield InGraph(WrittenTriples(part, part.ntriples), self.graph)

    def __len__(self) -> int:
        return len(self.triples)

    def __iter__(self) -> Iterator[Quad]:
        graph = self.graph
        return (Quad(s, p, o, graph) for s, p, o in self.triples)

    def __contains__(self, quad: object) -> bool:
        if not isinstance(quad, Quad) or quad.graph_name != self.graph:
            return False
        return triple_key(quad) in self.triples


class WrittenTriples(Collection[TripleKey]):
    """Triples with their N-Triples text, which is made when first asked for and then kept.

    Storing and journalling a large change reads its text instead of each term.

    Parameters
    ----------
    triples
        In the form in which the store keeps them.
    write
        Returns the text.
    """

    def __init__(self, triples: Collection[TripleKey], write: Callable[[], bytes]) -> None:
        self._triples = triples
        self._write = write

    def __len__(self) -> int:
        return len(self._triples)

    def __iter__(self) -> Iterator[TripleKey]:
        return iter(self._triples)

    def __contains__(self, triple: object) -> bool:
        return triple in self._triples

    @cached_property
    def text(self) -> bytes:
        """The triples in N-Triples, a line each."""
        return self._write()

    @cached_property
    def is_ground(self) -> bool:
        """Whether the text holds no blank node, and no literal that looks like one."""
        return b"_:" not in self.text


def quads_written(quads: Collection[Quad]) -> list[InGraph]:
    """Return quads by graph, as :class:`WrittenTriples`."""
    if isinstance(quads, InGraph) and _is_writable(quads.triples):
        return [InGraph(WrittenTriples(quads.triples, quads.triples.ntriples), quads.graph)]
    by_graph: dict[GraphName, list[Quad]] = {}
    for quad in quads:
        by_graph.setdefault(quad.graph_name, []).append(quad)
    return [_written(part, graph) for graph, part in by_graph.items()]


def _written(quads: list[Quad], graph: GraphName) -> InGraph:
    def write() -> bytes:
        text = serialize(quads, format=RdfFormat.N_QUADS)
        assert text is not None
        end = b"" if isinstance(graph, DefaultGraph) else b" " + str(graph).encode()
        return text.replace(end + b" .\n", b" .\n")  # no literal holds the end of a line

    return InGraph(WrittenTriples(dict.fromkeys(map(triple_key, quads)), write), graph)


def ground_text(quads: Iterable[Quad]) -> tuple[bytes, list[Quad]]:
    """Return the N-Quads text of the quads without blank nodes, and the others.

    >>> from rtask.rdf.terms import BlankNode, iri
    >>> named = Quad(iri("urn:a"), iri("urn:p"), iri("urn:b"))
    >>> text, others = ground_text([named, Quad(BlankNode("x"), iri("urn:p"), iri("urn:b"))])
    >>> text, len(others)
    (b'<urn:a> <urn:p> <urn:b> .\\n', 1)
    """
    pieces: list[bytes] = []
    others: list[Quad] = []
    rest = iter(quads)
    # Others of this process wait for one block at most, and only its terms are held at a time.
    while block := list(islice(rest, _BLOCK)):
        piece = serialize(block, format=RdfFormat.N_QUADS)
        assert piece is not None
        if b"_:" in piece:  # or a literal that looks like a blank node
            others += [quad for quad in block if not _is_ground(quad)]
            piece = serialize(filter(_is_ground, block), format=RdfFormat.N_QUADS)
            assert piece is not None
        pieces.append(piece)
    return b"".join(pieces), others


def _is_ground(quad: Quad) -> bool:
    return is_ground(quad.subject) and is_ground(quad.object) and is_ground(quad.graph_name)


def with_properties(quads: Iterable[Quad], matters: Callable[[NamedNode], bool]) -> Iterator[Quad]:
    """Yield the quads whose property passes a test, which is made once for each property.

    A change of ten thousand statements has few properties, and its checks hold others up.
    """
    passed: dict[NamedNode, bool] = {}
    for quad in quads:
        predicate = quad.predicate
        passes = passed.get(predicate)
        if passes is None:
            passes = passed[predicate] = matters(predicate)
        if passes:
            yield quad


class QuadChain(Collection[Quad]):
    """Several collections of quads without a common one, one after the other.

    Attributes
    ----------
    parts
        The collections that are not empty, none of them a chain.
    """

    def __init__(self, *parts: Collection[Quad]) -> None:
        self.parts: tuple[Collection[Quad], ...] = tuple(
            inner
            for part in parts
            for inner in (part.parts if isinstance(part, QuadChain) else (part,))
            if len(inner)
        )

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __iter__(self) -> Iterator[Quad]:
        for part in self.parts:
            yield from part

    def __contains__(self, quad: object) -> bool:
        return any(quad in part for part in self.parts)


def parts_of(quads: Collection[Quad]) -> tuple[Collection[Quad], ...]:
    """Return the collections that a chain is made of; any other collection alone."""
    return quads.parts if isinstance(quads, QuadChain) else (quads,)


@dataclass(frozen=True)
class Derived:
    """Statements that enter and leave the inferred graph.

    Parameters
    ----------
    removed
        Can be asked for a quad without looking at all of them.
    inferred
        All that stays in the inferred graph; ``None`` where only the store knows.
    """

    added: InGraph = field(default_factory=lambda: InGraph((), DEFAULT))
    removed: Collection[Quad] = ()
    inferred: InGraph | None = None
