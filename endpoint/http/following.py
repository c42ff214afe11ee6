"""Interface between a server and what makes it a follower of another one."""

from __future__ import annotations

from typing import Protocol

from endpoint.http.messages import Request, Response

__all__ = ["Following"]


class Following(Protocol):
    """The connection to the server that this one follows."""

    @property
    def url(self) -> str:
        """Address of the other server."""

    @property
    def seconds_behind(self) -> float:
        """Age of the newest state that is known to be here, s."""

    @property
    def commits_behind(self) -> int:
        """Number of commits of the other server that are not here yet, as far as is known."""

    @property
    def is_connected(self) -> bool:
        """Whether the other server has been heard of in the last seconds."""

    @property
    def forwards(self) -> bool:
        """Whether writes are passed on; if not, answers name the address that takes them."""

    @property
    def records_waiting(self) -> int:
        """Number of records of what robots asked that the other server does not have yet."""

    @property
    def records_dropped(self) -> int:
        """Number of such records that were dropped, because there were too many or it refused."""

    def deliver_records(self) -> None:
        """Wait a moment until the other server has the records that wait."""

    def forward(self, request: Request) -> Response:
        """Let the other server answer a request."""

    def redirect(self, request: Request) -> Response:
        """Send a caller to the other server."""

    def catch_up(self) -> None:
        """Wait a moment for what the other server has committed by now."""
