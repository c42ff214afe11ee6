"""Documents beyond the size of a commit: streamed into the store in one atomic step.

What follows from them is derived right after, as a commit of its own; until then the closure is
behind. The document itself is not kept in memory; the store's bulk loader has its own buffers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from pyoxigraph import Quad, RdfFormat

from rtask.errors import ParseError
from rtask.kb.commit.bulk import TripleText
from rtask.loader.documents import Document
from rtask.rdf.formats import Format, explain

if TYPE_CHECKING:
    from rtask.loader.load import Item, _Loader

__all__ = ["load_bulk", "load_text", "readable_by_the_store"]

TEXT_BYTES = 16 << 20
_CHUNK = 4 << 20
_MARKS = {
    RdfFormat.N_TRIPLES: (b"_:", b"<<", b"owl#Ontology>"),
    RdfFormat.TURTLE: (b"_:", b"<<", b"[", b"(", b"Ontology"),
}


def readable_by_the_store(document: Document, form: Format) -> bool:
    """Whether a large document holds nothing but data without blank nodes.

    Then the store reads it by itself, which is faster. A mark in a text may only look like a blank
    node; the document goes the other way then.
    """
    marks = _MARKS.get(form.rdf) if form.rdf is not None else None
    if marks is None or document.size < TEXT_BYTES:
        return False
    rest = b""
    with document.open() as stream:
        while chunk := stream.read(_CHUNK):
            seen = rest + chunk
            if any(mark in seen for mark in marks):
                return False
            rest = chunk[-16:]
    return True


def load_text(
    loader: _Loader, item: Item, form: Format, base: str | None
) -> tuple[int, int, int, int]:
    """Let the store read a document; returns as :func:`load_bulk`.

    Of the statements read those count that the graph did not hold.
    """
    assert form.rdf is not None
    kb, request = loader.kb, loader.request(item)
    removed = _clear(loader, item)
    before = kb.catalogue.triple_count(item.graph)
    try:
        derived = kb.bulk_add(TripleText(item.document.open, form.rdf, base), item.graph, request)
    except (SyntaxError, UnicodeDecodeError) as error:
        raise explain(error, item.document, form) from error
    except ValueError as error:
        raise ParseError(f"{item.document.name}: {error}") from error
    added = kb.catalogue.triple_count(item.graph) - before
    return (added, added, removed, derived)


def load_bulk(loader: _Loader, item: Item, quads: Iterable[Quad]) -> tuple[int, int, int, int]:
    """Load a large document; return statements read, added, removed, derived."""
    kb, options = loader.kb, loader.options
    if options.dry_run:
        read = sum(1 for _ in quads)
        return (read, read, 0, 0)
    request = loader.request(item)
    removed = _clear(loader, item)
    counted = _Counted(loader.prepared(quads, item))
    before = kb.catalogue.triple_count(item.graph)
    derived = kb.bulk_add(counted, item.graph, request)
    after = kb.catalogue.triple_count(item.graph)
    return (counted.count, after - before, removed, derived)


def _clear(loader: _Loader, item: Item) -> int:
    if not loader.options.replace:
        return 0
    with loader.kb.commit_block(loader.request(item)) as tx:
        tx.clear(item.graph)
        return tx.counts()[1]


class _Counted:
    """Counts what passes."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        self._quads = quads
        self.count = 0

    def __iter__(self) -> Iterator[Quad]:
        for quad in self._quads:
            self.count += 1
            yield quad
