"""A knowledge base as one session sees it: whose graph it writes, and what it asks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.errors import ClosedError, UsageError
from rtask.model.backing import Backed, backing_of
from rtask.model.query.plan import finished
from rtask.rdf.terms import GraphName
from rtask.sparql.results import Solutions

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["View"]


class View:
    """A knowledge base as one agent's session sees it.

    Parameters
    ----------
    kb
        The knowledge base.
    agent
        Who writes; without an agent, statements go to the shared graph.
    inferred
        Whether derived statements are visible. By default the setting of the knowledge base.
    """

    def __init__(self, kb: GraphCore | Backed, agent: str | None, inferred: bool | None) -> None:
        self.kb = kb
        self.agent = agent
        self.backing = backing_of(kb)
        self.inferred = self.backing.derives() if inferred is None else inferred
        self.closed = False

    @property
    def home(self) -> GraphName:
        """The graph that the session writes."""
        return self.backing.home(self.agent)

    def check_open(self) -> None:
        """Raise if the session is closed."""
        if self.closed:
            raise ClosedError("the session is closed; open another with kb.session()")

    def select(self, text: str) -> Solutions:
        """Run a SELECT; known prefixes are added."""
        return self.rows(finished(text))

    def rows(self, text: str) -> Solutions:
        """Run a SELECT whose prefixes are declared."""
        self.check_open()
        answer = self.kb.query(text, inferred=self.inferred)
        if not isinstance(answer, Solutions):
            raise UsageError("select() is for SELECT queries")
        return answer

    def holds(self, text: str) -> bool:
        """Run an ASK whose prefixes are declared."""
        self.check_open()
        return self.kb.query(text, inferred=self.inferred) is True
