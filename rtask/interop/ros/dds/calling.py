"""Headers of requests and replies as rmw_cyclonedds writes them, and a client of services."""

from __future__ import annotations

import itertools
import queue
import secrets
import struct
import threading
from collections.abc import Callable
from typing import Any

from rtask.errors import RemoteUnavailableError, UsageError
from rtask.interop.ros.dds.structs import ENCAPSULATION
from rtask.interop.ros.dds.types import RosTypes

__all__ = ["ServiceClient", "read_header", "with_header"]

_HEADER_BYTES = 16


def with_header(cdr: bytes, guid: int, sequence: int) -> bytes:
    """Return the CDR of a request or reply, in little endian, with its header.

    Parameters
    ----------
    guid
        Of the client.
    sequence
        Number of the request, from 1.
    """
    return cdr[:ENCAPSULATION] + struct.pack("<Qq", guid, sequence) + cdr[ENCAPSULATION:]


def read_header(cdr: bytes) -> tuple[int, int, bytes]:
    """Return guid and sequence number of a request or reply, and its CDR without them.

    Raises
    ------
    UsageError
        It is too short to be one.
    """
    if len(cdr) < ENCAPSULATION + _HEADER_BYTES:
        raise UsageError(f"a request of {len(cdr)} bytes; expected at least 20")
    order = "<" if cdr[1] & 1 else ">"
    guid, sequence = struct.unpack_from(f"{order}Qq", cdr, ENCAPSULATION)
    rest = cdr[:ENCAPSULATION] + cdr[ENCAPSULATION + _HEADER_BYTES :]
    return guid, sequence, rest


class ServiceClient:
    """Calls one service.

    Parameters
    ----------
    send
        Sends a request with its header.
    servers
        Returns how many servers match.
    """

    def __init__(
        self,
        types: RosTypes,
        type_: str,
        send: Callable[[bytes], None],
        servers: Callable[[], int],
    ) -> None:
        self._types, self._type = types, type_
        self._send, self._servers = send, servers
        self._guid, self._sequence = secrets.randbits(64), itertools.count(1)
        self._open: dict[int, queue.SimpleQueue[bytes]] = {}

    def make(self) -> Any:
        """Return an empty request."""
        return self._types.make(f"{self._type}_Request")

    def call(self, request: Any, timeout_s: float = 10.0) -> Any:
        """Send a request and return the response.

        Raises
        ------
        RemoteUnavailableError
            There is no server, or it did not answer in time.
        """
        self._wait_for_server(timeout_s)
        sequence = next(self._sequence)
        answers = self._open[sequence] = queue.SimpleQueue()
        try:
            cdr = self._types.encode(request, f"{self._type}_Request")
            self._send(with_header(cdr, self._guid, sequence))
            reply = answers.get(timeout=timeout_s)
        except queue.Empty:
            raise RemoteUnavailableError(
                f"the service {self._type} did not answer within {timeout_s:g} s; is its RMW "
                "Cyclone's?"
            ) from None
        finally:
            del self._open[sequence]
        return self._types.decode(reply, f"{self._type}_Response")

    def take(self, cdr: bytes) -> None:
        """Accept a reply; those to other clients are ignored."""
        guid, sequence, rest = read_header(cdr)
        if guid == self._guid and (waiting := self._open.get(sequence)) is not None:
            waiting.put(rest)

    def _wait_for_server(self, timeout_s: float) -> None:
        pause = threading.Event()
        # The library has no event for a match that tells of both directions.
        for _ in range(max(1, round(timeout_s / 0.02))):
            if self._servers():
                return
            pause.wait(0.02)
        raise RemoteUnavailableError(
            f"nobody offers the service {self._type} within {timeout_s:g} s; do name and --domain "
            "fit?"
        )
