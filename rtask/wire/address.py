"""Addresses of servers, as people type them, and the token that goes with requests to them."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit

from rtask.errors import AuthenticationError, UsageError

__all__ = ["authorization", "is_near", "split_address"]


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


def is_near(address: str) -> bool:
    """Whether a server is on this machine, which no proxy leads to.

    >>> is_near("ws://localhost:8765/rosbridge"), is_near("https://graph.example.org")
    (True, False)
    """
    return (urlsplit(address).hostname or "") in ("localhost", "127.0.0.1", "::1")


def authorization(token: str | None) -> dict[str, str]:
    """Return the header that carries a token (RFC 6750, 2.1); none without a token.

    Raises
    ------
    AuthenticationError
        The token has characters that no token has, such as the end of its line.

    Examples
    --------
    >>> authorization("secret"), authorization(None)
    ({'Authorization': 'Bearer secret'}, {})
    """
    if not token:
        return {}
    if not (token.isascii() and token.isprintable() and " " not in token):
        raise AuthenticationError(
            "the token has a character that no token has, such as a space or the end of a line;"
            " copy it as `rtask token create` printed it"
        )
    return {"Authorization": f"Bearer {token}"}
