"""Requests that the server's protocol answers itself, in the place of uvicorn's own cycle."""

from __future__ import annotations

from endpoint.application import Job

__all__ = ["Exchange"]


class Exchange:
    """One request in progress; the attributes are those that uvicorn reads or sets.

    Parameters
    ----------
    keep_alive
        Whether the connection stays open after the answer.
    """

    __slots__ = ("begun", "disconnected", "job", "keep_alive", "response_complete")

    def __init__(self, keep_alive: bool) -> None:
        self.keep_alive = keep_alive
        self.response_complete = False
        self.disconnected = False
        self.job: Job | None = None
        self.begun = False

    @property
    def message_event(self) -> Exchange:
        """What uvicorn sets when the client has gone."""
        return self

    def set(self) -> None:
        """Stop the query if the client has gone."""
        if self.disconnected and self.job is not None and self.job.plan.running is not None:
            self.job.plan.running.stop()
