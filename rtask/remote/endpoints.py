"""The query and update endpoints of one server."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import parse_qs, urljoin

from rtask.errors import UsageError
from rtask.remote.dialect import Dialect
from rtask.remote.transport import Connection, without_password
from rtask.wire.address import split_address

__all__ = ["ROWS", "TRIPLES", "Endpoints", "addresses"]

ROWS = "application/sparql-results+json"
TRIPLES = "application/n-triples"


class Endpoints:
    """Sends queries and updates to a server.

    Parameters
    ----------
    query_url, update_url
        Addresses; the update endpoint may be the same, or ``None`` if it is not known.
    connection
        To the server.
    address
        Both addresses as one text, as for :func:`rtask.open`.
    is_rtask
        Whether the server is one of RTASK, which keeps rights and records itself; ``None`` to ask
        it when that matters.
    """

    def __init__(
        self,
        query_url: str,
        update_url: str | None,
        connection: Connection,
        address: str,
        is_rtask: bool | None = None,
    ) -> None:
        self.query_url = query_url
        self.update_url = update_url
        self.connection = connection
        self.address = address
        self._is_rtask = is_rtask

    def query(
        self,
        text: str,
        accept: str = ROWS,
        fields: Sequence[tuple[str, str]] = (),
        timeout_s: float | None = None,
    ) -> bytes:
        """Send a query; return the body of its answer."""
        answer = self.connection.send(
            self.query_url, [("query", text), *fields], accept, repeat=True, timeout_s=timeout_s
        )
        return answer.content

    def update(self, text: str) -> None:
        """Send an update, at most once.

        Raises
        ------
        UsageError
            It is not known where the server takes updates.
        """
        if self.update_url is None:
            raise UsageError(
                f"{self} takes queries, but no usual place there takes updates; name it, "
                f"sparql+http://host/?query=/PATH&update=/PATH, or open with mode='r'"
            )
        self.connection.send(self.update_url, [("update", text)], repeat=False)

    def rows(self, text: str) -> list[tuple[Any, ...]]:
        """Return the rows of a SELECT that concerns no blank node."""
        return Dialect("urn:rtask:none:").rows(self.query(text))

    def ask(self, text: str) -> bool:
        """Return the answer of an ASK."""
        return bool(Dialect("urn:rtask:none:").answer(self.query(text), rows=True))

    def is_rtask(self) -> bool:
        """Whether the server is one of RTASK, which keeps rights and records itself."""
        if self._is_rtask is None:
            ask = [("query", "ASK {}")]
            answer = self.connection.send(self.query_url, ask, ROWS, repeat=True)
            self._is_rtask = "RTASK-Version" in answer.headers
        return self._is_rtask

    def __str__(self) -> str:
        return without_password(self.query_url)


def addresses(address: str) -> tuple[str, str | None]:
    """Return the query and update endpoints of an address; ``None`` if one takes both.

    >>> addresses("http://host/sparql")
    ('http://host/sparql', None)
    """
    plain = address.removeprefix("sparql+")
    parts = split_address(plain)
    if plain == address:
        return address, None
    named = parse_qs(parts.query)
    if "query" not in named:
        raise UsageError(
            f"{address} names no query endpoint; give its address as the parameter ?query="
        )
    query, update = (urljoin(plain, named.get(key, [""])[0]) for key in ("query", "update"))
    return query, update if "update" in named else None
