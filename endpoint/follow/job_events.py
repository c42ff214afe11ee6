"""One job as server-sent events: ``GET /jobs/<id>`` with ``Accept: text/event-stream``."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

from endpoint.api.services import event_number, job_facts
from endpoint.follow.event_stream import COMMENT_S, EVENT_STREAM, EventStream, Streams
from endpoint.follow.events import event
from endpoint.http.messages import RefusedError, Request
from endpoint.routes.addresses import JOBS
from rtask.errors import UnknownTermError
from rtask.services.jobs import ENDED

if TYPE_CHECKING:
    from endpoint.access.auth import Caller
    from rtask.services import ServiceHost

__all__ = ["JobStream", "is_followed"]

_PAUSE_S = 0.1


def is_followed(request: Request) -> bool:
    """Tell whether a request follows a job."""
    return (
        request.method in ("GET", "HEAD")
        and request.raw_path.startswith(f"{JOBS}/")
        and EVENT_STREAM in request.header("accept")
    )


class JobStream(EventStream):
    """The progress of a job, at most ten events a second, and its end.

    An event ``progress`` carries the newest report alone; ``ended`` carries the job with its answer
    or its problem and closes the stream. A client that reconnects sends back the number of the last
    event that it received, as ``Last-Event-ID``.

    Parameters
    ----------
    streams
        The collection to which it belongs.
    services
        The host that keeps the job.
    request
        The request that opened it.
    caller
        The owner of the job.

    Raises
    ------
    RefusedError
        404: the caller has no such job.
    UsageError
        ``after`` is no number.
    """

    def __init__(
        self, streams: Streams, services: ServiceHost, request: Request, caller: Caller
    ) -> None:
        try:
            job = services.jobs.find(request.path.removeprefix(f"{JOBS}/").strip("/"), caller.key)
        except UnknownTermError as error:
            raise RefusedError(404, "not-found", str(error)) from None
        self._sent = event_number(request)
        super().__init__(streams, request, caller, begin="")
        self._job = job
        self._stop = job.listen(self.wake)

    def close(self) -> None:
        """Stop following; the job goes on."""
        self._stop()

    async def pieces(self) -> AsyncIterator[bytes]:
        """Yield reports of progress, and the end."""
        job = self._job
        while not self.reason:
            self.ready.clear()
            has_ended = job.state in ENDED
            events = job.events(self._sent)
            if events:
                self._sent = events[-1][0]
            if has_ended or (events and events[-1][1]["state"] in ENDED):
                yield event("ended", job_facts(job), str(self._sent))
                return
            if events:
                yield event("progress", events[-1][1], str(self._sent))
                await asyncio.sleep(_PAUSE_S)
            elif not await self.wait(min(COMMENT_S, max(job.task.call.left_s, _PAUSE_S))):
                yield b": still here\n\n"
