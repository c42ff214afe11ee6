"""Messages between a knowledge base, its keeper and its readers, and the format of a change.

This file is part of the keeper's script and needs only the standard library and pyoxigraph.

A message consists of a type byte, a length and a payload. To the keeper: ``L`` a dump of the store
follows in ``D`` pieces, the last one empty; ``F`` a change; ``K`` fork a reader on the descriptors
sent along. From the keeper: ``R`` the dump is loaded; ``E`` a reader has ended. From a reader,
through a socket, once: ``H`` it is ready. To a reader, through a pipe: ``F`` a change; ``Q`` a
query; ``S`` one that may take long; ``U`` an update, answered with its exact change. From a reader,
through a pipe: ``M`` the kind and media type of the answer; ``C`` a piece of it; ``E`` its end;
``X`` an error.

A change, whether it comes from a commit or from an update that a reader evaluated, is a line of
JSON followed by the removed and the added statements as N-Quads. A query is a line of JSON with
options followed by its text; queries of one client have the same options.
"""

from __future__ import annotations

import json
import os
import socket
import struct
from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import pyoxigraph as ox

__all__ = [
    "HEADER",
    "Incoming",
    "Questions",
    "ReceivedChange",
    "decode_change",
    "encode_change",
    "message",
]

HEADER = struct.Struct("<cI")
_READ_AHEAD = 64 << 10


def message(kind: bytes, payload: bytes = b"") -> bytes:
    """Encode a message."""
    return HEADER.pack(kind, len(payload)) + payload


class Incoming:
    """Messages from a socket, with the file descriptors sent along."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def next(self) -> tuple[bytes, bytes, list[int]]:
        """Return type, payload and descriptors of the next message.

        Raises
        ------
        EOFError
            When the other side has closed.
        """
        # descriptors arrive with the first byte of a message, so its header is read by itself
        header, descriptors = b"", []
        while len(header) < HEADER.size:
            part, received, _, _ = socket.recv_fds(self._connection, HEADER.size - len(header), 4)
            if not part:
                raise EOFError
            header += part
            descriptors += received
        kind, length = HEADER.unpack(header)
        return kind, self._exactly(length), descriptors

    def _exactly(self, length: int) -> bytes:
        data = bytearray(length)
        view = memoryview(data)
        while view:
            count = self._connection.recv_into(view)
            if not count:
                raise EOFError
            view = view[count:]
        return bytes(data)


class Questions:
    """Messages from a pipe, read ahead to save system calls."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self._ahead = b""

    def next(self) -> tuple[bytes, bytes]:
        """Return type and payload of the next message.

        Raises
        ------
        EOFError
            When the other side has closed.
        """
        ahead = self._ahead or self._read()
        while len(ahead) < HEADER.size:
            ahead += self._read()
        kind, length = HEADER.unpack_from(ahead)
        end = HEADER.size + length
        if len(ahead) < end:
            ahead = self._read_until(ahead, end)
        self._ahead = ahead[end:]
        return kind, ahead[HEADER.size : end]

    def _read(self) -> bytes:
        data = os.read(self._pipe, _READ_AHEAD)
        if not data:
            raise EOFError
        return data

    def _read_until(self, ahead: bytes, end: int) -> bytes:
        parts, size = [ahead], len(ahead)
        while size < end:
            parts.append(self._read())
            size += len(parts[-1])
        return b"".join(parts)


class ReceivedChange(NamedTuple):
    """A change as received; its statements are parsed as they are read."""

    removed: Iterable[ox.Quad]
    added: Iterable[ox.Quad]
    created: list[ox.NamedNode]
    dropped: list[ox.NamedNode]


def encode_change(
    removed: Collection[ox.Quad],
    added: Collection[ox.Quad],
    created: Iterable[Any],
    dropped: Iterable[Any],
) -> bytes:
    """Return the payload of a change; the default graph is neither created nor dropped."""
    before, after = _n_quads(removed), _n_quads(added)
    head = {"removed": len(before), "created": _names(created), "dropped": _names(dropped)}
    return json.dumps(head).encode() + b"\n" + before + after


def decode_change(payload: bytes) -> ReceivedChange:
    """Return the parts of a change.

    Examples
    --------
    >>> quad = ox.Quad(*map(ox.NamedNode, ("urn:s", "urn:p", "urn:o", "urn:g")))
    >>> change = decode_change(encode_change([], [quad], [quad.graph_name], []))
    >>> list(change.added) == [quad], list(change.removed), change.created
    (True, [], [<NamedNode value=urn:g>])
    """
    line, _, body = payload.partition(b"\n")
    head = json.loads(line)
    cut = head["removed"]
    return ReceivedChange(
        ox.parse(body[:cut], format=ox.RdfFormat.N_QUADS),
        ox.parse(body[cut:], format=ox.RdfFormat.N_QUADS),
        [ox.NamedNode(name) for name in head["created"]],
        [ox.NamedNode(name) for name in head["dropped"]],
    )


def _n_quads(quads: Collection[ox.Quad]) -> bytes:
    if not quads:
        return b""
    listed = quads if isinstance(quads, list) else list(quads)
    return ox.serialize(listed, format=ox.RdfFormat.N_QUADS) or b""


def _names(graphs: Iterable[Any]) -> list[str]:
    return [graph.value for graph in graphs if isinstance(graph, ox.NamedNode)]
