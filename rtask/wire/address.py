"""Addresses of servers, as people type them."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit

from rtask.errors import UsageError

__all__ = ["split_address"]


def split_address(address: str) -> SplitResult:
    """Return the parts of the address of a server.

    Raises
    ------
    UsageError
        It has no host, a port that is none, or a space or control character.

    Examples
    --------
    >>> split_address("http://graph.example.org:8765/kb").port
    8765
    >>> split_address("http://localhost:876s")
    Traceback (most recent call last):
    rtask.errors.UsageError: 'http://localhost:876s' is not the address of a server; expected ...
    """
    try:
        parts = urlsplit(address)
        is_whole = bool(parts.hostname) and parts.port != 0
    except ValueError:  # brackets without an IPv6 address, or what is no port
        is_whole = False
    if not is_whole or " " in address or not address.isprintable():
        raise UsageError(f"{address!r} is not the address of a server; expected http://host:port")
    return parts
