"""Requirements of a change: rights, sizes, literals, and the byte strings that it names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from rtask.errors import MissingBlobError, TooLargeError
from rtask.kb.commit.checks.testimony import require_own_testimony
from rtask.kb.commit.commit import MAX_EMPTIED, Request
from rtask.kb.durability.blobs import PREFIX, BlobStore, digest_of
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.rdf.bounds import MAX_LITERAL, characters, refuse_long_literal, refuse_long_names
from rtask.rdf.terms import GraphName, NamedNode

__all__ = ["check_blobs", "check_lengths", "check_rights"]


def check_rights(
    change: Overlay,
    request: Request,
    graphs: Graphs,
    counts: Callable[[GraphName], int],
    plain: bool,
) -> None:
    """Refuse a change of graphs that the author may not write, or of too many statements.

    Parameters
    ----------
    counts
        Returns the number of triples of a graph.
    """
    for graph in sorted(change.touched_graphs(), key=str):
        if request.moves_records and graph == graphs.quarantine:
            continue
        request.access.require_write(graph, "write")
    if request.access.role in ("robot", "teacher") and not plain:
        for quad in change.added:
            request.access.require_own_identity(quad, graphs)
        require_own_testimony(change.added, request.access, graphs, change.holders)
    removed, emptied = len(change.removed), 0
    if removed > request.max_quads:
        by_graph = Counter(quad.graph_name for quad in change.removed)
        emptied = sum(size for graph, size in by_graph.items() if size == counts(graph))
    for size, what, allowed, instead in (
        (len(change.added), "adds", request.max_quads, "load a file instead"),
        (
            removed - emptied, "removes", request.max_quads,
            "remove them in parts, each with a LIMIT",
        ),
        (
            emptied, "removes whole graphs of", max(MAX_EMPTIED, request.max_quads),
            "remove them one by one",
        ),
    ):  # fmt: skip
        if size > allowed:
            raise TooLargeError(
                f"the commit {what} {size} statements, at most {allowed} are allowed; {instead}",
                limit="statements",
                value=size,
                allowed=allowed,
            )


def check_lengths(change: Overlay) -> None:
    """Refuse literals and names that are too long, literals unless the store has them already."""
    for quad in change.added:
        refuse_long_names(quad)
        if characters(quad.object) <= MAX_LITERAL:
            continue
        stored = change.store.quads_for_pattern(None, None, quad.object, None)
        if next(iter(stored), None) is None:
            refuse_long_literal(quad.object, f"{quad.subject} {quad.predicate}")


def check_blobs(change: Overlay, blobs: BlobStore) -> None:
    """Refuse statements that name byte strings which are not stored."""
    for quad in change.added:
        named = quad.object
        if not isinstance(named, NamedNode) or not named.value.startswith(PREFIX):
            continue
        digest = digest_of(named)
        if digest is None or not blobs.has(named):
            raise MissingBlobError(
                f"{quad.subject} {quad.predicate} names {named}, which is not stored here; "
                "store its bytes first with tx.blob() or kb.blobs.put()",
                blob=digest,
            )
