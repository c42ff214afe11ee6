"""Find where a SPARQL server takes queries and updates, given an address as people type it.

The protocol fixes no paths (SPARQL 1.1 Protocol, 2), and an address often names only the host, a
dataset, or one of the two endpoints. Each usual place is sent a query that reads nothing, and then
an update that changes nothing: what answers as the protocol says is an endpoint.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlsplit, urlunsplit

import httpx

from rtask.errors import CallFailedError
from rtask.remote.endpoints import Endpoints, addresses
from rtask.remote.transport import Connection, checked, without_password

__all__ = ["Places", "connect", "explicit_address", "find_places"]

_log = logging.getLogger(__name__)
_ROWS = "application/sparql-results+json"
_LIST = f"application/json, {_ROWS};q=0.9"
_ASK = [("query", "ASK {}")]
_NO_CHANGE = [
    ("update", "DELETE DATA { GRAPH <urn:rtask:probe> { <urn:rtask:probe> <urn:a> <urn:b> } }")
]
_QUERIES = ("sparql", "query")
_UPDATES = ("update", "statements")


@dataclass(frozen=True)
class Places:
    """Where a server takes queries and updates.

    Parameters
    ----------
    query_url, update_url
        Addresses; ``update_url`` is ``None`` if no place that was tried takes updates.
    is_rtask
        Whether the server is one of RTASK, which keeps rights and records itself.
    """

    query_url: str
    update_url: str | None
    is_rtask: bool


def connect(address: str, token: str | None, timeout_s: float) -> Endpoints:
    """Return the endpoints at an address; one that names both (``sparql+http:``) is not tried.

    Raises
    ------
    AuthenticationError, ForbiddenError, RemoteUnavailableError, CallFailedError
        As :func:`find_places` does.
    """
    query_url, update_url = addresses(address)
    connection = Connection(token, timeout_s)
    if address.startswith("sparql+"):
        return Endpoints(query_url, update_url or query_url, connection, address)
    try:
        places = find_places(connection, address)
    except BaseException:
        connection.close()
        raise
    return Endpoints(
        places.query_url, places.update_url, connection, explicit_address(places), places.is_rtask
    )


def find_places(connection: Connection, address: str) -> Places:
    """Try an address and the usual places at and below it.

    Raises
    ------
    AuthenticationError, ForbiddenError
        The server wants another token before it says anything.
    RemoteUnavailableError
        Nobody answers there.
    CallFailedError
        No place answers a query, or several datasets are there and none was named.
    """
    search = _Search(connection, address)
    query_url, answer = search.find_queries()
    if "RTASK-Version" in answer.headers:
        is_apart = urlsplit(query_url).path.endswith("/query")
        places = Places(query_url, _beside(query_url, "update") if is_apart else query_url, True)
    else:
        places = Places(query_url, search.find_updates(query_url), False)
    if query_url != address or places.update_url is None:
        _log.warning(
            "%s takes queries at %s and updates at %s; %s opens it without a search",
            without_password(address),
            without_password(query_url),
            without_password(places.update_url or "no place that was tried"),
            without_password(explicit_address(places)),
        )
    return places


def explicit_address(places: Places) -> str:
    """Return the address that names both endpoints, so that nothing needs to be tried.

    >>> explicit_address(Places("http://host:7878/query", "http://host:7878/update", False))
    'sparql+http://host:7878/?query=/query&update=/update'
    """
    update_url = places.update_url or places.query_url
    if places.query_url == update_url:
        return places.query_url
    query, update = (_path_of(url) for url in (places.query_url, update_url))
    return f"sparql+{_with_path(places.query_url, '/')}?query={query}&update={update}"


class _Search:
    """Sends a harmless request to one place after the other, and notes the answers."""

    def __init__(self, connection: Connection, address: str) -> None:
        self._connection = connection
        self._address = address
        self._tried: list[str] = []

    def find_queries(self) -> tuple[str, httpx.Response]:
        """Return the first place that answers a query, and its answer."""
        for url in self._query_places():
            answer = self._send(url, _ASK, _ROWS)
            if answer.status_code in (401, 403, 502, 503, 504):
                checked(answer, without_password(url))
            if _is_boolean(answer):
                return url, answer
        root = without_password(_with_path(self._address, "/"))
        raise CallFailedError(
            f"no SPARQL endpoint at {without_password(self._address)}; tried "
            f"{', '.join(self._tried)}. Name the addresses of queries and updates: "
            f"sparql+{root}?query=/PATH&update=/PATH",
            status=404,
        )

    def find_updates(self, query_url: str) -> str | None:
        """Return the first place that takes updates, given that of queries."""
        for url in dict.fromkeys(_update_places(query_url)):
            answer = self._send(url, _NO_CHANGE, "*/*")
            if answer.status_code in (401, 403) or _is_done(answer):
                return url
        return None

    def _query_places(self) -> Iterator[str]:
        address = self._address
        path = urlsplit(address).path.rstrip("/")
        yield address
        parent, _, last = path.rpartition("/")
        if last in (*_QUERIES, *_UPDATES):
            yield from (url for url in map(self._beside, _QUERIES) if url != address)
            yield _with_path(address, parent or "/")
            return
        yield from (_with_path(address, f"{path}/{name}") for name in _QUERIES)
        yield from self._datasets(path)

    def _beside(self, name: str) -> str:
        return _beside(self._address, name)

    def _datasets(self, above: str) -> Iterator[str]:
        """Yield the places of the dataset that the server lists, or of one by the usual name.

        Below a path, only servers that are installed there are looked for.
        """
        for path, names_in, below in _LISTS if not above else _LISTS_BELOW:
            answer = self._send(_with_path(self._address, above + path), None, _LIST)
            names = [quote(name) for name in _names(names_in, answer)]
            below = tuple(above + place for place in below)
            places = [_with_path(self._address, below[0].format(name)) for name in names]
            if len(places) > 1:
                raise CallFailedError(
                    f"{without_password(self._address)} holds several datasets; open one: "
                    + ", ".join(map(without_password, places)),
                    status=404,
                )
            for name in names:
                yield from (_with_path(self._address, place.format(name)) for place in below)
        usual = (f"{above}/namespace/kb/sparql",) if above else _USUAL
        yield from (_with_path(self._address, place) for place in usual)

    def _send(self, url: str, fields: list[tuple[str, str]] | None, accept: str) -> httpx.Response:
        answer = self._connection.send(url, fields, accept, repeat=True, judged=False)
        outcome = str(answer.status_code)
        if "Location" in answer.headers:
            outcome += f" to {without_password(answer.headers['Location'])}"
        self._tried.append(f"{urlsplit(url).path or '/'} ({outcome})")
        return answer


def _update_places(query_url: str) -> Iterator[str]:
    path = urlsplit(query_url).path.rstrip("/")
    parent, _, last = path.rpartition("/")
    beside = [_beside(query_url, name) for name in _UPDATES]
    if last == "query":
        yield beside[0]
    if "/repositories/" in path:
        yield _with_path(query_url, f"{path}/statements")
    yield query_url
    if last in _QUERIES:
        yield from beside
        if parent:
            yield _with_path(query_url, parent)
    yield from (_with_path(query_url, f"{path}/{name}") for name in _UPDATES)


def _fuseki(document: Any) -> Iterable[str]:
    return [dataset["ds.name"].strip("/") for dataset in document["datasets"]]


def _rdf4j(document: Any) -> Iterable[str]:
    names = [row["id"]["value"] for row in document["results"]["bindings"]]
    return [name for name in names if name != "SYSTEM"]  # RDF4J's own configuration


def _stardog(document: Any) -> Iterable[str]:
    return [name for name in document["databases"] if name != "catalog"]  # its own statistics


_LISTS: tuple[tuple[str, Callable[[Any], Iterable[str]], tuple[str, ...]], ...] = (
    ("/$/datasets", _fuseki, ("/{}", "/{}/query", "/{}/sparql")),
    ("/repositories", _rdf4j, ("/repositories/{}",)),
    ("/rdf4j-server/repositories", _rdf4j, ("/rdf4j-server/repositories/{}",)),
    ("/admin/databases", _stardog, ("/{}/query",)),
)
"""Where servers list what they hold, how to read the list, and where each dataset is."""

_LISTS_BELOW = _LISTS[1:2]
_USUAL = ("/ds/sparql", "/ds/query", "/blazegraph/namespace/kb/sparql")
"""Places of datasets that have the names of examples: Fuseki's and Blazegraph's."""


def _names(names_in: Callable[[Any], Iterable[str]], answer: httpx.Response) -> list[str]:
    try:
        return [str(name) for name in names_in(answer.json())] if answer.is_success else []
    except (ValueError, KeyError, TypeError, AttributeError):  # another document is at this place
        return []


def _is_boolean(answer: httpx.Response) -> bool:
    """Return whether an answer is that to ASK; many servers have a page at every address."""
    try:
        return answer.is_success and isinstance(answer.json()["boolean"], bool)
    except (ValueError, KeyError, TypeError):
        return False


def _is_done(answer: httpx.Response) -> bool:
    """Return whether an update was carried out, rather than a form or a description shown."""
    kind = answer.headers.get("Content-Type", "").partition(";")[0]
    is_form = kind == "text/html" and "<form" in answer.text.lower()
    return answer.is_success and not is_form and kind not in ("text/turtle", "application/rdf+xml")


def _beside(url: str, name: str) -> str:
    parent = urlsplit(url).path.rstrip("/").rpartition("/")[0]
    return _with_path(url, f"{parent}/{name}")


def _with_path(url: str, path: str) -> str:
    return urlunsplit(urlsplit(url)._replace(path=path, query="", fragment=""))


def _path_of(url: str) -> str:
    parts = urlsplit(url)
    return quote(parts.path + (f"?{parts.query}" if parts.query else ""), safe="/")
