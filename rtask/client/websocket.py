"""Service calls over a rosbridge websocket (rosbridge protocol 2, ``call_service``)."""

from __future__ import annotations

import contextlib
import itertools
import json
import threading
import time
from typing import Any

from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    ForbiddenError,
    RemoteUnavailableError,
    RtaskError,
)

__all__ = ["ServiceSocket"]

_MOST_BYTES = 64 * 2**20


class ServiceSocket:
    """One websocket, opened when it is needed and again when it was lost.

    Parameters
    ----------
    address
        ``ws://host:port/rosbridge``.
    token
        Sent as a bearer token.
    timeout_s
        For opening, and for each answer.
    """

    def __init__(self, address: str, token: str | None, timeout_s: float) -> None:
        self._address = address
        self._token = token
        self._timeout_s = timeout_s
        self._ids = itertools.count(1)
        self._lock = threading.Lock()
        self._socket: Any = None
        self._opened = contextlib.ExitStack()

    def call(self, service: str, args: dict[str, Any], may_repeat: bool) -> dict[str, Any]:
        """Call a service and return its answer.

        Parameters
        ----------
        may_repeat
            Whether the call may be sent again on a new connection after the old one was lost.

        Raises
        ------
        RemoteUnavailableError
            Not connected, or no answer in time.
        CallFailedError
            The server's words.
        """
        deadline = time.monotonic() + self._timeout_s
        pause = 0.1
        with self._lock:
            while True:
                sent = False
                try:
                    self._open(deadline)
                    number = self._send(service, args)
                    sent = True
                    return self._receive(number, deadline)
                except (OSError, EOFError) as error:
                    self._drop()
                    self._check_repeat(sent, may_repeat, deadline - pause, error)
                    time.sleep(pause)
                    pause = min(2 * pause, 2.0)

    def close(self) -> None:
        """Close the websocket."""
        with self._lock:
            self._drop()

    def _check_repeat(
        self, sent: bool, may_repeat: bool, deadline: float, error: Exception
    ) -> None:
        """Raise unless the call is to be tried again."""
        if isinstance(error, TimeoutError):
            raise RemoteUnavailableError(
                f"no answer from {self._address} within {self._timeout_s:g} s"
            ) from error
        if sent and not may_repeat:
            raise RemoteUnavailableError(
                f"{self._address}: the connection was lost; the call may have been carried out"
            ) from error
        if time.monotonic() >= deadline:
            raise RemoteUnavailableError(f"{self._address} cannot be reached: {error}") from error

    def _open(self, deadline: float) -> None:
        if self._socket is not None:
            return
        from websockets.exceptions import InvalidHandshake, InvalidStatus
        from websockets.sync.client import connect

        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        try:
            context = connect(
                self._address,
                additional_headers=headers,
                compression=None,  # clouds are compressed already
                max_size=_MOST_BYTES,
                open_timeout=max(deadline - time.monotonic(), 0.1),
                ping_interval=None,  # the server pings; a long upload must not be cut off
                close_timeout=1.0,
                proxy=None if _is_near(self._address) else True,
            )
            self._socket = self._opened.enter_context(context)
        except InvalidStatus as error:
            raise _refusal(self._address, error.response.status_code, error) from error
        except InvalidHandshake as error:
            raise OSError(str(error)) from error

    def _send(self, service: str, args: dict[str, Any]) -> str:
        from websockets.exceptions import ConnectionClosed

        number = f"call_service:{service}:{next(self._ids)}"
        message: dict[str, Any] = {"op": "call_service", "id": number, "service": service}
        message.update(args=args, timeout=self._timeout_s)
        try:
            self._socket.send(json.dumps(message, allow_nan=False))
        except ConnectionClosed as error:
            raise EOFError(str(error)) from error
        return number

    def _receive(self, number: str, deadline: float) -> dict[str, Any]:
        """Wait for the answer of one call; those that came too late for others are dropped."""
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                text = self._socket.recv(timeout=max(deadline - time.monotonic(), 0.001))
            except ConnectionClosed as error:
                raise EOFError(str(error)) from error
            message = json.loads(text)
            if message.get("op") == "status" and message.get("id") == number:
                raise CallFailedError(str(message.get("msg")))
            if message.get("op") != "service_response" or message.get("id") != number:
                continue
            values = message.get("values")
            if message.get("result") is not True:
                raise CallFailedError(str(values))
            return values if isinstance(values, dict) else {}

    def _drop(self) -> None:
        self._opened.close()
        self._socket = None


def _is_near(address: str) -> bool:
    from urllib.parse import urlsplit

    return (urlsplit(address).hostname or "") in ("localhost", "127.0.0.1", "::1")


def _refusal(address: str, status: int, error: Exception) -> RtaskError | OSError:
    if status == 401:
        return AuthenticationError(f"{address} wants a valid token")
    if status == 403:
        return ForbiddenError(f"{address} refuses this caller")
    return OSError(f"{address} answered {status}: {error}")
