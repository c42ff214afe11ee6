"""A client of a server: service calls over rosbridge, SPARQL over HTTP."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlencode

from rtask.client.base import Client
from rtask.client.calling.messages import addresses
from rtask.client.calls import REPEATABLE
from rtask.client.failures import Patience, failure_of, is_transient
from rtask.client.following import FollowedChange, Pattern, follow_remote
from rtask.client.websocket import ServiceSocket
from rtask.errors import (
    CallFailedError,
    RemoteUnavailableError,
    UsageError,
)
from rtask.wire.address import authorization, is_near

if TYPE_CHECKING:
    import httpx

__all__ = ["RemoteClient"]

_MARGIN_S = 0.5
_LEAST_S = 0.01


class RemoteClient(Client):
    """Talks to ``rtask serve``.

    Parameters
    ----------
    url
        ``http://host:port``, or the websocket's own address.
    token
        Of the robot; needed unless the server runs without tokens.
    timeout_s
        For each call.
    """

    def __init__(
        self,
        url: str,
        token: str | None = None,
        timeout_s: float = 30.0,
        outbox: Path | str | None = None,
    ) -> None:
        super().__init__(outbox)
        self.url, socket = addresses(url)
        self._socket = ServiceSocket(socket, token, timeout_s)
        self._token = token
        self._timeout_s = timeout_s
        self._http: httpx.Client | None = None
        self._opening = threading.Lock()

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        return self._socket.call(f"/rtask/{operation}", args, operation in REPEATABLE, timeout_s)

    def query(self, sparql: str) -> list[dict[str, Any]]:
        """Return the rows of a SELECT; see :meth:`Client.query`."""
        answer = self._ask(sparql)
        if "results" not in answer:
            raise UsageError("query() is for SELECT queries; use ask() for ASK")
        names = answer["head"]["vars"]
        return [
            {name: _value(row.get(name)) for name in names} for row in answer["results"]["bindings"]
        ]

    def ask(self, sparql: str) -> bool:
        """Return the answer of an ASK."""
        answer = self._ask(sparql)
        if "boolean" not in answer:
            raise UsageError("ask() is for ASK queries; use query() for SELECT")
        return bool(answer["boolean"])

    def _ask(self, sparql: str) -> dict[str, Any]:
        kind = {
            "Content-Type": "application/sparql-query",
            "Accept": "application/sparql-results+json",
        }
        answer = self._post("/query", sparql, kind, may_repeat=True)
        try:
            fields: dict[str, Any] = answer.json()
        except ValueError as error:
            raise CallFailedError(f"{self.url}/query did not answer with JSON results") from error
        self._deliver_waiting()
        return fields

    def update(self, sparql: str) -> None:
        """Carry out a SPARQL update with the token's rights."""
        kind = {"Content-Type": "application/sparql-update"}
        self._post("/update", sparql, kind, may_repeat=False)
        self._deliver_waiting()

    def follow(
        self,
        s: str | None = None,
        p: str | None = None,
        o: str | None = None,
        graph: str | None = None,
        *,
        cls: str | None = None,
        inferred: bool = True,
        since: str | None = None,
    ) -> Iterator[FollowedChange]:
        """Yield commits as they come; see :meth:`Client.follow`."""
        pattern = Pattern(s, p, o, graph, cls, inferred)
        return follow_remote(self._session, pattern, since, self._timeout_s)

    def answer(self, text: str) -> dict[str, Any]:
        """Answer a question in words; see :meth:`Client.answer`."""
        place = f"/ask?{urlencode({'text': text})}"
        answered: dict[str, Any] = self._exchange("GET", place, may_repeat=True)
        return answered

    def services(self) -> list[dict[str, Any]]:
        """Return the services that are offered; see :meth:`Client.services`."""
        services: list[dict[str, Any]] = self._exchange("GET", "/services", may_repeat=True)[
            "services"
        ]
        return services

    def describe_service(self, name: str) -> dict[str, Any]:
        """Return the description of a service; see :meth:`Client.describe_service`."""
        description: dict[str, Any] = self._exchange("GET", _address(name), may_repeat=True)
        return description

    def call_service(
        self,
        name: str,
        method: str,
        args: Mapping[str, Any] | None = None,
        data: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
        may_repeat: bool = False,
    ) -> dict[str, Any]:
        """Call a method of a service; see :meth:`Client.call_service`."""
        body = {**(args or {}), **({"$data": dict(data)} if data else {})}
        path = f"{_address(name)}/{quote(method)}"
        answer: dict[str, Any] = self._exchange(
            "POST", path, body, may_repeat, timeout_s, is_bounded=timeout_s is not None
        )
        return answer

    def _exchange(
        self,
        method: str,
        path: str,
        body: Any = None,
        may_repeat: bool = False,
        timeout_s: float | None = None,
        *,
        is_bounded: bool = False,
    ) -> Any:
        """Send a request with JSON, and return the JSON of the answer.

        Parameters
        ----------
        is_bounded
            Whether the server is told how much of the time is left at each try.
        """
        import httpx

        patience = Patience(self._timeout_s if timeout_s is None else timeout_s)

        def send() -> httpx.Response:
            left_s = max(patience.left_s, _LEAST_S)
            # The server ends the call a little earlier, so that its reason arrives in time.
            address = f"{path}?timeout={left_s - min(_MARGIN_S, left_s / 20):.3f}"
            return self._session().request(
                method, address if is_bounded else path, json=body, timeout=left_s
            )

        try:
            answer = _patiently(send, patience, may_repeat)
        except httpx.TransportError as error:
            raise RemoteUnavailableError(f"{self.url} cannot be reached: {error}") from error
        if answer.is_error:
            raise failure_of(answer)
        return answer.json()

    def close(self) -> None:
        """Close both connections."""
        self._socket.close()
        if self._http is not None:
            self._http.close()
            self._http = None

    def _post(
        self, path: str, text: str, headers: dict[str, str], may_repeat: bool
    ) -> httpx.Response:
        import httpx

        def send() -> httpx.Response:
            return self._session().post(path, content=text.encode(), headers=headers)

        try:
            answer = _patiently(send, Patience(self._timeout_s), may_repeat)
        except httpx.TransportError as error:
            raise RemoteUnavailableError(f"{self.url} cannot be reached: {error}") from error
        if answer.is_error:
            raise failure_of(answer)
        return answer

    def _session(self) -> httpx.Client:
        import httpx

        with self._opening:
            if self._http is None:
                self._http = httpx.Client(
                    base_url=self.url,
                    headers=authorization(self._token),
                    timeout=self._timeout_s,
                    trust_env=not is_near(self.url),
                )
            return self._http


