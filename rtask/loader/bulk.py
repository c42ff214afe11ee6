"""Documents beyond the size of a commit: streamed into the store in one atomic step.

What follows from them is derived right after, as a commit of its own; until then the closure is
behind. Memory stays flat while the document is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from pyoxigraph import Quad

if TYPE_CHECKING:
    from rtask.loader.load import Item, _Loader

__all__ = ["load_bulk"]


def load_bulk(loader: _Loader, item: Item, quads: Iterable[Quad]) -> tuple[int, int, int, int]:
    """Load a large document; return statements read, added, removed, derived."""
    kb, options = loader.kb, loader.options
    if options.dry_run:
        read = sum(1 for _ in quads)
        return (read, read, 0, 0)
    request = loader.request(item)
    removed = 0
    if options.replace:
        with kb.commit_block(request) as tx:
            tx.clear(item.graph)
            removed = tx.counts()[1]
    counted = _Counted(loader.prepared(quads, item))
    before = kb.catalogue.triple_count(item.graph)
    derived = kb.bulk_add(counted, item.graph, request)
    after = kb.catalogue.triple_count(item.graph)
    return (counted.count, after - before, removed, derived)


class _Counted:
    """Counts what passes."""

    def __init__(self, quads: Iterable[Quad]) -> None:
        self._quads = quads
        self.count = 0

    def __iter__(self) -> Iterator[Quad]:
        for quad in self._quads:
            self.count += 1
            yield quad
