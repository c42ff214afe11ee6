"""A client of a knowledge base in the same process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtask.client.base import Client
from rtask.client.following import FollowedChange
from rtask.engine.engine import Engine
from rtask.errors import UsageError
from rtask.kb.commit.access import Access

if TYPE_CHECKING:
    from rtask.services.host import ServiceHost

__all__ = ["LocalClient"]


class LocalClient(Client):
    """Calls the engine directly.

    Parameters
    ----------
    engine
        Stays open when the client is closed, unless ``owns_engine``.
    agent
        Name of the robot on whose behalf calls are made; None = the owner of the store.
    """

    def __init__(
        self,
        engine: Engine,
        agent: str | None = None,
        outbox: Path | str | None = None,
        owns_engine: bool = False,
    ) -> None:
        super().__init__(outbox)
        self.engine = engine
        self._access = Access(agent, "robot") if agent else Access()
        self._owns_engine = owns_engine
        self._services: ServiceHost | None = None

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        return self.engine.call(operation, args, self._access).as_json()

    def query(self, sparql: str) -> list[dict[str, Any]]:
        """Return the rows of a SELECT; see :meth:`Client.query`."""
        rows: list[dict[str, Any]] = self.engine.kb.select(sparql).to_dicts()
        return rows

    def ask(self, sparql: str) -> bool:
        """Return the answer of an ASK."""
        answer = self.engine.kb.query(sparql)
        if not isinstance(answer, bool):
            raise UsageError("ask() is for ASK queries; use query() for SELECT")
        return answer

    def update(self, sparql: str) -> None:
        """Carry out a SPARQL update with this client's rights."""
        self.engine.kb.update(sparql, access=self._access)

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
        kb = self.engine.kb
        value = None if o is None else _term(o)
        subscription = kb.subscribe(
            s and s.strip("<>"), p and p.strip("<>"), value, graph and graph.strip("<>"),
            cls=cls and cls.strip("<>"), inferred=inferred,
            since=since or kb.feed.position(kb.feed.last_seq),
        )  # fmt: skip

        def followed() -> Iterator[FollowedChange]:
            with subscription:
                for change in subscription:
                    yield FollowedChange.of(change, kb.feed.position(change.commit.seq))

        return followed()

    def answer(self, text: str) -> dict[str, Any]:
        """Answer a question in words; see :meth:`Client.answer`."""
        from rtask.asking.questions import answer

        return answer(self.engine.kb, text).to_dict()

    def services(self) -> list[dict[str, Any]]:
        """Return the services that are offered; see :meth:`Client.services`."""
        return self._host().listing()

    def describe_service(self, name: str) -> dict[str, Any]:
        """Return the description of a service; see :meth:`Client.describe_service`."""
        return self._host().description(name)

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
        return self._host().call(name, method, args, self._access, data, timeout_s).as_json()

    def _host(self) -> ServiceHost:
        if self._services is None:
            from rtask.services.offered import open_host

            self._services = open_host(self.engine)
        return self._services

    def close(self) -> None:
        """Close the services, and the engine if it was made for this client."""
        if self._services is not None:
            self._services.close()
            self._services = None
        if self._owns_engine:
            self.engine.close()


def _term(text: str) -> Any:
    """Return a term written as a plain IRI or as in N-Triples."""
    from pyoxigraph import RdfFormat, parse

    from rtask.rdf.terms import iri

    if not text.startswith(('"', "<")):
        return iri(text)
    try:
        (quad,) = parse(f"<urn:s> <urn:p> {text} .".encode(), format=RdfFormat.N_TRIPLES)
    except (ValueError, SyntaxError) as error:
        raise UsageError(f"o: {text[:100]!r} is no term: {error}") from None
    return quad.object
