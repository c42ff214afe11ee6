"""Messages of readers as they arrive: in pieces, from a socket that may close at any moment."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager

import pytest

from rtask.kb.readers.main import _Dump
from rtask.kb.readers.messages import HEADER, Incoming, message


@contextmanager
def sent(*parts: bytes) -> Iterator[Incoming]:
    """Yield what reads these parts, each sent by itself, before the other side closes."""
    here, there = socket.socketpair()

    def send() -> None:
        with closing(there):
            for part in parts:
                there.sendall(part)

    sender = threading.Thread(target=send)
    sender.start()
    with closing(here):
        yield Incoming(here)
    sender.join()


def dump(pieces: Sequence[bytes]) -> list[bytes]:
    return [message(b"D", piece) for piece in pieces]


def test_a_message_cut_anywhere_is_read_whole() -> None:
    whole = message(b"Q", b"SELECT * { ?s ?p ?o }")
    for cut in range(1, len(whole)):
        with sent(whole[:cut], whole[cut:], message(b"K")) as incoming:
            assert incoming.next() == (b"Q", b"SELECT * { ?s ?p ?o }", [])
            assert incoming.next() == (b"K", b"", [])


@pytest.mark.parametrize("length", [0, 1, HEADER.size, HEADER.size + 2])
def test_the_end_of_the_other_side_is_no_message(length: int) -> None:
    with sent(message(b"F", b"change")[:length]) as incoming, pytest.raises(EOFError):
        incoming.next()


@pytest.mark.parametrize("size", [1, 3, 4, 100, -1])
def test_a_dump_is_read_in_any_sizes_and_ends_at_its_empty_piece(size: int) -> None:
    with sent(*dump([b"abcd", b"ef", b"ghijk", b""]), message(b"Q", b"ASK {}")) as incoming:
        reader = _Dump(incoming)
        text = b""
        while piece := reader.read(size):
            assert size < 0 or len(piece) <= size
            text += piece
        assert text == b"abcdefghijk"
        assert reader.read(size) == b"", "what comes after the end is no part of it"
        assert incoming.next() == (b"Q", b"ASK {}", [])
