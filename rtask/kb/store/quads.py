"""Collections of quads that are put together or made while somebody looks at them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from pyoxigraph import Quad

from rtask.rdf.terms import DEFAULT, GraphName, TripleKey, triple_key

__all__ = ["Derived", "InGraph", "QuadChain"]


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

    def __len__(self) -> int:
        return len(self.triples)

    def __iter__(self) -> Iterator[Quad]:
        graph = self.graph
        return (Quad(s, p, o, graph) for s, p, o in self.triples)

    def __contains__(self, quad: object) -> bool:
        if not isinstance(quad, Quad) or quad.graph_name != self.graph:
            return False
        return triple_key(quad) in self.triples


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


@dataclass(frozen=True)
class Derived:
    """Statements that enter and leave the inferred graph.

    Parameters
    ----------
    removed
        Can be asked for a quad without looking at all of them.
    """

    added: InGraph = field(default_factory=lambda: InGraph((), DEFAULT))
    removed: Collection[Quad] = ()
