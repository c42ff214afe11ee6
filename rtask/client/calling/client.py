"""A client that holds one websocket open, for programs with several threads and with topics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtask.client.calling.held import Hear, HeldSocket
from rtask.client.calling.messages import addresses
from rtask.client.calling.reporting import ReportingCaller
from rtask.client.calling.rules import CallRules

__all__ = ["HeldClient"]


class HeldClient(ReportingCaller):
    """Talks to ``rtask serve`` over one websocket, from many threads at once.

    Parameters
    ----------
    url
        ``http://host:port``, or the websocket's own address.
    token
        Of the robot; needed unless the server runs without tokens.
    timeout_s
        For each call.
    rules
        What follows for callers from the declarations of the operations.
    outbox
        File that keeps reports which could not be sent.
    """

    def __init__(
        self,
        url: str,
        token: str | None,
        timeout_s: float,
        rules: CallRules,
        outbox: Path | str | None = None,
    ) -> None:
        self.url, socket = addresses(url)
        super().__init__(outbox, rules)
        self._socket = HeldSocket(socket, token, timeout_s)

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        may_repeat = operation in self._rules.repeatable
        return self._socket.call(f"/rtask/{operation}", args, may_repeat, timeout_s)

    def read_method(
        self, service: str, method: str, args: Mapping[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Call a method of a service that changes nothing; raises as :meth:`HeldSocket.call`.

        Parameters
        ----------
        service
            ``rtask/Segmentation``.
        """
        return self._socket.call(f"/services/{service}/{method}", args, True, timeout_s)

    def subscribe(self, topic: str, hear: Hear) -> None:
        """Call a function with each message of a topic of the server."""
        self._socket.subscribe(topic, hear)

    def unsubscribe(self, topic: str) -> None:
        """End a subscription."""
        self._socket.unsubscribe(topic)

    def close(self) -> None:
        """Close the websocket; what was not answered stays in the outbox."""
        self._socket.close()
