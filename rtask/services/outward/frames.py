"""Binary frames between server and workers: CBOR (RFC 8949) with typed arrays (RFC 8746).

Bytes travel as byte strings and arrays of numbers as the bytes of their elements, where JSON has
base64 and digits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from rtask.errors import UsageError
from rtask.wire.fields import wire_name

__all__ = ["pack", "packed", "plain", "unpack"]

_SHAPED, _DOUBLES = 40, 86
# RFC 8746, 2.1: little-endian elements by tag.
_ELEMENTS = {
    64: "u1", 69: "<u2", 70: "<u4", 71: "<u8", 72: "i1", 77: "<i2", 78: "<i4", 79: "<i8",
    85: "<f4", _DOUBLES: "<f8",
}  # fmt: skip
_MAX_DEPTH = 64


def pack(message: Mapping[str, Any]) -> bytes:
    """Return a message as one binary frame.

    Examples
    --------
    >>> frame = pack({"op": "service_response", "values": {"sum": np.array([[1.0, 2.0]])}})
    >>> unpack(frame)["values"]["sum"]
    array([[1., 2.]])

    Raises
    ------
    UsageError
        It holds something that CBOR cannot carry.
    """
    import cbor2

    try:
        return cbor2.dumps(message, default=_encode)
    except (cbor2.CBOREncodeError, TypeError, ValueError) as error:
        raise UsageError(f"a value cannot be sent: {error}") from error


def unpack(frame: bytes) -> dict[str, Any]:
    """Return the message of a binary frame.

    Raises
    ------
    UsageError
        It is not CBOR, or not a map with names.
    """
    import cbor2

    try:
        message = cbor2.loads(frame, tag_hook=_decode, max_depth=_MAX_DEPTH)
    except (cbor2.CBORDecodeError, ValueError, TypeError, RecursionError) as error:
        raise UsageError(f"not CBOR that can be read: {error}") from None
    if not isinstance(message, dict) or not all(isinstance(name, str) for name in message):
        raise UsageError("a binary frame holds one CBOR map whose keys are texts")
    return message


def packed(message: BaseModel) -> dict[str, Any]:
    """Return the fields of a message that are set, with bytes and arrays as they are."""
    fields = type(message).model_fields
    return {
        wire_name(name, fields[name]): getattr(message, name) for name in message.model_fields_set
    }


def plain(message: BaseModel) -> dict[str, Any]:
    """Return the fields of a message that are set, as JSON carries them."""
    return message.model_dump(by_alias=True, exclude_unset=True)


def _encode(encoder: Any, value: Any) -> None:
    import cbor2

    if isinstance(value, BaseModel):
        encoder.encode(packed(value))
    elif isinstance(value, np.ndarray):
        elements = cbor2.CBORTag(_DOUBLES, value.astype("<f8").tobytes())
        if value.ndim != 1:
            elements = cbor2.CBORTag(_SHAPED, [list(value.shape), elements])
        encoder.encode(elements)
    elif isinstance(value, np.generic):
        encoder.encode(value.item())
    elif isinstance(value, bytearray | memoryview):
        encoder.encode(bytes(value))
    else:
        raise TypeError(f"{type(value).__name__} has no form in CBOR")


def _decode(tag: Any, *_: object) -> Any:
    """Return a typed array; the arguments are those of :mod:`cbor2`."""
    if tag.tag in _ELEMENTS and isinstance(tag.value, bytes):
        return np.frombuffer(tag.value, _ELEMENTS[tag.tag]).copy()
    if tag.tag == _SHAPED and isinstance(tag.value, list | tuple) and len(tag.value) == 2:
        shape, elements = tag.value
        sizes = [int(length) for length in shape]
        if isinstance(elements, np.ndarray) and math.prod(sizes) == elements.size:
            return elements.reshape(sizes)
    raise ValueError(f"tag {tag.tag} is not taken, or does not fit what it holds")
