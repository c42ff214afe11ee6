"""Requests that the server's protocol answers itself, in the place of uvicorn's own cycle."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from endpoint.application import Job

__all__ = ["Exchange"]


class Exchange:
    """One request in progress; the attributes are those that uvicorn reads or sets, and a few more.

    Parameters
    ----------
    keep_alive
        Whether the connection stays open after the answer.
    scope
        The request, as ASGI describes it; none until somebody needs it.
    """

    __slots__ = (
        *("begun", "body", "disconnected", "job", "keep_alive"),
        *("response_complete", "scope", "timer"),
    )

    def __init__(self, keep_alive: bool, scope: Any = None) -> None:
        self.keep_alive = keep_alive
        self.scope = scope
        self.response_complete = False
        self.disconnected = False
        self.body = bytearray()
        self.job: Job | None = None
        self.begun = False
        self.timer: asyncio.TimerHandle | None = None

    @property
    def message_event(self) -> Exchange:
        """Event that uvicorn sets when a part of the body comes, and when the client leaves."""
        return self

    def set(self) -> None:
        """Stop the work if the client has gone."""
        if not self.disconnected or self.job is None:
            return
        plan = self.job.plan
        if plan.running is not None:
            plan.running.stop()
        elif plan.elsewhere is not None:
            plan.elsewhere.stop()

    def wait(
        self, loop: asyncio.AbstractEventLoop, seconds: float, late: Callable[[], None]
    ) -> None:
        """Call back after some seconds unless :meth:`stop_waiting` was called before."""
        self.timer = loop.call_later(seconds, late)

    def stop_waiting(self) -> bool:
        """Tell whether this still waits, and end it."""
        timer, self.timer = self.timer, None
        if timer is not None:
            timer.cancel()
        return timer is not None
