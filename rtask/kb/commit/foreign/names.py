"""Names of others: nobody says what a thing is before the one who names it does.

Each robot and person mints names below an IRI of its own. Whoever classifies such a name first, or
gives it the one value of a functional property, has the owner's own statement refused afterwards,
since both cannot hold. So both are left to the owner until somebody else than the caller uses the
name, or states a value.
"""

from __future__ import annotations

import re
from itertools import chain
from urllib.parse import unquote

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import RDF_TYPE, GraphName, Term

__all__ = ["ForeignNames", "minted_by"]

_RDF, _RDFS, _OWL = (ontology.PREFIXES[name] for name in ("rdf", "rdfs", "owl"))
_FUNCTIONAL = NamedNode(_OWL + "FunctionalProperty")
_DOMAIN, _RANGE, _BELOW = (NamedNode(_RDFS + n) for n in ("domain", "range", "subClassOf"))
_NAMING = (_RDF, _RDFS, _OWL)
"""Vocabularies whose properties, `rdf:type` aside, do not say what a thing is."""
_AGENTS = (NamedNode(ontology.PREFIXES["cora"] + "Robot"), NamedNode(ontology.NS + "Human"))
_MINTED = re.compile(r"(?:robot|person|agent)/([^/#]+)")


def minted_by(term: Term, graphs: Graphs) -> str | None:
    """Return who mints the names that a term is one of, or whom it names.

    >>> minted_by(NamedNode("urn:lab/robot/nao-2/cup"), Graphs("urn:lab/"))
    'nao-2'
    >>> minted_by(NamedNode("urn:cup"), Graphs("urn:lab/")) is None
    True
    """
    if not isinstance(term, NamedNode) or not term.value.startswith(graphs.base):
        return None
    match = _MINTED.match(term.value, len(graphs.base))
    return None if match is None else unquote(match[1])


class ForeignNames:
    """Tells which statements say what only another robot or person may say first.

    Parameters
    ----------
    name
        The caller.
    store
        What is stored before the change.
    home
        The graph that the caller writes.
    """

    def __init__(self, name: str, graphs: Graphs, store: GraphStore, home: GraphName) -> None:
        self._name, self._graphs, self._store, self._home = name, graphs, store, home
        self._used: dict[Term, bool] = {}
        self._cache: dict[tuple[NamedNode, NamedNode], frozenset[Term]] = {}

    def speaks_first(self, quad: Quad) -> bool:
        """Whether a statement says of a name of another what its owner has yet to say."""
        subject, predicate, value = quad.subject, quad.predicate, quad.object
        is_type = predicate == RDF_TYPE
        if not is_type and predicate.value.startswith(_NAMING):
            return False
        if self._is_of_another(subject):
            tells = not is_vocabulary(value) if is_type else self._objects(predicate, _DOMAIN)
            if tells and not self._is_used(subject):
                return True
            if not is_type and self._is_first_value(quad):
                return True
        if is_type or not self._is_of_another(value) or self._is_used(value):
            return False
        is_agent = value in (self._graphs.agent_iri(name, role) for name, role in self._both(value))
        return bool(self._objects(predicate, _RANGE)) and not (
            is_agent and self._may_be_agents(predicate)
        )

    def _both(self, value: Term) -> list[tuple[str, str]]:
        name = minted_by(value, self._graphs)
        return [(name, "robot"), (name, "teacher")] if name else []

    def _is_of_another(self, term: Term) -> bool:
        return minted_by(term, self._graphs) not in (None, self._name)

    def _is_used(self, term: Term) -> bool:
        """Tell whether anybody else than the caller uses a term."""
        cached = self._used.get(term)
        if cached is None:
            assert isinstance(term, NamedNode)
            find = self._store.quads_for_pattern
            uses = chain(find(term, None, None, None), find(None, None, term, None))
            cached = self._used[term] = any(self._is_of_others(quad.graph_name) for quad in uses)
        return cached

    def _is_of_others(self, graph: GraphName) -> bool:
        return graph != self._home and self._graphs.is_input(graph)

    def _is_first_value(self, quad: Quad) -> bool:
        if _FUNCTIONAL not in self._objects(quad.predicate, RDF_TYPE):
            return False
        given = self._store.quads_for_pattern(quad.subject, quad.predicate, None, None)
        return not any(self._is_of_others(match.graph_name) for match in given)

    def _may_be_agents(self, predicate: NamedNode) -> bool:
        """Tell whether the values of a property may all be robots or people."""
        above = {c for agent in _AGENTS for c in (agent, *self._objects(agent, _BELOW))}
        return self._objects(predicate, _RANGE) <= above

    def _objects(self, subject: NamedNode, predicate: NamedNode) -> frozenset[Term]:
        cached = self._cache.get((subject, predicate))
        if cached is None:
            match = self._store.quads_for_pattern(subject, predicate, None, None)
            cached = self._cache[subject, predicate] = frozenset(quad.object for quad in match)
        return cached


def is_vocabulary(term: Term) -> bool:
    """Whether a term belongs to RDF, RDFS or OWL."""
    return isinstance(term, NamedNode) and term.value.startswith(_NAMING)
