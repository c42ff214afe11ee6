"""What the bulk loader is given, which others of the process wait for."""

from __future__ import annotations

from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, Literal, Quad, Store

from rtask.kb.store.embedded import EmbeddedStore
from rtask.rdf.terms import iri


class _Watched:
    """A store that notes how many quads it was given as objects."""

    def __init__(self) -> None:
        self.real = Store()
        self.as_objects: list[int] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)

    def bulk_extend(self, quads: list[Quad]) -> None:
        self.as_objects.append(len(quads))
        self.real.bulk_extend(quads)


def _quads(count: int) -> list[Quad]:
    """Return quads of two graphs, a tenth of them with blank nodes, and literals that look so."""
    return [
        Quad(
            iri(f"urn:s{n}"),
            iri("urn:p"),
            BlankNode(f"b{n}") if n % 10 == 0 else Literal(f"_:x{n}"),
            iri("urn:g") if n % 2 else DefaultGraph(),
        )
        for n in range(count)
    ]


def test_the_loader_is_given_no_objects_which_would_stop_the_process() -> None:
    watched, quads = _Watched(), _quads(12_000)
    EmbeddedStore(watched).bulk_extend(quads)  # type: ignore[arg-type] # notes what it is given
    assert watched.as_objects == []
    assert set(watched.real) == set(quads)


def test_blank_nodes_keep_their_names_in_whatever_parts_they_are_given() -> None:
    store, quads = EmbeddedStore(Store()), _quads(210_000)[::10]
    store.bulk_extend(quad for quad in quads)
    assert set(store.raw) == set(quads)
