"""Requests to the addresses of a server that are no service calls."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

from rtask.client.calling.messages import addresses
from rtask.client.failures import failure_of
from rtask.errors import RemoteUnavailableError
from rtask.wire.address import authorization, is_near

__all__ = ["HttpClient"]


class HttpClient:
    """A connection to a server over HTTP.

    Parameters
    ----------
    url
        Of the server.
    token
        Of the robot or person, for a server that asks for one.
    timeout_s
        For each request.
    """

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 60.0) -> None:
        import httpx

        address, _ = addresses(url)
        self._http = httpx.Client(
            base_url=address,
            headers=authorization(token),
            timeout=timeout_s,
            trust_env=not is_near(address),
        )

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _send(self, method: str, path: str, **options: Any) -> Any:
        import httpx

        try:
            answer = self._http.request(method, path, **options)
        except httpx.TransportError as error:
            where = self._http.base_url
            raise RemoteUnavailableError(f"{where} cannot be reached: {error}") from error
        if answer.is_error:
            raise failure_of(answer)
        return answer
