"""Blobs that the graph names: images, point clouds, descriptors."""

from __future__ import annotations

import re

from endpoint.http.messages import RefusedError, Request, Response
from endpoint.http.plan import Plan
from endpoint.served import ServedGraph, embedded
from rtask.errors import MissingBlobError

Headers = tuple[tuple[str, str], ...]
_DIGEST = re.compile(r"[0-9a-f]{64}")
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")

# What browsers may show; everything else (SVG and HTML run scripts) is a download.
_MAGIC = (
    (b"\x89PNG\r\n\x1a\n", "image/png"),
    (b"\xff\xd8\xff", "image/jpeg"),
    (b"ply\n", "application/ply"),
)
_SAFE = (
    ("X-Content-Type-Options", "nosniff"),
    ("Content-Security-Policy", "sandbox; default-src 'none'"),
)


def plan_blob(kb: ServedGraph, request: Request, digest: str) -> Plan:
    """Plan the answer with the bytes of one blob.

    Parameters
    ----------
    kb
        Knowledge base that holds the blobs.
    request
        GET or HEAD, with ``Range`` and ``If-None-Match``.
    digest
        SHA-256 in 64 lower-case hex digits; nothing else is looked up, so no path can be reached.

    Raises
    ------
    RefusedError
        404.
    """
    if not _DIGEST.fullmatch(digest):
        raise RefusedError(404, "not-found", "a blob is named by 64 lower-case hex digits")
    return Plan(lambda: _answer(kb, request, digest))


def _answer(kb: ServedGraph, request: Request, digest: str) -> Response:
    etag = f'"{digest}"'
    headers: Headers = (*_SAFE, ("ETag", etag), ("Accept-Ranges", "bytes"))
    try:
        data = embedded(kb, "blobs").blobs.read(f"urn:sha256:{digest}")
    except MissingBlobError:
        raise RefusedError(404, "not-found", f"no blob {digest}") from None
    if request.header("if-none-match") in (etag, "*"):
        return Response(304, headers=headers)
    media_type = next((name for magic, name in _MAGIC if data.startswith(magic)), "")
    if not media_type:
        media_type = "application/octet-stream"
        headers = (*headers, ("Content-Disposition", f'attachment; filename="{digest[:12]}"'))
    byte_range = _range(request.header("range"), len(data))
    if byte_range is None:
        return Response(200, data, media_type, headers)
    start, end = byte_range
    if start >= len(data):
        unsatisfied = (("Content-Range", f"bytes */{len(data)}"),)
        raise RefusedError(416, "usage", f"the blob has {len(data)} bytes", headers=unsatisfied)
    place = ("Content-Range", f"bytes {start}-{end - 1}/{len(data)}")
    return Response(206, data[start:end], media_type, (*headers, place))


def _range(header: str, size: int) -> tuple[int, int] | None:
    """Return the start and end of a byte range (RFC 9110, 14.1.2); none for the whole blob.

    Examples
    --------
    >>> _range("bytes=2-5", 10), _range("bytes=-3", 10), _range("bytes=5-2", 10)
    ((2, 6), (7, 10), None)
    """
    match = _RANGE.fullmatch(header.strip())
    if not match or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if not first:
        return max(0, size - int(last)), size
    if last and int(last) < int(first):
        return None
    return int(first), min(size, int(last) + 1) if last else size
