"""The frames that a knowledge base sends to its keeper: the whole store once, then the commits."""

from __future__ import annotations

import socket

from rtask.kb.readers.messages import encode_change, message
from rtask.kb.store.writes import Writes

__all__ = ["CommitFrame", "DumpSink"]

_DUMP_PIECE = 256 << 10


class CommitFrame:
    """A commit for the replicas; encoded once, when it is first sent."""

    __slots__ = ("_data", "_writes", "weight")

    def __init__(self, writes: Writes) -> None:
        self._writes: Writes | None = writes
        self._data = b""
        self.weight = 256 * (1 + len(writes.added) + len(writes.removed))

    def encode(self) -> bytes:
        """Return the message."""
        writes = self._writes
        if writes is not None:
            payload = encode_change(writes.removed, writes.added, writes.created, writes.dropped)
            self._data, self._writes = message(b"F", payload), None
        return self._data


class DumpSink:
    """File-like writer that sends a dump of the store to the keeper as ``D`` messages."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._parts: list[bytes] = []
        self._size = 0

    def write(self, data: bytes) -> int:
        """Collect data; send a message when there is enough."""
        self._parts.append(data)
        self._size += len(data)
        if self._size >= _DUMP_PIECE:
            self.flush()
        return len(data)

    def flush(self) -> None:
        """Send what is left."""
        if self._parts:
            self._connection.sendall(message(b"D", b"".join(self._parts)))
        self._parts, self._size = [], 0
