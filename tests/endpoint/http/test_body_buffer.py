"""Large bodies wait in a file until they are whole."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import pytest

from endpoint.http.body_buffer import SMALL_BYTES, BodyBuffer
from rtask.errors import StorageFullError


def test_what_is_small_stays_in_memory_and_the_rest_goes_to_a_file() -> None:
    small, large = BodyBuffer(), BodyBuffer()
    small.write(b"x" * 10)
    pieces = [bytes([k]) * (1 << 20) for k in range(6)]
    for piece in pieces:
        large.write(piece)
    assert (small.in_file, large.in_file) == (False, True)
    assert asyncio.run(small.read()) == b"x" * 10
    assert asyncio.run(large.read()) == b"".join(pieces)
    assert asyncio.run(BodyBuffer().read()) == b""
    for spool in (small, large):
        spool.close()


def test_no_room_is_said_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    spool = BodyBuffer()
    with pytest.raises(StorageFullError, match="nowhere"):
        spool.write(b"x" * (SMALL_BYTES + 1))
    spool.close()
