"""A robot that connects to the server whose pages are looked at."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.servers import RunningServer

__all__ = ["Robot", "robot"]


class Robot:
    """A robot that speaks rosbridge."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def send(self, **message: Any) -> None:
        """Send one message."""
        self._socket.send(json.dumps(message))

    def call(self, operation: str, **args: Any) -> Any:
        """Call an operation and return what it answers."""
        self.send(op="call_service", service=f"/rtask/{operation}", args=args, id="1")
        answer = json.loads(self._socket.recv(timeout=60))
        assert answer["result"], answer
        return answer["values"]

    def wait_until_closed(self) -> str:
        """Read until the server closes the connection, and return the reason that it gives."""
        try:
            while True:
                self._socket.recv(timeout=60)
        except ConnectionClosed as closed:
            return closed.rcvd.reason if closed.rcvd else ""

    def leave(self) -> None:
        """Close the connection."""
        self._socket.close()


@contextmanager
def robot(server: RunningServer, token: str) -> Iterator[Robot]:
    """Connect a robot for the time of a block."""
    headers = {"Authorization": f"Bearer {token}"}
    with connect(server.websocket, additional_headers=headers, proxy=None) as socket:
        yield Robot(socket)
