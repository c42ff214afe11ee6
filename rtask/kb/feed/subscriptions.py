"""Subscriptions: queues between commits and their subscribers.

The writer never waits. The subscription of a subscriber that is too slow ends with an error, and
the subscriber may resume from the last commit it received.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from pyoxigraph import Quad

from rtask.errors import ClosedError, Lagged, RtaskError
from rtask.kb.commit.commit import Change
from rtask.rdf.terms import GraphName, NamedNode, Subject, Term

__all__ = ["Filter", "Subscription"]

QUEUE = 10_000
_T = TypeVar("_T")


@dataclass(frozen=True)
class Filter:
    """Selection of statements; ``None`` matches everything.

    Parameters
    ----------
    cls
        Class whose instances to follow, derived instances included.
    inferred
        Whether to include derived statements.
    """

    subject: Subject | None = None
    predicate: NamedNode | None = None
    value: Term | None = None
    graph: GraphName | None = None
    cls: NamedNode | None = None
    inferred: bool = True

    @property
    def is_open(self) -> bool:
        """Whether every statement matches."""
        return self.key == (None, None, None, None) and self.cls is None

    @property
    def key(self) -> tuple[Term | None, NamedNode | None, Term | None, GraphName | None]:
        """Return the pattern."""
        return (self.subject, self.predicate, self.value, self.graph)

    def fits(self, quad: Quad, is_instance: Callable[[Subject, NamedNode], bool]) -> bool:
        """Whether a statement matches."""
        return (
            (self.subject is None or quad.subject == self.subject)
            and (self.predicate is None or quad.predicate == self.predicate)
            and (self.value is None or quad.object == self.value)
            and (self.graph is None or quad.graph_name == self.graph)
            and (self.cls is None or is_instance(quad.subject, self.cls))
        )

    def applied(
        self, change: Change, is_instance: Callable[[Subject, NamedNode], bool]
    ) -> Change | None:
        """Return the matching part of a commit, or ``None``."""
        if self.is_open and self.inferred:
            return change

        def chosen(quads: Collection[Quad]) -> tuple[Quad, ...]:
            return tuple(quad for quad in quads if self.fits(quad, is_instance))

        part = replace(
            change,
            added=chosen(change.added),
            removed=chosen(change.removed),
            inferred_added=chosen(change.inferred_added) if self.inferred else (),
            inferred_removed=chosen(change.inferred_removed) if self.inferred else (),
        )
        touched = part.added or part.removed or part.inferred_added or part.inferred_removed
        return part if touched or self.is_open else None


class Subscription(Generic[_T]):
    """Queue of changes: iterate, or call :meth:`get` or :meth:`drain`.

    Works from threads (``for change in subscription``) and from an event loop
    (``async for change in subscription``). Iteration ends when either side closes it.

    Parameters
    ----------
    past
        Changes to deliver before the first one that is put.
    once
        Whether to end after the first change.
    end
        Called once when the subscription ends.
    on_ready
        Called from another thread whenever a change or the end arrives. It must not block; pass
        for example ``lambda: loop.call_soon_threadsafe(event.set)``.
    """

    def __init__(
        self,
        end: Callable[[], None],
        past: Iterator[_T] | None = None,
        once: bool = False,
        size: int = QUEUE,
        on_ready: Callable[[], None] | None = None,
    ) -> None:
        self.on_ready = on_ready
        self._end: Callable[[], None] | None = end
        self._past = past
        self._once = once
        self._size = size
        self._changed = threading.Condition()
        self._waiting: deque[_T] = deque()
        self._error: RtaskError | None = None
        self._closed = False

    @property
    def closed(self) -> bool:
        """Whether the subscription has ended."""
        return self._closed

    def put(self, item: _T, seq: int, resume: str) -> None:
        """Add a change without waiting; called by the feed."""
        with self._changed:
            if self._closed or self._error is not None:
                return
            if len(self._waiting) >= self._size:
                self._error = Lagged(
                    f"{self._size} changes are unread; subscribe again with since={resume!r}",
                    seq=seq,
                    since=resume,
                )
            else:
                self._waiting.append(item)
            self._changed.notify_all()
        self._tell()

    def fail(self, error: RtaskError) -> None:
        """End with an error once the waiting changes have been read."""
        with self._changed:
            if self._error is None:
                self._error = error
            self._changed.notify_all()
        self._tell()

    def _tell(self) -> None:
        ready = self.on_ready
        if ready is not None:
            with contextlib.suppress(RuntimeError):  # its event loop has been closed
                ready()

    def get(self, timeout_s: float | None = None) -> _T | None:
        """Return the next change, or ``None`` at the timeout; zero does not wait.

        Raises
        ------
        Lagged
            Too many changes were unread; all changes before that have been returned.
        ClosedError
            The subscription has ended.
        """
        item = self._next_past()
        if item is None:
            item = self._next_waiting(timeout_s)
        if item is not None and self._once:
            self.close()
        return item

    def _next_past(self) -> _T | None:
        past = self._past
        if past is None or self._closed:
            return None
        item = next(past, None)
        if item is None:
            self._past = None
        return item

    def _next_waiting(self, timeout_s: float | None) -> _T | None:
        until = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._waiting:
                if self._closed:
                    raise ClosedError("the subscription has ended")
                if self._error is not None:
                    break
                left = None if until is None else until - time.monotonic()
                if left is not None and left <= 0:
                    return None
                self._changed.wait(left)
            else:
                return self._waiting.popleft()
        error = self._error
        self.close()
        raise error

    def drain(self, limit: int = 1_000) -> list[_T]:
        """Return up to ``limit`` unread changes without waiting; raises like :meth:`get`."""
        items: list[_T] = []
        while len(items) < limit:
            if items and not self._has_more():
                break
            item = self.get(0.0)
            if item is None:
                break
            items.append(item)
        return items

    def _has_more(self) -> bool:
        return not self._closed and (self._past is not None or bool(self._waiting))

    def close(self) -> None:
        """End the subscription, from any thread."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._past = None
            self._changed.notify_all()
            end, self._end = self._end, None
        if end is not None:
            end()
        self._tell()

    def __iter__(self) -> Iterator[_T]:
        with contextlib.suppress(ClosedError):
            while True:
                item = self.get()
                if item is not None:
                    yield item

    def __aiter__(self) -> AsyncIterator[_T]:
        return self._follow()

    async def _follow(self) -> AsyncIterator[_T]:
        import asyncio

        event = asyncio.Event()
        loop = asyncio.get_running_loop()

        def ready() -> None:
            loop.call_soon_threadsafe(event.set)

        self.on_ready = ready
        with contextlib.suppress(ClosedError):
            while True:
                event.clear()
                if self._past is not None:  # reads files
                    item = await asyncio.to_thread(self.get, 0.0)
                else:
                    item = self.get(0.0)
                if item is not None:
                    yield item
                else:
                    await event.wait()

    def __enter__(self) -> Subscription[_T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
