"""Following the graph: commits as a robot program hears them, near or far."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rtask.client.failures import Patience, failure_of
from rtask.errors import EpochChangedError, GoneError, RemoteUnavailableError

if TYPE_CHECKING:
    import httpx

    from rtask.kb.commit.commit import Change

__all__ = ["FollowedChange", "Pattern", "follow_remote"]

_SILENCE_S = 45.0  # the server says something every 15 s
Statement = tuple[str, str, str, str]


@dataclass(frozen=True)
class Pattern:
    """Pattern of the statements to follow: IRIs, or terms as N-Triples write them; None fits all.

    Parameters
    ----------
    cls
        Statements about instances of a class, derived ones included.
    """

    s: str | None = None
    p: str | None = None
    o: str | None = None
    graph: str | None = None
    cls: str | None = None
    inferred: bool = True

    def parameters(self) -> dict[str, str]:
        """Return the pattern as parameters of an address."""
        named = {"s": self.s, "p": self.p, "o": self.o, "graph": self.graph, "class": self.cls}
        given = {name: text for name, text in named.items() if text is not None}
        return given if self.inferred else {**given, "inferred": "0"}


@dataclass(frozen=True)
class FollowedChange:
    """The changes of one commit to what is followed.

    Parameters
    ----------
    version
        After it; what ``follow(since=...)`` goes on from.
    seq
        Number of the commit.
    agent
        Who wrote; empty for the owner of the store.
    added, removed, inferred_added, inferred_removed
        (subject, predicate, object, graph), each as N-Triples write it; the graph is empty for the
        default graph.
    """

    version: str
    seq: int
    agent: str
    added: tuple[Statement, ...]
    removed: tuple[Statement, ...]
    inferred_added: tuple[Statement, ...] = ()
    inferred_removed: tuple[Statement, ...] = ()

    @classmethod
    def of(cls, change: Change, version: str) -> FollowedChange:
        """Return a commit of a knowledge base in this process."""
        from rtask.rdf.terms import NamedNode

        def statements(quads: Any) -> tuple[Statement, ...]:
            return tuple(
                (
                    str(q.subject), str(q.predicate), str(q.object),
                    str(q.graph_name) if isinstance(q.graph_name, NamedNode) else "",
                )
                for q in quads
            )  # fmt: skip

        return cls(
            version,
            change.commit.seq,
            change.agent or "",
            statements(change.added),
            statements(change.removed),
            statements(change.inferred_added),
            statements(change.inferred_removed),
        )

    @classmethod
    def from_event(cls, data: dict[str, Any], version: str) -> FollowedChange:
        """Return a commit as a server told it."""

        def statements(rows: Any) -> tuple[Statement, ...]:
            return tuple((row[0], row[1], row[2], row[3]) for row in rows)

        inferred = data["inferred"]
        return cls(
            version,
            int(data["seq"]),
            str(data["agent"]),
            statements(data["added"]),
            statements(data["removed"]),
            statements(inferred["added"]),
            statements(inferred["removed"]),
        )


def follow_remote(
    session: Callable[[], httpx.Client], pattern: Pattern, since: str | None, timeout_s: float
) -> Iterator[FollowedChange]:
    """Yield commits from a server, over as many connections as it takes.

    Raises
    ------
    GoneError, EpochChangedError
        What was missed is no longer kept; read everything again and follow from
        ``details["version"]``.
    RemoteUnavailableError
        Nobody answered for ``timeout_s``.
    """
    import httpx

    patience, version = Patience(timeout_s), since or ""
    while True:
        try:
            for name, data, id_ in _events(session(), pattern, version):
                patience = Patience(timeout_s)
                if name == "hello" and not version:
                    version = str(data["version"])
                if name in ("gone", "epoch"):
                    kind = GoneError if name == "gone" else EpochChangedError
                    raise kind(str(data["detail"]), version=data["version"])
                if name != "change":
                    continue
                if data.get("truncated"):
                    answer = session().get(str(data["whole"]))
                    if answer.is_error:
                        raise failure_of(answer)
                    data = answer.json()
                version = id_
                yield FollowedChange.from_event(data, id_)
        except httpx.TransportError as error:
            if not patience.wait():
                raise RemoteUnavailableError(f"/changes: {error}") from error
        else:
            if not patience.wait():
                raise RemoteUnavailableError("/changes: the server stopped and is not back")


def _events(
    client: httpx.Client, pattern: Pattern, since: str
) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield name, data and id of the events of one connection (HTML Standard, 9.2.6)."""
    import httpx

    headers = {"Accept": "text/event-stream", **({"Last-Event-ID": since} if since else {})}
    timeout = httpx.Timeout(10.0, read=_SILENCE_S)
    with client.stream(
        "GET", "/changes", params=pattern.parameters(), headers=headers, timeout=timeout
    ) as answer:
        if answer.status_code in (502, 503, 504):
            raise httpx.ConnectError(f"the server answered {answer.status_code}")
        if answer.is_error:
            answer.read()
            raise failure_of(answer)
        fields: dict[str, str] = {}
        for line in answer.iter_lines():
            if line and not line.startswith(":"):
                name, _, value = line.partition(": ")
                fields[name] = value
            elif not line and "event" in fields:
                yield fields["event"], json.loads(fields.get("data", "{}")), fields.get("id", "")
                fields = {}
