"""Pieces, PNG and CBOR: what comes out can be read by who asked for it."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from endpoint.rosbridge.packing import Fragments, Packing, cbor, pieces, png
from endpoint.rosbridge.session import Session
from rtask.errors import UsageError
from rtask.kb.commit.access import Access

TEXT = json.dumps({"op": "publish", "msg": {"data": "Tässchen 🤖" * 40}}, ensure_ascii=False)


def test_pieces_put_together_again_in_any_order() -> None:
    fragments = Fragments()
    parts = [json.loads(piece) for piece in pieces(TEXT, 50)]
    assert all(len(part["data"]) <= 50 for part in parts)
    found = [fragments.add(part) for part in reversed(parts)]
    assert found[:-1] == [None] * (len(parts) - 1)
    assert found[-1] == TEXT


def test_a_piece_that_comes_again_replaces_the_first() -> None:
    fragments = Fragments()
    piece = {"id": "a", "num": 0, "total": 2}
    fragments.add({**piece, "data": "old"})
    fragments.add({**piece, "data": "new"})
    assert fragments.add({"id": "a", "num": 1, "total": 2, "data": "!"}) == "new!"


@pytest.mark.parametrize(
    ("piece", "part"),
    [
        ({"id": "a", "num": 1, "total": 3, "data": "x"}, "total changed"),
        ({"id": "a", "num": 2, "total": 2, "data": "x"}, "0 <= num < total"),
        ({"id": "a", "num": -1, "total": 2, "data": "x"}, "0 <= num < total"),
        ({"id": "a", "num": True, "total": 2, "data": "x"}, "0 <= num < total"),
        ({"id": "a", "num": 0, "total": 10_001, "data": "x"}, "at most 10000"),
        ({"id": [1], "num": 0, "total": 2, "data": "x"}, "id and data"),
        ({"id": "a", "num": 0, "total": 2, "data": 3}, "id and data"),
    ],
)
def test_a_faulty_piece_is_refused(piece: dict[str, Any], part: str) -> None:
    fragments = Fragments()
    fragments.add({"id": "a", "num": 0, "total": 2, "data": "x"})
    with pytest.raises(UsageError, match=part):
        fragments.add(piece)


def test_too_many_messages_in_pieces_and_too_old_ones() -> None:
    fragments = Fragments()
    for name in "abcdefgh":
        fragments.add({"id": name, "num": 0, "total": 2, "data": "x"}, now=0.0)
    with pytest.raises(UsageError, match="incomplete messages already"):
        fragments.add({"id": "i", "num": 0, "total": 2, "data": "x"}, now=1.0)
    with pytest.raises(UsageError, match="not complete within"):
        fragments.add({"id": "a", "num": 1, "total": 2, "data": "x"}, now=31.0)
    fragments.add({"id": "i", "num": 0, "total": 2, "data": "x"}, now=31.0)


@pytest.mark.parametrize("size", [1, 2, 3, 100, 5_000])
def test_a_png_decodes_to_the_message(size: int) -> None:
    text = json.dumps({"a": "ü" * size}, ensure_ascii=False)
    image = cv2.imdecode(np.frombuffer(png(text), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    data = image[:, :, ::-1].tobytes()  # OpenCV gives blue, green, red
    assert json.loads(data) == json.loads(text)


def uncbor(data: bytes) -> Any:
    """Read the part of RFC 8949 that JSON needs; a reader of its own, for the test."""

    def item(at: int) -> tuple[Any, int]:
        major, info = data[at] >> 5, data[at] & 31
        at += 1
        if major == 7:
            if info == 27:
                return struct.unpack(">d", data[at : at + 8])[0], at + 8
            return {20: False, 21: True, 22: None}[info], at
        size = {24: 1, 25: 2, 26: 4, 27: 8}.get(info, 0)
        number = int.from_bytes(data[at : at + size], "big") if size else info
        at += size
        if major < 2:
            return (number if major == 0 else -1 - number), at
        if major == 3:
            return data[at : at + number].decode(), at + number
        values: list[Any] = []
        for _ in range(number * (major - 3)):
            value, at = item(at)
            values.append(value)
        if major == 4:
            return values, at
        return dict(zip(values[::2], values[1::2], strict=True)), at

    value, end = item(0)
    assert end == len(data)
    return value


@pytest.mark.parametrize(
    "value",
    [0, 23, 24, 255, 256, 65_536, 2**32, 2**63, -1, -25, -(2**40), 0.1, -1e300, "", "ü" * 300,
     [], {}, None, True, False, [[1, [2]], {"a": {"b": [None]}}], {"x" * 70_000: list(range(300))}],
)  # fmt: skip
def test_cbor_is_read_back(value: Any) -> None:
    assert uncbor(cbor(json.dumps(value))) == value


@pytest.mark.parametrize("digits", ["18446744073709551616", "-18446744073709551617", "9" * 300])
def test_an_integer_beyond_64_bits_is_a_float_in_cbor(digits: str) -> None:
    assert uncbor(cbor(f'{{"n": [{digits}, 7, "{digits}"]}}')) == {"n": [float(digits), 7, digits]}


def test_half_a_surrogate_pair_does_not_break_cbor() -> None:
    assert uncbor(cbor(r'{"a": "x\ud800y", "b": "\ud83d\ude00"}')) == {
        "a": "x?y",
        "b": "\U0001f600",
    }


def test_who_asks_for_nothing_gets_plain_text(connect: Callable[..., Any]) -> None:
    assert Packing.from_message({}).is_plain
    assert Packing.from_message({"compression": "cbor-raw"}).is_plain
    assert Packing.from_message({"compression": ["png"], "fragment_size": None}).is_plain
    status = connect().ask({"op": "subscribe", "topic": "/t", "fragment_size": "many"})
    assert "fragment_size" in status["msg"]


@pytest.fixture
def raw(bridge: Any) -> tuple[Session, list[str | bytes]]:
    """A session and the frames that it sends."""
    frames: list[str | bytes] = []
    session = Session(
        bridge, lambda frame, topic="": frames.append(frame), Access(None, "anonymous")
    )
    return session, frames


def test_an_answer_comes_packed_as_the_call_asked(raw: tuple[Session, list[str | bytes]]) -> None:
    session, frames = raw
    call = {"op": "call_service", "service": "/rosapi/services", "id": 1}
    session.feed(json.dumps({**call, "compression": "cbor"}))
    assert isinstance(frames[0], bytes)
    assert uncbor(frames[0])["id"] == 1
    session.feed(json.dumps({**call, "compression": "png"}))
    packed = json.loads(frames[1])
    assert packed["op"] == "png"
    assert zlib.crc32(base64.b64decode(packed["data"])[-8:-4]) == int.from_bytes(
        base64.b64decode(packed["data"])[-4:], "big"
    )
    del frames[:]
    session.feed(json.dumps({**call, "fragment_size": 100}))
    assert len(frames) > 1
    fragments = Fragments()
    whole = [fragments.add(json.loads(frame)) for frame in frames][-1]
    assert whole is not None
    assert json.loads(whole)["result"] is True


def test_a_topic_comes_packed_and_the_smallest_piece_wins(
    raw: tuple[Session, list[str | bytes]],
) -> None:
    session, frames = raw
    for id_, size in (("a", 1_000), ("b", 100), ("c", 500)):
        session.feed(
            json.dumps({"op": "subscribe", "topic": "/t", "id": id_, "fragment_size": size})
        )
    session.feed(json.dumps({"op": "publish", "topic": "/t", "msg": {"data": "x" * 300}}))
    assert len(frames) == 4
    assert all(len(json.loads(frame)["data"]) <= 100 for frame in frames)


def test_a_call_in_pieces_is_carried_out(raw: tuple[Session, list[str | bytes]]) -> None:
    session, frames = raw
    text = json.dumps({"op": "call_service", "service": "/rosapi/get_time", "id": "x" * 100})
    for piece in pieces(text, 64):
        session.feed(piece)
    assert json.loads(frames[0])["id"] == "x" * 100
