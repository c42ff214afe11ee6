"""Change feed: announce commits to subscribers in order.

A commit is announced once it is stored and durable. Subscribers that reconnect catch up from the
journal or, for a store in memory, from the recent commits kept in memory.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection, Iterator

from pyoxigraph import Quad

from rtask.errors import ClosedError, EpochChangedError, GoneError, UsageError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.commit import Change, Commit
from rtask.kb.durability.journal import JournalWithHistory, Record
from rtask.kb.feed.subscriptions import QUEUE, Filter, Subscription
from rtask.kb.store.graph_store import GraphStore
from rtask.rdf.terms import RDF_TYPE, GraphName, NamedNode, Subject, Term, moment

__all__ = ["Feed"]

_REMEMBERED = 100_000
_REMEMBERED_QUADS = 1_000_000
_MAX_DIGITS = 18
"""Digits of a commit's number."""
_Key = tuple[Term | None, NamedNode | None, Term | None, GraphName | None]
_Mask = tuple[bool, bool, bool, bool]


class Feed:
    """Announces commits to the subscribers of one knowledge base.

    Parameters
    ----------
    epoch
        Identifier of the commit numbering.
    journal
        ``None`` for a store in memory.
    last_seq
        Number of the last commit.
    """

    def __init__(
        self,
        epoch: str,
        store: GraphStore,
        catalogue: Catalogue,
        journal: JournalWithHistory | None,
        plain: bool,
        last_seq: int,
    ) -> None:
        self.epoch = epoch
        self._store = store
        self._catalogue = catalogue
        self._journal = journal
        self._plain = plain
        self._announced = last_seq
        self._oldest = last_seq + 1
        self._remembered: deque[Change] = deque()
        self._remembered_quads = 0
        self._lock = threading.Lock()
        self._by_pattern: dict[_Mask, dict[_Key, list[_Subscriber]]] = {}
        self._closed = False

    @property
    def last_seq(self) -> int:
        """Number of the last commit that was announced."""
        return self._announced

    def position(self, seq: int) -> str:
        """Return a position that :meth:`subscribe` takes as ``since``."""
        return f"{self.epoch}:{seq}"

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody follows the commits."""
        return bool(self._by_pattern)

    # Announcing

    def announce(self, change: Change) -> None:
        """Announce a commit; called with each one, in order."""
        seq = change.commit.seq
        with self._lock:
            before, self._announced = self._announced, seq
            if self._journal is None:
                self._remember(change)
            subscribers = self._interested(change) if self._by_pattern else []
        resume = self.position(before)
        is_instance = self._instances(change)
        for subscriber in subscribers:
            part = subscriber.filter_.applied(change, is_instance)
            if part is not None:
                subscriber.queue.put(part, seq, resume)

    def _remember(self, change: Change) -> None:
        self._remembered.append(change)
        self._remembered_quads += _size(change)
        while len(self._remembered) > _REMEMBERED or (
            self._remembered_quads > _REMEMBERED_QUADS and len(self._remembered) > 1
        ):
            gone = self._remembered.popleft()
            self._remembered_quads -= _size(gone)
            self._oldest = gone.commit.seq + 1

    def _interested(self, change: Change) -> list[_Subscriber]:
        """Return the subscribers that a change may concern, with one look-up per pattern mask."""
        interested: dict[int, _Subscriber] = {}
        for mask, by_key in self._by_pattern.items():
            if not any(mask):
                chosen = [subscriber for group in by_key.values() for subscriber in group]
            else:
                keys = {_masked(quad, mask) for quad in _quads(change)}
                chosen = [subscriber for key in keys for subscriber in by_key.get(key, ())]
            interested.update((id(subscriber), subscriber) for subscriber in chosen)
        return list(interested.values())

    def _instances(self, change: Change) -> Callable[[Subject, NamedNode], bool]:
        """Return a test whether a node is an instance of a class, or was before the commit."""
        types: set[tuple[Subject, Term]] | None = None

        def is_instance(subject: Subject, cls: NamedNode) -> bool:
            nonlocal types
            if types is None:
                types = {(q.subject, q.object) for q in _quads(change) if q.predicate == RDF_TYPE}
            if (subject, cls) in types:
                return True
            return any(True for _ in self._store.quads_for_pattern(subject, RDF_TYPE, cls, None))

        return is_instance

    # Subscribing

    def subscribe(
        self,
        filter_: Filter,
        *,
        since: int | str | None = None,
        once: bool = False,
        size: int = QUEUE,
        on_ready: Callable[[], None] | None = None,
    ) -> Subscription[Change]:
        """Return a subscription; see :meth:`KnowledgeBase.subscribe`."""
        after = None if since is None else self._after(since)
        subscriber = _Subscriber(filter_)
        with self._lock:
            if self._closed:
                raise ClosedError("the knowledge base is closed; it has no commits to follow")
            if after is not None:
                self.require_retained(after)
            upto = self._announced
            past = None if after is None else self._past(filter_, after, upto)
            queue: Subscription[Change] = Subscription(
                lambda: self._remove(subscriber), past, once, size, on_ready
            )
            subscriber.queue = queue
            self._group(filter_).append(subscriber)
        return queue

    def _group(self, filter_: Filter) -> list[_Subscriber]:
        key = filter_.key
        s, p, o, g = key
        mask = (s is not None, p is not None, o is not None, g is not None)
        return self._by_pattern.setdefault(mask, {}).setdefault(key, [])

    def _remove(self, subscriber: _Subscriber) -> None:
        with self._lock:
            group = self._group(subscriber.filter_)
            if subscriber in group:
                group.remove(subscriber)
            for mask, by_key in list(self._by_pattern.items()):
                for key in [key for key, members in by_key.items() if not members]:
                    del by_key[key]
                if not by_key:
                    del self._by_pattern[mask]

    def _after(self, since: int | str) -> int:
        """Return the commit number given by ``since``."""
        epoch, colon, number = str(since).rpartition(":")
        if not number.isdecimal() or len(number) > _MAX_DIGITS:
            raise UsageError(f"since={since!r}: expected a commit's number or epoch:number")
        if colon and epoch != self.epoch:
            raise EpochChangedError(
                f"commits were renumbered since {since}; read everything again, then subscribe "
                f"with since={self.position(self._announced)!r}",
                epoch=self.epoch,
                seq=self._announced,
            )
        return int(number)

    def require_retained(self, after: int) -> None:
        """Raise unless every commit after this number is still kept."""
        oldest = self.oldest_retained()
        if after > self._announced:
            raise UsageError(f"there is no commit {after}; the last one is {self._announced}")
        if after + 1 < oldest:
            raise GoneError(
                f"commits before {oldest} are no longer kept; read everything again, then "
                f"subscribe with since={self.position(self._announced)!r}",
                oldest=oldest,
                seq=self._announced,
            )

    def oldest_retained(self) -> int:
        """Return the number of the oldest commit that can be read again."""
        if self._journal is None:
            return self._oldest
        return self._journal.oldest() or self._announced + 1

    def _past(self, filter_: Filter, after: int, upto: int) -> Iterator[Change]:
        for change in self.changes(after, upto):
            part = filter_.applied(change, self._instances(change))
            if part is not None:
                yield part

    def changes(self, after: int, upto: int) -> Iterator[Change]:
        """Yield the commits numbered above ``after`` and up to ``upto``."""
        if self._journal is None:
            with self._lock:  # a writer may announce commits meanwhile
                remembered = list(self._remembered)
            yield from (c for c in remembered if after < c.commit.seq <= upto)
            return
        for record in self._journal.records(after):
            if record.seq > upto:
                return
            yield self.read(record)

    def read(self, record: Record) -> Change:
        """Convert a journal record to the change that was announced."""
        graphs = self._catalogue.graphs
        derived = {graphs.inferred}
        hidden = set() if self._plain else {graphs.inferred, graphs.meta, graphs.provenance}
        added, removed = record.added(), record.removed()
        asserted = [
            tuple(q for q in quads if q.graph_name not in hidden) for quads in (added, removed)
        ]
        inferred = [
            () if self._plain else tuple(q for q in quads if q.graph_name in derived)
            for quads in (added, removed)
        ]
        commit = Commit(
            seq=record.seq,
            added=len(asserted[0]),
            removed=len(asserted[1]),
            derived=len(inferred[0]),
            time=moment(record.header.get("time")),
            activity=None if self._plain else self._catalogue.activity(record.seq),
            withdrawn=len(inferred[1]),
        )
        agent, note = record.header.get("agent"), record.header.get("note")
        return Change(commit, agent, note, *asserted, *inferred)

    def close(self) -> None:
        """End every subscription."""
        with self._lock:
            self._closed = True
            queues = [
                subscriber.queue
                for by_key in self._by_pattern.values()
                for group in by_key.values()
                for subscriber in group
            ]
        for queue in queues:
            queue.close()


class _Subscriber:
    """A subscriber's filter and queue."""

    queue: Subscription[Change]

    def __init__(self, filter_: Filter) -> None:
        self.filter_ = filter_


def _parts(change: Change) -> tuple[Collection[Quad], ...]:
    return change.added, change.removed, change.inferred_added, change.inferred_removed


def _quads(change: Change) -> Iterator[Quad]:
    for part in _parts(change):
        yield from part


def _size(change: Change) -> int:
    return sum(map(len, _parts(change)))


def _masked(quad: Quad, mask: _Mask) -> _Key:
    return (
        quad.subject if mask[0] else None,
        quad.predicate if mask[1] else None,
        quad.object if mask[2] else None,
        quad.graph_name if mask[3] else None,
    )
