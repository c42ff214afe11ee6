"""Documents beyond the size of a commit: streamed into the store in one atomic step.

What follows from them is derived right after, as a commit of its own; until then the closure is
behind. Memory stays flat while the document is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from pyoxigraph import Quad

from rtask.kb.terms import Graph

if TYPE_CHECKING:
    from rtask.loader.documents import Document
    from rtask.loader.formats import Format
    from rtask.loader.headers import Header
    from rtask.loader.load import _Loader

__all__ = ["load_bulk"]


def load_bulk(
    loader: _Loader, document: Document, form: Format, header: Header, quads: Iterable[Quad]
) -> tuple[str, int, int, int, int]:
    """Load a large document; return graph, statements read, added, removed, derived."""
    graph: Graph = loader.target(document, header)
    request = loader.request(document, header, graph)
    options = loader.options
    if options.dry_run:
        read = sum(1 for _ in quads)
        return (getattr(graph, "value", ""), read, read, 0, 0)
    removed = 0
    if options.replace:
        with loader.kb.commit_block(request) as tx:
            tx.clear(graph)
            removed = tx.counts()[1]
    counted = _Counted(loader.prepared(quads, header, graph))
    before = loader.kb.catalogue.triple_count(graph)
    derived = loader.kb.bulk_add(counted, graph, request)
    after = loader.kb.catalogue.triple_count(graph)
    return (getattr(graph, "value", ""), counted.count, after - before, removed, derived)


class _Counted:
    """Counts what passes."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        self._quads = quads
        self.count = 0

    def __iter__(self) -> Iterator[Quad]:
        for quad in self._quads:
            self.count += 1
            yield quad
