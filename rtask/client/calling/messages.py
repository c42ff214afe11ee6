"""Opening a websocket to a server, and the messages of a service call over it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from rtask.client.failures import Patience, error_of
from rtask.errors import (
    TRANSIENT_STATUSES,
    AuthenticationError,
    CallFailedError,
    ForbiddenError,
    RtaskError,
    UsageError,
)
from rtask.wire.address import authorization, is_near, split_address

__all__ = ["addresses", "answer_values", "open_socket", "refusal", "service_call"]

MAX_BYTES = 64 * 2**20


def addresses(url: str) -> tuple[str, str]:
    """Return the addresses for HTTP and for the websocket of a server.

    >>> addresses("http://127.0.0.1:8765")
    ('http://127.0.0.1:8765', 'ws://127.0.0.1:8765/rosbridge')
    >>> addresses("wss://graph.example.org/rosbridge")
    ('https://graph.example.org', 'wss://graph.example.org/rosbridge')
    """
    parts = split_address(url)
    secure = {"http": False, "ws": False, "https": True, "wss": True}.get(parts.scheme)
    if secure is None:
        raise UsageError(f"{url!r} is not the address of a server; expected http://host:port")
    path = parts.path.rstrip("/").removesuffix("/rosbridge")
    http, ws = ("https", "wss") if secure else ("http", "ws")
    return f"{http}://{parts.netloc}{path}", f"{ws}://{parts.netloc}{path}/rosbridge"


def open_socket(
    opened: ExitStack, address: str, token: str | None, open_s: float, alive_s: float | None = 20.0
) -> Any:
    """Open a websocket.

    Parameters
    ----------
    opened
        Closes it at its own end.
    open_s
        Longest wait, s.
    alive_s
        Time between pings, s, by which a link that was cut is noticed; None = the server's suffice.

    Raises
    ------
    OSError
        Nobody answers, or not as a websocket.
    AuthenticationError, ForbiddenError
        The server does not accept the token.
    """
    from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
    from websockets.sync.client import connect

    try:
        context = connect(
            address,
            additional_headers=authorization(token),
            compression=None,  # clouds are compressed already
            max_size=MAX_BYTES,
            open_timeout=open_s,
            ping_interval=alive_s,
            ping_timeout=None if alive_s is None else 3 * alive_s,  # a long upload goes first
            close_timeout=1.0,
            proxy=None if is_near(address) else True,
        )
        return opened.enter_context(context)
    except InvalidStatus as error:
        raise refusal(address, error.response.status_code, error) from error
    except (InvalidHandshake, ConnectionClosed) as error:
        raise OSError(str(error)) from error


def service_call(service: str, args: Mapping[str, Any], number: str, patience: Patience) -> str:
    """Return the message of a call.

    Raises
    ------
    UsageError
        The arguments are not JSON, such as a number that is not finite.
    """
    message: dict[str, Any] = {"op": "call_service", "id": number, "service": service}
    message.update(args=args, timeout=max(patience.left_s, 0.001))
    try:
        return json.dumps(message, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{service}: the arguments are not JSON: {error}") from error


def answer_values(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of an answer.

    Raises
    ------
    CallFailedError
        The server's words.
    """
    if message.get("op") == "status":
        raise CallFailedError(str(message.get("msg")))
    values = message.get("values")
    if message.get("result") is not True:
        raise _failure(str(values), message)
    return values if isinstance(values, dict) else {}


def _failure(words: str, message: Mapping[str, Any]) -> RtaskError:
    """Return the error of a failed call; our server says besides what it would be over HTTP."""
    status, transient, slug = (message.get(name) for name in ("status", "transient", "error"))
    if type(status) is not int:
        return CallFailedError(words)
    may_pass = transient if isinstance(transient, bool) else status in TRANSIENT_STATUSES
    return error_of(status, words, may_pass, kind=slug if isinstance(slug, str) else "")


def refusal(address: str, status: int, error: Exception) -> RtaskError | OSError:
    """Return the error of a handshake that was refused."""
    if status == 401:
        return AuthenticationError(f"{address} wants a valid token")
    if status == 403:
        return ForbiddenError(f"{address} refuses this caller")
    return OSError(f"{address} answered {status}: {error}")
