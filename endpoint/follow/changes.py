"""Change notifications at ``/changes``, as server-sent events and over a websocket.

Every event carries the version after it, ``<epoch>:<seq>``. A follower that lost its connection
sends the last version back (``Last-Event-ID`` or ``since``) and receives what it missed, nothing
twice. One that reads too slowly is told so and disconnected; one whose version is no longer kept is
told by an event of its own.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any

from endpoint.access.auth import Caller, cors_headers
from endpoint.context import ServerContext
from endpoint.follow.activity import ActivityStream
from endpoint.follow.event_stream import EventStream
from endpoint.follow.events import (
    MAX_PATTERNS,
    NAMES,
    Follower,
    change_data,
    event,
    read_pattern,
    version_of,
)
from endpoint.follow.job_events import JobStream, is_followed
from endpoint.follow.replication import RecordStream
from endpoint.follow.socket import ChangeSocket
from endpoint.http.messages import (
    JSON_TYPE,
    RefusedError,
    Request,
    Response,
    refuse_unknown,
    require_method,
)
from endpoint.http.websocket import Message, Receive, Transmit, refuse_handshake
from endpoint.rosbridge.messages import encode, parse
from endpoint.routes import Route, find
from endpoint.routes.addresses import CHANGES, JOBS
from endpoint.served import embedded
from rtask.errors import (
    ClosedError,
    EpochChangedError,
    GoneError,
    Lagged,
    RtaskError,
    UsageError,
)
from rtask.knowledge_base import KnowledgeBase

MAX_STREAMS = 2_000
MAX_STREAMS_PER_CALLER = 20


class Changes:
    """All clients that follow the graph over HTTP.

    Parameters
    ----------
    context
        The parts of the server.
    """

    def __init__(self, context: ServerContext) -> None:
        self._context = context
        self._streams: set[EventStream] = set()
        self._sockets: set[ChangeSocket] = set()
        self._held: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._streams) + len(self._sockets)

    @property
    def _kb(self) -> KnowledgeBase:
        return embedded(self._context.kb, "the change feed")

    @staticmethod
    def serves(path: str) -> bool:
        """Tell whether an address belongs to change notifications."""
        return any(route.lane == "stream" for route in find(path.rstrip("/")).routes)

    @classmethod
    def follows(cls, request: Request) -> bool:
        """Tell whether a request is for a stream of events, or for one commit."""
        if request.method == "OPTIONS":
            return False
        return cls.serves(request.raw_path) or is_followed(request)

    def open(self, request: Request) -> Response | EventStream:
        """Return one commit, or a stream that is yet to be sent.

        Raises
        ------
        RtaskError
            The request is refused.
        """
        context = self._context
        route = _route(request)
        caller = context.auth.identify(request)
        context.rights.require(route.right, request, caller)
        if is_followed(request):
            self._admit(caller)
            number = request.path.removeprefix(f"{JOBS}/").strip("/")
            following = context.following
            # The job runs where it was begun, and only there are its events.
            if following is not None and not context.services.jobs.has(number, caller.key):
                return following.redirect(request)
            return JobStream(self, context.services, request, caller)
        if route.handler == "activity":
            self._admit(caller)
            return ActivityStream(self, context, request, caller)
        if route.handler == "records":
            self._admit(caller)
            return RecordStream(self, request, caller, self._kb, context.tokens)
        rest = request.path.removeprefix(CHANGES).strip("/")
        if rest:
            return self._commit(rest)
        self._admit(caller)
        return Stream(self, request, caller)

    def _admit(self, caller: Caller) -> None:
        # Programs without a token share a key: a bound on one would be a bound on all.
        own = self._held[caller.key] if caller.token else 0
        if own >= MAX_STREAMS_PER_CALLER or len(self) >= MAX_STREAMS:
            raise RefusedError(
                503,
                "busy",
                f"{own or len(self)} streams are open already",
                headers=(("Retry-After", "10"),),
            )

    def _commit(self, number: str) -> Response:
        """Return one whole commit, for followers whose event was truncated."""
        feed = self._kb.feed
        # A longer number is no commit, and a very long one is slow to read.
        seq = int(number) if number.isdecimal() and len(number) < 18 else -1
        changes = list(feed.changes(seq - 1, seq)) if 0 < seq <= feed.last_seq else []
        if not changes:
            raise RefusedError(404, "not-found", f"no commit {number[:20]} is kept")
        return Response(200, encode(change_data(changes[0], None)).encode(), JSON_TYPE)

    async def serve_socket(
        self, request: Request, scope: Message, receive: Receive, transmit: Transmit
    ) -> None:
        """Serve a websocket from its handshake to its end."""
        await receive()  # websocket.connect
        try:
            if request.path.rstrip("/") != CHANGES:
                raise RefusedError(404, "not-found", f"followers connect to {CHANGES}")
            caller = self._context.auth.identify(request, ticket_in_url=True)
            self._context.auth.check_origin(request, caller)
            self._context.rights.require(_route(request).right, request, caller)
            self._admit(caller)
            kb = self._kb
        except RtaskError as error:
            await refuse_handshake(scope, transmit, error)
            return
        await transmit({"type": "websocket.accept"})
        socket = ChangeSocket(kb, caller, receive, transmit)
        self._sockets.add(socket)
        self._held[caller.key] += 1
        try:
            await socket.run()
        finally:
            self._sockets.discard(socket)
            self._forget(caller)

    async def close_revoked(self) -> None:
        """Disconnect the followers whose token has been revoked."""
        everybody: list[EventStream | ChangeSocket] = [*self._streams, *self._sockets]
        for stream in everybody:
            if not self._context.auth.still_valid(stream.caller):
                await stream.end("token revoked", 1008)

    async def close_all(self) -> None:
        """Disconnect all followers because the server stops."""
        everybody: list[EventStream | ChangeSocket] = [*self._streams, *self._sockets]
        await asyncio.gather(*(stream.end("server stops", 1012) for stream in everybody))

    def add(self, stream: EventStream) -> None:
        """Count a stream in."""
        self._streams.add(stream)
        self._held[stream.caller.key] += 1

    def remove(self, stream: EventStream) -> None:
        """Count a stream out."""
        self._streams.discard(stream)
        self._forget(stream.caller)

    def _forget(self, caller: Caller) -> None:
        self._held[caller.key] -= 1
        if not self._held[caller.key]:
            del self._held[caller.key]

    def follower(
        self, request: Request, now: str, on_ready: Callable[[], None]
    ) -> tuple[Follower, RtaskError | None]:
        """Return a follower of what a request names, and what the client must be told of a gap.

        A browser that reconnects by itself with a version that is no longer kept follows from now
        on, and the error says what it missed. A stale ``since`` is refused instead, because a
        program reads that answer.
        """
        refuse_unknown((name for name, _ in request.parameters), ("since", "pattern", *NAMES))
        patterns = _patterns(request)
        resumed = request.header("last-event-id").strip()
        given = request.values("since")
        since = resumed or (given[-1] if given else now)
        try:
            return Follower(self._kb, patterns, since, on_ready), None
        except (GoneError, EpochChangedError) as error:
            # A client that came anew is refused; one that resumes hears of the gap, and goes on
            # from now.
            if not resumed:
                raise
            return Follower(self._kb, patterns, now, on_ready), error

    def version(self) -> str:
        """Return the current version."""
        return version_of(self._kb)

    def cors(self, request: Request) -> tuple[tuple[str, str], ...]:
        """Return the header fields that let a page of another origin read the stream."""
        return cors_headers(request, self._context.config)

    def position(self, seq: int) -> str:
        """Return the version after a commit."""
        return f"{self._kb.epoch}:{seq}"


class Stream(EventStream):
    """The commits that fit some patterns, as a stream of server-sent events.

    Parameters
    ----------
    changes
        The collection to which it belongs.
    request
        The request that opened it.
    caller
        The follower.
    """

    def __init__(self, changes: Changes, request: Request, caller: Caller) -> None:
        super().__init__(changes, request, caller)
        self._changes = changes
        self._follower, self._missed = changes.follower(request, self.begin, self.wake)

    def close(self) -> None:
        """Stop following."""
        self._follower.close()

    async def pieces(self) -> AsyncIterator[bytes]:
        """Yield a greeting and the commits."""
        epoch = self.begin.partition(":")[0]
        yield event("hello", {"version": self.begin, "epoch": epoch})
        if self._missed is not None:
            kind = "epoch" if isinstance(self._missed, EpochChangedError) else "gone"
            facts = {"detail": str(self._missed), "version": self.begin, **self._missed.details}
            yield event(kind, facts, self.begin)
        live = False
        try:
            while not self.reason:
                self.ready.clear()
                if live:
                    changes = self._follower.drain()
                else:  # what was missed is read from files
                    changes = await asyncio.to_thread(self._follower.drain)
                    live = not changes
                    if live:
                        continue
                for change in changes:
                    position = self._changes.position(change.commit.seq)
                    yield event("change", change_data(change), position)
                # A comment line now and then, so that proxies do not take silence for an end.
                if not changes and not await self.wait():
                    yield b": still here\n\n"
        except Lagged as error:
            yield event("lagged", {"detail": str(error), **error.details})
        except ClosedError:
            self.reason = "the store was closed"


def _route(request: Request) -> Route:
    """Return the line of the table for a request.

    Raises
    ------
    RefusedError
        405.
    """
    match = find(request.raw_path.rstrip("/"))
    route = match.by(request.method)
    if route is None:
        require_method(request, match.allow)
        raise RefusedError(404, "not-found", f"there is nothing at {request.path}")
    return route


def _patterns(request: Request) -> list[Any]:
    """Return the patterns in a request: parameters, ``pattern=`` as JSON, or a JSON body."""
    given: list[Any] = []
    if request.method == "POST":
        media_type, _ = request.content_type
        if media_type != JSON_TYPE:
            raise RefusedError(415, "unsupported-media-type", f"send patterns as {JSON_TYPE}")
        try:
            body = parse(request.body.decode("utf-8"))
        except UnicodeDecodeError:
            raise UsageError("the body is not UTF-8") from None
        listed = body.get("patterns", [])
        if not isinstance(listed, list):
            raise UsageError("patterns: expected a list")
        given += listed
    given += [parse(text) for text in request.values("pattern")]
    single = {name: values[-1] for name in NAMES if (values := request.values(name))}
    if single:
        given.append(single)
    if len(given) > MAX_PATTERNS:
        raise UsageError(f"{len(given)} patterns; at most {MAX_PATTERNS}")
    return [read_pattern(pattern) for pattern in given]
