"""Requests that the server's protocol answers itself, in the place of uvicorn's own cycle."""

from __future__ import annotations

from typing import Any

from endpoint.http.plan import RunningQuery

__all__ = ["Exchange"]


class Exchange:
    """One request in progress; the attributes are those that uvicorn reads or sets, and a few more.

    Parameters
    ----------
    scope
        The request, as ASGI describes it.
    keep_alive
        Whether the connection stays open after the answer.
    method, raw_path, query_string
        Its first line as sent.

    Attributes
    ----------
    running
        The query, once it runs; stopped when the client leaves.
    """

    __slots__ = (
        *("body", "disconnected", "keep_alive", "method", "more_body", "query_string"),
        *("raw_path", "response_complete", "running", "scope"),
    )

    def __init__(
        self, scope: Any, keep_alive: bool, method: str, raw_path: bytes, query_string: bytes
    ) -> None:
        self.scope = scope
        self.keep_alive = keep_alive
        self.method = method
        self.raw_path = raw_path
        self.query_string = query_string
        self.response_complete = False
        self.disconnected = False
        self.more_body = True
        self.body = b""
        self.running: RunningQuery | None = None

    @property
    def message_event(self) -> Exchange:
        """Event that uvicorn sets when the client leaves."""
        return self

    def set(self) -> None:
        """Stop the query if the client has gone."""
        if self.disconnected and self.running is not None:
            self.running.stop()
