"""Robots' current activity as server-sent events at ``/activity/events``.

Each event has an id ``<epoch>:<seq>/<run>.<number>``: the version of the graph and the number in
the log of this server. A browser that reconnects sends it back. It then receives what it missed:
from the log if the server is the same, else from the commits, which outlive the server.
"""

from __future__ import annotations

import asyncio
import re
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from endpoint.activity.commits import commit_events
from endpoint.activity.log import Event, as_json
from endpoint.follow.event_stream import EventStream, Streams
from endpoint.follow.events import event as sse
from endpoint.http.messages import Request
from endpoint.served import embedded
from rtask.errors import RtaskError, UsageError

if TYPE_CHECKING:
    from endpoint.access.auth import Caller
    from endpoint.context import ServerContext

__all__ = ["ActivityStream", "past_events", "place_of"]

MAX_PAST = 2_000
_ID = re.compile(r"(?P<version>[^/\s]+)(?:/(?P<run>[0-9a-f]+)\.(?P<number>\d{1,15}))?")
_NUMBER = re.compile(r"[0-9]{1,15}")


class ActivityStream(EventStream):
    """The events of the activity log, and those missed before.

    Parameters
    ----------
    streams
        The collection to which it belongs.
    context
        The parts of the server.
    request
        The request that opened it; ``Last-Event-ID`` or ``since`` say where to begin.
    caller
        The follower.
    """

    def __init__(
        self, streams: Streams, context: ServerContext, request: Request, caller: Caller
    ) -> None:
        super().__init__(streams, request, caller)
        self._context = context
        self._log = context.activity
        self._sent = self._log.last
        self._stop = self._log.listen(lambda _: self.wake())

    def close(self) -> None:
        """Stop following."""
        self._stop()

    async def pieces(self) -> AsyncIterator[bytes]:
        """Yield a greeting, what was missed, and events as they come."""
        yield sse("hello", {"version": self.begin, "run": self._log.run})
        for piece in await asyncio.to_thread(self._missed):
            yield piece
        while not self.reason:
            self.ready.clear()
            events = self._log.after(self._sent)
            if events and events[0].number > self._sent + 1:
                yield sse("gap", {"missed": events[0].number - self._sent - 1})
            if events:
                self._sent = events[-1].number
                yield b"".join(self._piece(event) for event in events)
            elif not await self.wait():
                yield b": still here\n\n"

    def _missed(self) -> list[bytes]:
        """Return the events since the place that the client names."""
        given = self.request.values("since")
        since = self.request.header("last-event-id").strip() or (given[-1] if given else "")
        match = _ID.fullmatch(since)
        if match is None:
            return []
        if match["run"] == self._log.run:
            self._sent = min(int(match["number"]), self._sent)
            return []
        try:
            events = past_events(self._context, match["version"])
        except RtaskError as error:
            return [sse("gap", {"detail": str(error)})]
        sent = {event.seq for event in events}
        mine = [event for event in self._log.after(0) if event.number <= self._sent]
        rest = [event for event in mine if event.seq not in sent]
        return [self._piece(event) for event in (*events, *rest)]

    def _piece(self, event: Event) -> bytes:
        data: dict[str, Any] = as_json(event)
        lane = self._log.lane(event.who)
        if lane is not None:
            data["lane"] = asdict(lane)
        return sse("activity", data, place_of(self._context, event))


def place_of(context: ServerContext, event: Event | None) -> str:
    """Return the id of an event, or of the present moment."""
    kb, log = context.kb, context.activity
    number = event.number if event is not None else log.last
    seq = event.seq if event is not None and event.seq else kb.seq
    return f"{kb.epoch}:{seq}/{log.run}.{number}"


def past_events(context: ServerContext, version: str, most: int = MAX_PAST) -> list[Event]:
    """Return what the commits after a version tell, the last ones if there are too many.

    Raises
    ------
    RtaskError
        The commits after the version are not kept, or the graph is stored elsewhere.
    """
    kb = embedded(context.kb, "activity")
    epoch, _, number = version.rpartition(":")
    if epoch not in ("", kb.epoch) or not _NUMBER.fullmatch(number):
        raise UsageError(f"since={version[:80]}: expected {kb.epoch}:<number of a commit>")
    kb.feed.require_retained(int(number))
    events: deque[Event] = deque(maxlen=most)
    for change in kb.feed.changes(int(number), kb.feed.last_seq):
        events.extend(commit_events(kb, change))
    return list(events)
