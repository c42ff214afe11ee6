"""Compression of answers and request bodies by gzip (RFC 9110, 8.4 and 12.5.3)."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import replace
from functools import lru_cache

from endpoint.http.messages import CBOR_TYPE, RefusedError, Request, Response
from rtask.errors import TooLargeError

SMALLEST = 4 << 10
_LEVEL = 1  # the network of a robot is slow, its server busy: the first level does most of it
_PIECE = 1 << 20
_WINDOW = 64 << 10
_MAX_MEMBERS = 10_000


@lru_cache(maxsize=256)
def accepts_gzip(header: str) -> bool:
    """Tell whether a client accepts gzip: named with q > 0, and not below ``identity``.

    Examples
    --------
    >>> [accepts_gzip(h) for h in ("gzip, deflate", "gzip;q=0", "identity", "*", "")]
    [True, False, False, True, False]
    """
    qualities: dict[str, float] = {}
    for element in header.lower().split(","):
        name, *parameters = (part.strip() for part in element.split(";"))
        quality = 1.0
        for parameter in parameters:
            if parameter.startswith("q="):
                try:
                    quality = float(parameter[2:])
                except ValueError:
                    quality = 0.0
        qualities[name] = quality
    gzip_quality = qualities.get("gzip", qualities.get("*", 0.0))
    return gzip_quality > 0 and gzip_quality >= qualities.get("identity", 0.0)


def wants_gzip(request: Request) -> bool:
    """Tell whether to compress the answer to a request if it is large."""
    header = request.headers.get("accept-encoding")
    return bool(header) and accepts_gzip(header or "")


def compressed(response: Response, request: Request) -> Response:
    """Compress a response if the client accepts that and it pays.

    It does not for CBOR: measurements and packed clouds hardly shrink, and packing 360 kB takes
    longer than all the rest of a call.
    """
    if response.media_type == CBOR_TYPE:
        return response
    if len(response.body) < SMALLEST or response.chunks is not None or not wants_gzip(request):
        return response
    taken = {name.lower() for name, _ in response.headers}
    if response.status != 200 or "content-encoding" in taken or "accept-ranges" in taken:
        return response
    body = gzip.compress(response.body, _LEVEL, mtime=0)
    headers = tuple((name, mark(name, value)) for name, value in response.headers)
    return replace(response, body=body, headers=(*headers, ("Content-Encoding", "gzip")))


def mark(name: str, value: str) -> str:
    """Return a header field for a compressed answer: its strong entity tag differs."""
    if name.lower() == "etag" and value.startswith('"'):
        return f'{value[:-1]}-gzip"'
    return value


def unpacked(body: bytes, encoding: str, allowed: int) -> bytes:
    """Decompress a request body by its Content-Encoding.

    Raises
    ------
    RefusedError
        415 for an encoding other than gzip, 400 for a corrupt body.
    TooLargeError
        It decompresses to more than is allowed; the excess is never held in memory.

    Examples
    --------
    >>> unpacked(gzip.compress(b"ASK {}"), "gzip", 100)
    b'ASK {}'
    """
    encoding = encoding.strip().lower()
    if encoding in ("", "identity"):
        return body
    if encoding not in ("gzip", "x-gzip"):
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"Content-Encoding {encoding!r} is not read here; gzip is",
            headers=(("Accept-Encoding", "gzip, identity"),),
        )
    pieces: list[bytes] = []
    size = at = members = 0
    rest, reader = b"", zlib.decompressobj(wbits=31)
    is_read = False
    while not is_read:
        if not rest:
            # In parts: what a member leaves is copied, and a body may have thousands of members.
            rest, at = body[at : at + _WINDOW], at + _WINDOW
            if not rest:
                raise RefusedError(400, "usage", "the gzip body is cut off")
        try:
            piece = reader.decompress(rest, _PIECE)
        except zlib.error as error:
            where = f" from its member {members + 1} on" if members else ""
            raise RefusedError(400, "usage", f"the body is not gzip{where}: {error}") from None
        size += len(piece)
        if size > allowed:
            raise TooLargeError(f"the body unpacks to more than {allowed} bytes", limit=allowed)
        pieces.append(piece)
        rest = reader.unconsumed_tail
        # RFC 1952, 2.2: files packed one by one and put together are one file as well.
        is_read = reader.eof
        if is_read and (reader.unused_data or at < len(body)):
            is_read = False
            members += 1
            if members == _MAX_MEMBERS:
                raise TooLargeError(
                    f"the gzip body has more than {_MAX_MEMBERS} members; pack it as one",
                    limit=_MAX_MEMBERS,
                )
            rest, reader = reader.unused_data, zlib.decompressobj(wbits=31)
    return b"".join(pieces)
