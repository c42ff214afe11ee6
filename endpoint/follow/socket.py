"""Websocket that follows patterns and queries, each under an id that the client chooses."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any, Protocol

from endpoint.access.auth import Caller
from endpoint.follow.events import (
    MAX_PATTERNS,
    Follower,
    change_data,
    read_pattern,
    rows_data,
    version_of,
)
from endpoint.http.problems import details_of
from endpoint.http.websocket import (
    STALL_S,
    TRY_AGAIN_LATER,
    Message,
    Outbox,
    Receive,
    Transmit,
)
from endpoint.rosbridge.messages import JsonObject, encode, parse
from rtask.errors import ClosedError, EpochChangedError, GoneError, Lagged, RtaskError, UsageError
from rtask.knowledge_base import KnowledgeBase

MAX_SUBSCRIPTIONS = 100
MAX_PATTERNS_IN_ALL = 1_000


class _Source(Protocol):
    """A source of changes."""

    def drain(self, limit: int = ...) -> list[Any]:
        """Return the changes since the last call."""

    def close(self) -> None:
        """Stop following."""


class ChangeSocket:
    """One connection.

    Parameters
    ----------
    kb
        The knowledge base that is followed.
    caller
        The client.
    receive, transmit
        The two halves of the connection, which has been accepted.
    """

    def __init__(
        self, kb: KnowledgeBase, caller: Caller, receive: Receive, transmit: Transmit
    ) -> None:
        self.caller = caller
        self._kb = kb
        self._receive = receive
        self._transmit = transmit
        self._loop = asyncio.get_running_loop()
        self._outbox = Outbox(self._loop)
        self._tasks: dict[Any, asyncio.Task[None]] = {}
        self._patterns: dict[Any, int] = {}
        self._closing = False

    async def run(self) -> None:
        """Read until the client leaves."""
        writer = asyncio.create_task(self._write())
        self._tell({"op": "hello", "version": self._version(), "epoch": self._kb.epoch})
        try:
            while (message := await self._receive())["type"] != "websocket.disconnect":
                self._take(message)
                await self._outbox.wait_for_room()
        finally:
            self._closing = True
            self._outbox.close()
            tasks = [*self._tasks.values(), writer]
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def end(self, reason: str, code: int) -> None:
        """Close the connection from this side."""
        if self._closing:
            return
        self._closing = True
        with contextlib.suppress(RuntimeError, OSError):
            await self._transmit({"type": "websocket.close", "code": code, "reason": reason})

    def _version(self) -> str:
        return version_of(self._kb)

    def _tell(self, message: JsonObject) -> None:
        self._outbox.put(encode(message))

    def _take(self, message: Message) -> None:
        """Carry out one message; errors are sent back."""
        request: JsonObject = {}
        try:
            request = parse(message.get("text") or "")
            op = request.get("op")
            handler = {
                "subscribe": self._subscribe,
                "query": self._query,
                "unsubscribe": self._unsubscribe,
            }.get(op if isinstance(op, str) else "")
            if handler is None:
                raise UsageError(f"unknown op {op!r}; one of subscribe, query, unsubscribe")
            if not isinstance(request.get("id"), str | int):
                raise UsageError("id: expected a text or number of your own")
            handler(request)
        except RtaskError as error:
            self._tell_error(request.get("id"), error)

    def _tell_error(self, id_: Any, error: RtaskError) -> None:
        kinds = ((GoneError, "gone"), (EpochChangedError, "epoch"), (Lagged, "lagged"))
        op = next((name for kind, name in kinds if isinstance(error, kind)), "error")
        facts = {"op": op, "version": self._version(), **details_of(error)}
        self._tell({**facts, "id": id_} if id_ is not None else facts)

    def _subscribe(self, request: JsonObject) -> None:
        given = request.get("patterns", [])
        if not isinstance(given, list) or len(given) > MAX_PATTERNS:
            raise UsageError(f"patterns: expected a list of at most {MAX_PATTERNS}")
        since = request.get("since")
        if since is not None and not isinstance(since, str | int):
            raise UsageError("since: expected a version, <epoch>:<seq>")
        patterns = [read_pattern(pattern) for pattern in given]
        if sum(self._patterns.values()) + len(patterns) > MAX_PATTERNS_IN_ALL:
            raise UsageError(f"more than {MAX_PATTERNS_IN_ALL} patterns on one connection")
        id_, begin = request["id"], self._version()

        def open_(on_ready: Callable[[], None]) -> _Source:
            return Follower(self._kb, patterns, begin if since is None else str(since), on_ready)

        def words(change: Any) -> JsonObject:
            version = f"{self._kb.epoch}:{change.commit.seq}"
            return {"op": "change", "id": id_, "version": version, **change_data(change)}

        self._follow(id_, open_, words)
        self._patterns[id_] = len(patterns)

    def _query(self, request: JsonObject) -> None:
        text = request.get("select")
        if not isinstance(text, str):
            raise UsageError("select: expected the text of a SELECT")
        id_ = request["id"]

        def open_(on_ready: Callable[[], None]) -> _Source:
            return self._kb.subscribe_query(text, on_ready=on_ready)

        def words(change: Any) -> JsonObject:
            return {"op": "rows", "id": id_, **rows_data(change)}

        self._follow(id_, open_, words)

    def _unsubscribe(self, request: JsonObject) -> None:
        task = self._tasks.pop(request["id"], None)
        self._patterns.pop(request["id"], None)
        if task is None:
            raise UsageError(f"nothing is followed under {request['id']!r}")
        task.cancel()
        self._tell({"op": "unsubscribed", "id": request["id"]})

    def _follow(
        self,
        id_: Any,
        open_: Callable[[Callable[[], None]], _Source],
        words: Callable[[Any], JsonObject],
    ) -> None:
        if id_ in self._tasks:
            raise UsageError(f"something is followed under {id_!r} already")
        if len(self._tasks) >= MAX_SUBSCRIPTIONS:
            raise UsageError(f"more than {MAX_SUBSCRIPTIONS} subscriptions on one connection")
        self._tasks[id_] = asyncio.create_task(self._pump(id_, open_, words))

    async def _pump(
        self,
        id_: Any,
        open_: Callable[[Callable[[], None]], _Source],
        words: Callable[[Any], JsonObject],
    ) -> None:
        """Forward changes as fast as the client reads."""
        ready = asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(ready.set)

        source: _Source | None = None
        try:
            version = self._version()
            source = await asyncio.to_thread(open_, wake)
            self._tell({"op": "subscribed", "id": id_, "version": version})
            while True:
                ready.clear()
                changes = await asyncio.to_thread(source.drain, 100)
                for change in changes:
                    await self._outbox.wait_for_room()
                    self._tell(words(change))
                if not changes:
                    await ready.wait()
        except ClosedError:
            await self.end("the store was closed", TRY_AGAIN_LATER)
        except RtaskError as error:
            self._tell_error(id_, error)
        finally:
            if source is not None:
                source.close()
            if self._tasks.get(id_) is asyncio.current_task():
                self._tasks.pop(id_, None)
                self._patterns.pop(id_, None)

    async def _write(self) -> None:
        try:
            while True:
                text = await self._outbox.take()
                async with asyncio.timeout(STALL_S):
                    await self._transmit({"type": "websocket.send", "text": text})
        except TimeoutError:
            await self.end("nothing read for too long", TRY_AGAIN_LATER)
        except (RuntimeError, OSError):
            self._outbox.close()
