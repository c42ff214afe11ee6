"""Updates from untrusted callers: evaluated in a reader, committed by the writer.

A reader has the state of the store after one commit. Its answer is committed if that commit is
still the last one, or if later ones changed none of the graphs that the update reads, where its
text says which; otherwise the update is evaluated again (optimistic concurrency control, Kung
and Robinson 1981). Without the second, a robot that tidies up its own graph would have to be
quicker than the pause between any two commits of others. A quick update that conflicts
repeatedly is evaluated under the writers' lock.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

from pyoxigraph import Quad

from rtask.errors import BusyError, QueryTimeout
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.delta import UpdateDataset
from rtask.kb.commit.trials.derivation import Trial
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.commit.writer import Writer
from rtask.kb.readers.messages import decode_change
from rtask.kb.readers.pool import Readers
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import GraphName, NamedNode
from rtask.sparql.templates import resolve
from rtask.sparql.update_outline import read_update

__all__ = ["UpdateOrder", "commit_update", "needs_reader"]

_IN_PLACE = frozenset(("INSERT DATA", "DELETE DATA", "CREATE", "LOAD"))
_SHRINKING = frozenset(("CLEAR", "DROP"))
# Longest time for which the writers' lock is held while a reader evaluates.
_QUICK_S = 0.1
_LOSSES = 2


def needs_reader(text: str) -> bool:
    """Whether an update reads the store to find what to write, so that it may take long or grow.

    >>> needs_reader("INSERT DATA { <urn:s> <urn:p> 1 }")
    False
    >>> needs_reader("DELETE WHERE { ?s ?p 1 }")
    True
    """
    kinds = {operation.kind for operation in read_update(text).operations}
    return not (kinds <= _IN_PLACE or kinds <= _SHRINKING)


@dataclass(frozen=True)
class UpdateOrder:
    """An update as sent to a reader.

    Parameters
    ----------
    access
        The caller's rights, bound to the knowledge base.
    ontologies
        Graphs that hold ontologies, which only some callers may write.
    is_view
        Whether the store's default graph is a view of all named graphs.
    """

    text: str
    access: Access
    dataset: UpdateDataset
    limits: UpdateLimits
    ontologies: tuple[str, ...] = ()
    is_view: bool = False

    def encode(self) -> bytes:
        """Return the message's payload."""
        graphs = self.access.graphs
        return json.dumps(
            {
                "text": self.text,
                "agent": self.access.agent,
                "role": self.access.role,
                "rights": sorted(self.access.rights),
                "graphs": graphs.base if graphs else "",
                "ontologies": self.ontologies,
                "plain": self.access.plain,
                "view": self.is_view,
                "using": [graph.value for graph in self.dataset.using],
                "using_named": [graph.value for graph in self.dataset.using_named],
                "base": self.dataset.base,
                "limits": asdict(replace(self.limits, reasoning=None)),
                "memory": self.limits.memory_bytes,
            }
        ).encode()


class _Parsed(NamedTuple):
    """A change that a reader computed."""

    removed: list[Quad]
    added: list[Quad]
    created: list[NamedNode]
    dropped: list[NamedNode]


def commit_update(
    order: UpdateOrder,
    request: Request,
    readers: Readers,
    writer: Writer,
    last_seq: Callable[[], int],
) -> Commit:
    """Evaluate an update in a reader and store its change as one commit.

    Raises
    ------
    QueryTimeout
        The change was not computed within the order's time limit.
    QueryTooExpensive
        The update exceeds another limit.
    BusyError
        Other commits interfered with every attempt, or too many updates are waiting.
    RtaskError
        As :meth:`rtask.KnowledgeBase.update`.
    """
    return writer.commit_repeatably(
        lambda again, trial: _commit(order, again, trial, readers, writer, last_seq), request
    )


def _commit(
    order: UpdateOrder,
    request: Request,
    trial: Trial | None,
    readers: Readers,
    writer: Writer,
    last_seq: Callable[[], int],
) -> Commit:
    deadline = time.monotonic() + order.limits.seconds
    payload = order.encode()
    took, losses, reads = order.limits.seconds, 0, _graphs_read(order)
    while True:
        if losses >= _LOSSES and took <= _QUICK_S:
            overlay = writer.begin()
            try:
                change, _ = _change(order, payload, readers, deadline)
                _require_size(change, request, writer)
                _fill(overlay, change)
            except BaseException:
                writer.cancel()
                raise
            return writer.finish(overlay, request)
        started = time.monotonic()
        seq = last_seq()
        try:
            change, is_current = _change(order, payload, readers, deadline)
        except QueryTimeout:
            if losses and took < order.limits.seconds / 2:
                raise BusyError(
                    "other commits were made during every attempt to evaluate this update; try "
                    "again"
                ) from None
            raise
        took = time.monotonic() - started
        _require_size(change, request, writer)
        if trial is not None:
            trial.catch_up()
        overlay = writer.begin(len(change.added) + len(change.removed))
        now = last_seq()
        is_valid = now == seq or (reads and writer.recent.left_alone(reads, seq, now))
        if is_valid and is_current():
            try:
                _fill(overlay, change)
            except BaseException:
                writer.cancel()
                raise
            return writer.finish(overlay, request)
        writer.cancel()
        losses += 1


def _graphs_read(order: UpdateOrder) -> frozenset[GraphName]:
    """Return the graphs that an update reads; none if its text does not name them all."""
    update, dataset, graphs = read_update(order.text), order.dataset, order.access.graphs
    read: set[GraphName] = set()
    for operation in update.operations:
        if operation.kind in ("INSERT DATA", "DELETE DATA"):
            continue
        if operation.kind != "MODIFY" or operation.where is None or graphs is None:
            return frozenset()
        tokens = update.tokens[operation.where.start : operation.where.end]
        if any(token.is_word("GRAPH") for token in tokens):
            return frozenset()
        names = operation.using or ((operation.with_graph,) if operation.with_graph else ())
        base = dataset.base
        here = [resolve(name, operation.prologue, base) for name in names] or [*dataset.using]
        # Records of commits change with each of them.
        if not here or any(map(graphs.is_system, here)):
            return frozenset()
        read.update(here)
    return frozenset(read)


def _change(
    order: UpdateOrder, payload: bytes, readers: Readers, deadline: float
) -> tuple[_Parsed, Callable[[], bool]]:
    left = deadline - time.monotonic()
    try:
        data, is_current = readers.evaluate_update(
            order.text, payload, left, order.limits.seconds, order.access.agent
        )
        received = decode_change(data)
        # Parsed now, since the lock is mostly taken later.
        removed, added = [*received.removed], [*received.added]
        return _Parsed(removed, added, received.created, received.dropped), is_current
    except QueryTimeout as error:
        raise QueryTimeout(f"{error}; nothing was stored", **error.details) from None


def _require_size(change: _Parsed, request: Request, writer: Writer) -> None:
    writer.committer.check_size(len(change.added), len(change.removed), request.access)


def _fill(overlay: Overlay, change: _Parsed) -> None:
    """Copy a change computed by a reader into an overlay of the same state."""
    for graph in change.dropped:
        overlay.dropped[graph] = None
    for quad in change.removed:
        overlay.remove(quad)
    for quad in change.added:
        overlay.add(quad)
    for graph in change.created:
        overlay.create(graph)
