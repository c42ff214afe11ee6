"""Requirements of a change: rights, sizes, literals, and the byte strings that it names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from rtask.errors import MissingBlobError, TooLargeError
from rtask.kb.commit.access import Access, names_doer
from rtask.kb.commit.checks.testimony import require_own_testimony
from rtask.kb.commit.commit import MAX_EMPTIED, Request
from rtask.kb.durability.blobs import PREFIX, BlobStore, digest_of
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import with_properties
from rtask.rdf.bounds import (
    MAX_IRI,
    MAX_LITERAL,
    characters,
    refuse_long_literal,
    refuse_long_names,
)
from rtask.rdf.terms import GraphName, NamedNode

__all__ = ["check_blobs", "check_lengths", "check_rights", "check_size", "is_bounded"]


def is_bounded(access: Access) -> bool:
    """Whether the bound on one change holds for a caller: a robot or teacher, by its own token."""
    return access.role in ("robot", "teacher") and not access.of_owner


def check_size(added: int, removed: int, access: Access, most: int | None) -> None:
    """Refuse a change that would keep other robots waiting for too long.

    A commit is stored in one step, during which nobody else writes.

    Parameters
    ----------
    added, removed
        Statements of the change.
    most
        Statements of one change; ``None`` without a bound.

    Raises
    ------
    TooLargeError
        Naming the bound, and how to split the change.
    """
    if most is None or not is_bounded(access) or max(added, removed) <= most:
        return
    how = (
        f"send it in parts of at most {most} statements; those about one blank node belong "
        "together, or give it an IRI"
    )
    if removed > most:
        how = (
            f"remove them in parts, with WITH {access.home()} DELETE {{ ?s ?p ?o }} WHERE "
            f"{{ {{ SELECT ?s ?p ?o {{ ?s ?p ?o }} LIMIT {most} }} }} until nothing is left"
        )
    raise TooLargeError(
        f"one change of a {access.role} adds or removes at most {most} statements, so that others "
        f"need not wait long for it, and this one has {max(added, removed)}; nothing was stored; "
        f"{how}. An admin may store more at once",
        limit="change",
        value=max(added, removed),
        allowed=most,
    )


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
        if request.permitted and _is_permitted(change, graph, request):
            continue
        request.access.require_write(graph, "write")
    if request.access.role in ("robot", "teacher") and not plain:
        for quad in with_properties(change.added, names_doer):
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


def _is_permitted(change: Overlay, graph: GraphName, request: Request) -> bool:
    """Return whether all that changes in a graph is what the operation itself decided on."""
    return request.access.role != "reader" and all(
        quad in request.permitted
        for quad in (*change.added, *change.removed)
        if quad.graph_name == graph
    )


def check_lengths(change: Overlay) -> None:
    """Refuse literals and names that are too long, literals unless the store has them already."""
    for quad in change.added:
        if len(str(quad)) <= MAX_IRI:  # neither its names nor its literal can be too long
            continue
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
