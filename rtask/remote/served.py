"""The knowledge base behind a server of RTASK, with Python objects.

Sessions read by ``/sparql``. What one writes is one update, on the condition that nobody has
committed since it read what it changes (``if-version``); else it reads again. Each answer names the
last commit (``RTASK-Version``): what others have changed since the answer before is asked of
``/changes``, so that objects concerned are read again.
"""

from __future__ import annotations

import datetime as dt
import json
import random
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import httpx
from pyoxigraph import NamedNode

from rtask.errors import RemoteError, UnsupportedError, VersionConflictError
from rtask.kb.commit.commit import Commit
from rtask.kb.store.graphs import Graphs
from rtask.model.backing import Touched, Work
from rtask.rdf.terms import GraphName, Literal, Term
from rtask.remote.commits import Commits
from rtask.remote.endpoints import TRIPLES, Endpoints
from rtask.remote.excerpt import Collected, Excerpt
from rtask.remote.knowledge_base import RemoteKnowledgeBase
from rtask.remote.transport import read_whole
from rtask.sparql.results import Triples

if TYPE_CHECKING:
    from rtask.model.dynamic import Vocabulary
    from rtask.model.session import Session

__all__ = ["ServedKnowledgeBase", "open_served"]

_URI_SPACE = NamedNode("http://rdfs.org/ns/void#uriSpace")
_ATTEMPTS = 12
_PAUSE_S = 0.002
_MAX_PAUSE_S = 0.25


class ServedKnowledgeBase(RemoteKnowledgeBase):
    """A server of RTASK, used like an embedded knowledge base.

    Parameters
    ----------
    query_url, update_url, token, timeout_s
        As for :class:`RemoteKnowledgeBase`.
    """

    keeps_authors = True

    def __init__(
        self,
        query_url: str,
        update_url: str | None = None,
        token: str | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        super().__init__(query_url, update_url, token, timeout_s)
        self._commits = Commits(self._connection, query_url)

    def session(self, agent: str | None = None, **options: Any) -> Session:
        """Return a unit of work over Python objects; see :class:`rtask.model.Session`."""
        from rtask.model.session import Session

        return Session(self, agent, **options)

    def model(self, name: NamedNode | str) -> Vocabulary:
        """Return Python classes for a loaded ontology; see :func:`rtask.model.load_model`."""
        from rtask.model.dynamic import load_model

        return load_model(self, name)

    @cached_property
    def graphs(self) -> Graphs:
        """Names of the server's graphs, as its service description implies them.

        Raises
        ------
        UnsupportedError
            The server has no graphs of agents: it serves a bare dataset.
        """
        answer = self._connection.send(self.query_url, None, TRIPLES, repeat=True)
        described = read_whole("triples", answer.content)
        assert isinstance(described, Triples)
        for triple in described:
            if triple.predicate == _URI_SPACE and isinstance(triple.object, Literal):
                return Graphs(triple.object.value)
        raise UnsupportedError(
            f"{self.query_url} has no graphs of agents (--profile plain), so it takes no sessions;"
            " send updates"
        )

    @property
    def base(self) -> str:
        """IRI that starts every instance of the server's knowledge base."""
        return self.graphs.base

    @property
    def seq(self) -> int:
        """Number of the last commit; asks the server."""
        return int(self._commits.current().rpartition(":")[2])

    def backing(self) -> ServedObjects:
        """Return how objects are read and written."""
        return ServedObjects(self, self._commits)

    def write_if(
        self, version: str, text: str, agent: str | None, note: str | None
    ) -> Mapping[str, int]:
        """Run an update unless somebody has committed since a version; return its counts.

        Raises
        ------
        VersionConflictError
            Somebody has; nothing was changed.
        """
        fields = [("update", text), ("if-version", version), *self._author(agent, note)]
        counts: Mapping[str, int] = json.loads(
            self._send(self.update_url, fields, "application/json", False).content
        )
        return counts

    def _send(
        self,
        url: str,
        fields: list[tuple[str, str]],
        accept: str,
        repeat: bool,
        timeout_s: float | None = None,
    ) -> httpx.Response:
        if not repeat:  # an update
            answer = super()._send(url, fields, accept, repeat, timeout_s)
            self._commits.wrote(answer)
            return answer
        headers = self._commits.at_least
        try:
            answer = self._connection.send(
                url, fields, accept, repeat=True, timeout_s=timeout_s, headers=headers
            )
        except RemoteError:
            self._commits.give_up_waiting()
            raise
        self._commits.read(answer)
        return answer


class ServedObjects:
    """Objects on a server of RTASK: a :class:`rtask.model.backing.Backing`."""

    def __init__(self, kb: ServedKnowledgeBase, commits: Commits) -> None:
        self._kb = kb
        self._commits = commits

    def home(self, agent: str | None) -> GraphName:
        """Return the graph that an agent writes; who shows a token has to name its agent."""
        graphs = self._kb.graphs
        return graphs.agent(agent) if agent else graphs.shared

    def derives(self) -> bool:
        """Whether the server's graph contains derived statements."""
        return self._kb.query(f"ASK {{ GRAPH {self._kb.graphs.inferred} {{ ?s ?p ?o }} }}") is True

    def about(self, subject: NamedNode, most: int) -> Iterable[tuple[str, Term]]:
        """Yield predicates and values of a subject, with one query."""
        for predicate, value in self._kb.select(f"SELECT ?p ?o {{ {subject} ?p ?o }} LIMIT {most}"):
            assert isinstance(predicate, NamedNode)
            assert value is not None
            yield predicate.value, value

    def on_touched(self, listener: Callable[[Touched], None]) -> Callable[[], None]:
        """Call ``listener`` when an answer shows that there were commits."""
        return self._commits.listen(listener)

    def write(
        self, work: Work, subjects: Collection[str], agent: str | None, note: str | None
    ) -> Commit:
        """Commit what ``work`` changes as one update, if nobody commits meanwhile; else again.

        Raises
        ------
        VersionConflictError
            Others were faster each time.
        """
        for attempt in range(_ATTEMPTS):
            version = self._commits.current()
            changes = Collected()
            with self._commits.no_older_than(version):
                work(changes, Excerpt(self._kb, subjects))
            if not changes:
                return _commit({"seq": int(version.rpartition(":")[2])}, None)
            try:
                counts = self._kb.write_if(version, changes.text(), agent, note)
            except VersionConflictError:
                if attempt + 1 == _ATTEMPTS:
                    raise
                time.sleep(random.uniform(0.5, 1.0) * min(_PAUSE_S * 2**attempt, _MAX_PAUSE_S))
            else:
                return _commit(counts, self._commits.record(counts["seq"]))
        raise AssertionError("the last attempt returns or raises")


def _commit(counts: Mapping[str, Any], record: Mapping[str, Any] | None) -> Commit:
    """Return a commit as the server tells it; without its record, by this machine's clock."""
    activity = str(record["activity"]) if record else ""
    return Commit(
        counts["seq"],
        counts.get("added", 0),
        counts.get("removed", 0),
        counts.get("derived", 0),
        dt.datetime.fromisoformat(record["time"]) if record else dt.datetime.now(dt.UTC),
        NamedNode(activity) if activity else None,
        remark=counts.get("remark"),
    )


def open_served(
    endpoints: Endpoints, token: str | None = None, timeout_s: float = 30.0
) -> ServedKnowledgeBase:
    """Return the knowledge base of a server of RTASK."""
    return ServedKnowledgeBase(endpoints.query_url, endpoints.update_url, token, timeout_s)