def _address(service: str) -> str:
    return f"/services/{quote(service, safe='/@*.')}"


def _patiently(
    send: Callable[[], httpx.Response], patience: Patience, may_repeat: bool
) -> httpx.Response:
    """Send, and again after a pause while nobody has time; what arrived is not repeated."""
    import httpx

    while True:
        try:
            answer = send()
        except httpx.TransportError as error:
            never_arrived = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
            if not (may_repeat or never_arrived) or isinstance(error, httpx.ReadTimeout):
                raise
            if not patience.wait():
                raise
        else:
            # A gateway may have passed on what it then lost the answer of.
            repeatable = answer.status_code in (429, 503) or may_repeat
            is_late = answer.status_code == 504  # it had all its time
            if not repeatable or is_late or not is_transient(answer) or not patience.wait():
                return answer


def _value(binding: dict[str, Any] | None) -> object:
    """Return one value of SPARQL 1.1 JSON results as :meth:`Client.query` gives it."""
    from rtask.rdf.terms import Literal, NamedNode, python_value

    if binding is None:
        return None
    if binding["type"] not in ("literal", "typed-literal"):
        return binding["value"] if binding["type"] == "uri" else str(binding["value"])
    datatype = binding.get("datatype")
    if datatype is None:
        return binding["value"]
    return python_value(Literal(binding["value"], datatype=NamedNode(datatype)))
