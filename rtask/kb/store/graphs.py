"""Named graphs of a knowledge base: IRIs, kinds and owners.

Other code does not spell out IRIs of graphs but uses :class:`Graphs`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from urllib.parse import quote, unquote

from pyoxigraph import DefaultGraph, NamedNode

import ontology
from rtask.errors import UsageError
from rtask.rdf.terms import GraphName, iri

__all__ = ["Graphs"]

_RT = ontology.NS
_QUARANTINE = "quarantine"
_OF_SERVERS = ("store", "union", "staged")
"""Of a knowledge base on a SPARQL server; see :mod:`rtask.remote`."""
_KINDS = {
    "inferred": "InferredGraph",
    "shared": "SharedGraph",
    "meta": "MetaGraph",
    "provenance": "ProvenanceGraph",
    "rules": "RuleBaseGraph",
    _QUARANTINE: "QuarantineGraph",
}
_SYSTEM = frozenset(
    {"InferredGraph", "MetaGraph", "ProvenanceGraph", "RuleGraph", "QuarantineGraph"}
)


@dataclass(frozen=True)
class Graphs:
    """Names of the graphs below one base.

    Parameters
    ----------
    base
        IRI that starts every instance and graph of the knowledge base; ends in ``/``.

    Examples
    --------
    >>> graphs = Graphs("urn:lab/")
    >>> graphs.agent("nao-1").value, graphs.kind(graphs.inferred)
    ('urn:lab/graph/agent/nao-1', 'InferredGraph')
    """

    base: str

    @cached_property
    def inferred(self) -> NamedNode:
        """Graph of derived statements; only the reasoner writes it."""
        return self._named("inferred")

    @cached_property
    def shared(self) -> NamedNode:
        """Graph shared by all; unnamed callers write here."""
        return self._named("shared")

    @cached_property
    def meta(self) -> NamedNode:
        """Graph that catalogues the graphs; written by commits only."""
        return self._named("meta")

    @cached_property
    def provenance(self) -> NamedNode:
        """Graph with one activity for each commit; written by commits only."""
        return self._named("provenance")

    @cached_property
    def rules(self) -> NamedNode:
        """Graph of the users' rules; writing it is a right of its own."""
        return self._named("rules")

    @cached_property
    def causes(self) -> NamedNode:
        """Graph of the hidden causes that the engine infers from all outcomes."""
        return self._named("causes")

    @property
    def quarantine(self) -> NamedNode:
        """Graph of contradictory statements, outside of the union; written by commits only."""
        return self._named(_QUARANTINE)

    @staticmethod
    def is_quarantine(graph: GraphName) -> bool:
        """Whether this is the quarantine graph of a knowledge base."""
        # By its end alone, since data of another base may be loaded beside the own.
        return isinstance(graph, NamedNode) and graph.value.endswith("/graph/" + _QUARANTINE)

    @staticmethod
    def is_joined(graph: GraphName) -> bool:
        """Whether a graph is part of the union."""
        return not isinstance(graph, DefaultGraph) and not Graphs.is_quarantine(graph)

    def agent(self, name: str) -> NamedNode:
        """Return the graph of a robot or person."""
        if not name:
            raise UsageError("the name of an agent is empty; give the robot's or person's name")
        # Quoted whole: a slash in a name would reach into somebody else's graphs.
        return self._named("agent/" + quote(name, safe=""))

    def imported(self, name: str) -> NamedNode:
        """Return the graph of imported data."""
        return self._named("import/" + quote(name, safe=""))

    def _named(self, path: str) -> NamedNode:
        return iri(f"{self.base}graph/{path}")

    def agent_iri(self, name: str, role: str = "robot") -> NamedNode:
        """Return the IRI of an agent.

        Teachers are ``{base}person/<name>``; all others, including callers of a server without
        tokens and the program that opened the store, are ``{base}robot/<name>``.
        """
        # A robot and a person of the same name are two agents.
        folder = "person" if role == "teacher" else "robot"
        return iri(f"{self.base}{folder}/{quote(name, safe='')}")

    def owner(self, graph: GraphName) -> str | None:
        """Return the name of the agent that owns a graph, or ``None``."""
        path = self._path(graph)
        return unquote(path[len("agent/") :]) if path.startswith("agent/") else None

    def _path(self, graph: GraphName) -> str:
        start = self.base + "graph/"
        if isinstance(graph, NamedNode) and graph.value.startswith(start):
            return graph.value[len(start) :]
        return ""

    def kind(self, graph: GraphName) -> str:
        """Return the local name of the graph's class."""
        path = self._path(graph)
        if path in _KINDS:
            return _KINDS[path]
        for start, name in (("agent", "AgentGraph"), ("import", "ImportGraph")):
            if path.startswith(start + "/"):
                return name
        if path.startswith("rules/"):
            return "RuleGraph"
        return "NamedGraph"

    def is_system(self, graph: GraphName) -> bool:
        """Whether the graph is written by the knowledge base itself only."""
        first = self._path(graph).partition("/")[0]
        return first in _OF_SERVERS or self.kind(graph) in _SYSTEM

    def is_input(self, graph: GraphName) -> bool:
        """Whether the reasoner reads this graph.

        Records of commits are excluded: they grow with every write and say nothing about the
        world. Rules are read as rules.
        """
        if not isinstance(graph, NamedNode) or graph == self.rules:
            return False
        return not self.is_system(graph)


def graph_class(kind: str) -> NamedNode:
    """Return the ontology's class for a kind of graph."""
    return NamedNode(_RT + kind)
