"""Service calls over a rosbridge websocket (rosbridge protocol 2, ``call_service``)."""

from __future__ import annotations

import contextlib
import itertools
import json
import threading
from typing import Any

from rtask.client.calling.messages import answer_values, open_socket, service_call
from rtask.client.failures import Patience
from rtask.errors import CallFailedError, RemoteUnavailableError

__all__ = ["ServiceSocket"]


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

    def call(
        self,
        service: str,
        args: dict[str, Any],
        may_repeat: bool,
        timeout_s: float | None = None,
    ) -> dict[str, Any]:
        """Call a service and return its answer.

        Parameters
        ----------
        may_repeat
            Whether the call may be sent again on a new connection after the old one was lost.
        timeout_s
            For this call, instead of the usual time.

        Raises
        ------
        RemoteUnavailableError
            Not connected, or no answer in time.
        CallFailedError
            The server's words.
        UsageError
            The arguments are not JSON, such as a number that is not finite.
        """
        patience = Patience(self._timeout_s if timeout_s is None else timeout_s)
        with self._lock:
            while True:
                sent = False
                try:
                    self._open(patience)
                    number = self._send(service, args, patience)
                    sent = True
                    return self._receive(number, patience)
                except (OSError, EOFError) as error:
                    self._drop()
                    self._check_repeat(sent, may_repeat, patience, error)
                except CallFailedError as error:
                    # Nobody had time for it: nothing was done, so it does no harm to ask again.
                    busy = error.details.get("http_status") in (429, 503) and error.is_transient
                    if not busy or not patience.wait():
                        raise

    def close(self) -> None:
        """Close the websocket."""
        with self._lock:
            self._drop()

    def _check_repeat(
        self, sent: bool, may_repeat: bool, patience: Patience, error: Exception
    ) -> None:
        """Pause before the call is tried again; raise if it must not be, or there is no time."""
        if isinstance(error, TimeoutError) and (sent or patience.left_s <= 0):
            raise RemoteUnavailableError(
                f"no answer from {self._address} within {patience.timeout_s:g} s"
            ) from error
        if sent and not may_repeat:
            raise RemoteUnavailableError(
                f"{self._address}: the connection was lost; the call may have been carried out"
            ) from error
        if not patience.wait():
            raise RemoteUnavailableError(f"{self._address} cannot be reached: {error}") from error

    def _open(self, patience: Patience) -> None:
        if self._socket is not None:
            return
        # The server pings; a long upload must not be cut off.
        self._socket = open_socket(
            self._opened, self._address, self._token, max(patience.left_s, 0.1), alive_s=None
        )

    def _send(self, service: str, args: dict[str, Any], patience: Patience) -> str:
        from websockets.exceptions import ConnectionClosed

        number = f"call_service:{service}:{next(self._ids)}"
        text = service_call(service, args, number, patience)
        try:
            self._socket.send(text)
        except ConnectionClosed as error:
            raise EOFError(str(error)) from error
        return number

    def _receive(self, number: str, patience: Patience) -> dict[str, Any]:
        """Wait for the answer of one call; those that came too late for others are dropped."""
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                text = self._socket.recv(timeout=max(patience.left_s, 0.001))
            except ConnectionClosed as error:
                raise EOFError(str(error)) from error
            message = json.loads(text)
            if message.get("op") in ("service_response", "status") and message.get("id") == number:
                return answer_values(message)

    def _drop(self) -> None:
        from websockets.exceptions import WebSocketException

        # Saying goodbye on a connection that was cut fails in its own ways; it is gone anyhow.
        with contextlib.suppress(WebSocketException, OSError):
            self._opened.close()
        self._opened = contextlib.ExitStack()
        self._socket = None
