"""Catalogue of graphs and commits, kept in the meta and provenance graphs.

The provenance graph has one ``rt:WriteActivity`` for each commit (PROV-O); the meta graph records
each graph's class, owner, last commit and number of triples. Both are written in the same commit
as the change itself.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from pyoxigraph import Quad

import ontology
from rtask.kb.commit.foreign.claims import Keys
from rtask.kb.durability.blobs import Blob
from rtask.kb.durability.journal import CommitRecord
from rtask.kb.store.declared_terms import declared_terms
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs, graph_class
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import Derived
from rtask.rdf.terms import (
    RDF_TYPE,
    DefaultGraph,
    GraphName,
    NamedNode,
    Term,
    iri,
    literal,
    python_value,
    stored,
)

__all__ = ["Catalogue", "GraphFacts"]

_RT = ontology.NS
_PROV = "http://www.w3.org/ns/prov#"
_COMMIT_NUMBER = iri(_RT + "commitNumber")
_TRIPLE_COUNT = iri(_RT + "tripleCount")
_HAS_BLOB = iri(_RT + "hasBlob")
_GRAPH_OWNER = iri(_RT + "graphOwner")
_CHANGED_GRAPH = iri(_RT + "changedGraph")
_ASSOCIATED = iri(_PROV + "wasAssociatedWith")
_STARTED = iri(_PROV + "startedAtTime")
_ENDED = iri(_PROV + "endedAtTime")
_COMMENT = iri("http://www.w3.org/2000/01/rdf-schema#comment")
_ONTOLOGY = "OntologyGraph"
_ACTIVITY_TYPES = (iri(_RT + "WriteActivity"), iri(_PROV + "Activity"))


@dataclass(frozen=True)
class GraphFacts:
    """Properties of a commit's graphs that cannot be told from its statements.

    Parameters
    ----------
    kinds
        Classes of graphs whose class cannot be told from their IRI, e.g. ``OntologyGraph``.
    sources
        The document that a graph was loaded from.
    sizes
        Counted sizes of graphs that changed outside a commit.
    closure_current
        Whether the inferred graph now agrees with the asserted ones; ``None`` if this commit does
        not affect that. The catalogue names the inferred graph's commit only while they agree.
    """

    kinds: Mapping[GraphName, str]
    sources: Mapping[GraphName, Blob]
    sizes: Mapping[GraphName, int]
    closure_current: bool | None


@dataclass
class _Entry:
    seq: int | None = None
    triples: int = 0
    kind: str = "NamedGraph"


@dataclass
class Catalogue:
    """The catalogue, mirrored in memory so that commits need not query it."""

    store: GraphStore
    graphs: Graphs
    _entries: dict[GraphName, _Entry] = field(default_factory=dict)
    _declared: frozenset[NamedNode] | None = None
    _keys: Keys | None = None

    def __post_init__(self) -> None:
        self.refresh()

    def refresh(self) -> None:
        """Read the catalogue from the store again."""
        self._entries.clear()
        self._declared = self._keys = None
        for quad in self.store.quads_for_pattern(None, None, None, self.graphs.meta):
            self._take(quad)

    def _take(self, quad: Quad) -> None:
        """Mirror one statement of the meta graph."""
        if not isinstance(quad.subject, NamedNode):
            return
        entry = self._entries.setdefault(quad.subject, _Entry())
        if quad.predicate == _COMMIT_NUMBER:
            entry.seq = _integer(quad.object)
        elif quad.predicate == _TRIPLE_COUNT:
            entry.triples = _integer(quad.object)
        elif quad.predicate == RDF_TYPE and isinstance(quad.object, NamedNode):
            entry.kind = quad.object.value.removeprefix(_RT)
        if entry.kind == _ONTOLOGY:
            self._declared = self._keys = None

    @property
    def seq(self) -> int:
        """Number of the last commit."""
        entry = self._entries.get(self.graphs.meta)
        return (entry.seq if entry else None) or 0

    def revision(self, graph: GraphName) -> int | None:
        """Return the number of the last commit that changed a graph."""
        entry = self._entries.get(graph)
        return entry.seq if entry else None

    def triple_count(self, graph: GraphName) -> int:
        """Return how many triples a graph holds."""
        entry = self._entries.get(graph)
        return entry.triples if entry else 0

    def kind(self, graph: GraphName) -> str:
        """Return the local name of a graph's class."""
        entry = self._entries.get(graph)
        return entry.kind if entry else self.graphs.kind(graph)

    def is_ontology(self, graph: GraphName) -> bool:
        """Whether a graph holds an ontology."""
        return self.kind(graph) == _ONTOLOGY

    def declared(self) -> frozenset[NamedNode]:
        """Return what :func:`rtask.kb.store.declared_terms.declared_terms` yields now."""
        if self._declared is None:
            self._declared = frozenset(declared_terms(self.store, self.ontologies()))
        return self._declared

    def keys(self) -> Keys:
        """Return the keys of the ontologies, and those stated elsewhere when one changed last."""
        if self._keys is None:
            self._keys = Keys.read(self.store)
        return self._keys

    def last_time(self) -> dt.datetime | None:
        """Return the time at which the last commit ended; ``None`` if there was none."""
        activity, graph = self.activity(self.seq), self.graphs.provenance
        for quad in self.store.quads_for_pattern(activity, _ENDED, None, graph):
            return dt.datetime.fromisoformat(str(python_value(quad.object)))
        return None

    def ontologies(self) -> list[NamedNode]:
        """Return the graphs that hold ontologies, sorted."""
        ontologies = [g for g in self._entries if isinstance(g, NamedNode) and self.is_ontology(g)]
        return sorted(ontologies, key=lambda graph: graph.value)

    def activity(self, seq: int) -> NamedNode:
        """Return the individual that stands for a commit."""
        return iri(f"{self.graphs.base}activity/{seq}")

    def record(
        self,
        change: Overlay,
        derived: Derived,
        commit: CommitRecord,
        facts: GraphFacts,
    ) -> Overlay:
        """Return the change that a commit makes to the meta and provenance graphs."""
        notes = Overlay(self.store)
        touched = change.touched_graphs() | facts.sizes.keys()
        if derived.added or derived.removed:
            touched.add(self.graphs.inferred)
        changed = [graph for graph in touched if not isinstance(graph, DefaultGraph)]
        changed.sort(key=str)  # a set has no order, and the record of a commit should have one
        counts = Counter(quad.graph_name for quad in change.added)
        counts.subtract(Counter(quad.graph_name for quad in change.removed))
        counts[self.graphs.inferred] += len(derived.added) - len(derived.removed)
        self._describe_activity(notes, commit, changed)
        for graph in changed:
            if graph in change.dropped:
                self._forget(notes, graph)
                continue
            self._describe_graph(notes, graph, commit, facts.kinds.get(graph))
            self._name_source(notes, graph, facts.sources.get(graph))
            self._set_number(notes, graph, _COMMIT_NUMBER, self.revision(graph), commit.seq)
            before = self.triple_count(graph)
            last_count = before if graph in self._entries else None
            self._set_number(
                notes,
                graph,
                _TRIPLE_COUNT,
                last_count,
                facts.sizes.get(graph, before + counts[graph]),
            )
        self._mark_closure(notes, commit, facts.closure_current, changed)
        meta, provenance = self.graphs.meta, self.graphs.provenance
        self._describe_graph(notes, provenance, commit, None)
        self._describe_graph(notes, meta, commit, None)
        self._set_number(notes, meta, _COMMIT_NUMBER, self.revision(meta), commit.seq)
        return notes

    def _describe_activity(
        self, notes: Overlay, commit: CommitRecord, changed: Iterable[GraphName]
    ) -> None:
        activity, graph = self.activity(commit.seq), self.graphs.provenance

        def say(predicate: NamedNode, value: Term) -> None:
            notes.added[Quad(activity, predicate, stored(value), graph)] = None

        for kind in _ACTIVITY_TYPES:
            say(RDF_TYPE, kind)
        say(_COMMIT_NUMBER, literal(commit.seq))
        say(_STARTED, literal(commit.started))
        say(_ENDED, literal(commit.ended))
        if commit.agent:
            agent = self.graphs.agent_iri(commit.agent, commit.role)
            say(_ASSOCIATED, agent)
        for name in changed:
            if isinstance(name, NamedNode):
                say(_CHANGED_GRAPH, name)
        if commit.note:
            say(_COMMENT, literal(commit.note))

    def _describe_graph(
        self, notes: Overlay, graph: GraphName, commit: CommitRecord, kind: str | None
    ) -> None:
        entry = self._entries.get(graph)
        if not isinstance(graph, NamedNode) or (entry and kind in (None, entry.kind)):
            return
        if entry:
            notes.removed[Quad(graph, RDF_TYPE, graph_class(entry.kind), self.graphs.meta)] = None
        kind = kind or self.graphs.kind(graph)
        notes.added[Quad(graph, RDF_TYPE, graph_class(kind), self.graphs.meta)] = None
        owner = self.graphs.owner(graph)
        if owner is not None and not entry:
            role = commit.role if commit.agent == owner else "robot"
            agent = self.graphs.agent_iri(owner, role)
            notes.added[Quad(graph, _GRAPH_OWNER, agent, self.graphs.meta)] = None

    def _name_source(self, notes: Overlay, graph: GraphName, source: Blob | None) -> None:
        if source is None or not isinstance(graph, NamedNode):
            return
        meta = self.graphs.meta
        for old in self.store.quads_for_pattern(graph, _HAS_BLOB, None, meta):
            if old.object != source.iri:
                notes.removed[old] = None
        for triple in ((graph, _HAS_BLOB, source.iri), *source.statements()):
            quad = Quad(*triple, meta)
            if quad not in self.store:
                notes.added[quad] = None

    def source(self, graph: NamedNode) -> NamedNode | None:
        """Return the blob of the document that a graph was loaded from."""
        for quad in self.store.quads_for_pattern(graph, _HAS_BLOB, None, self.graphs.meta):
            if isinstance(quad.object, NamedNode):
                return quad.object
        return None

    def _set_number(
        self, notes: Overlay, graph: GraphName, predicate: NamedNode, old: int | None, new: int
    ) -> None:
        if old == new or not isinstance(graph, NamedNode):
            return
        meta = self.graphs.meta
        if old is not None:
            notes.removed[Quad(graph, predicate, literal(old), meta)] = None
        notes.added[Quad(graph, predicate, literal(new), meta)] = None

    def _forget(self, notes: Overlay, graph: GraphName) -> None:
        if isinstance(graph, NamedNode):
            for quad in self.store.quads_for_pattern(graph, None, None, self.graphs.meta):
                notes.removed[quad] = None

    def _mark_closure(
        self,
        notes: Overlay,
        commit: CommitRecord,
        closure_current: bool | None,
        changed: Iterable[GraphName],
    ) -> None:
        inferred = self.graphs.inferred
        revision = self.revision(inferred)
        if closure_current and revision is None and inferred not in changed:
            self._describe_graph(notes, inferred, commit, None)
            self._set_number(notes, inferred, _COMMIT_NUMBER, None, commit.seq)
            if inferred not in self._entries:
                self._set_number(notes, inferred, _TRIPLE_COUNT, None, 0)
        elif closure_current is False and revision is not None:
            notes.removed[Quad(inferred, _COMMIT_NUMBER, literal(revision), self.graphs.meta)] = (
                None
            )

    def apply(self, notes: Overlay) -> None:
        """Update the mirror after the record has been stored."""
        # What goes first: a graph's new number comes with the removal of its old one.
        for quad in notes.removed:
            if quad.graph_name == self.graphs.meta and quad.predicate == _COMMIT_NUMBER:
                assert isinstance(quad.subject, NamedNode)
                self._entries[quad.subject].seq = None
        for quad in notes.added:
            if quad.graph_name == self.graphs.meta:
                self._take(quad)

    def forget(self, graph: GraphName) -> None:
        """Drop a graph's entry after the graph was dropped."""
        self._entries.pop(graph, None)
        self._declared = self._keys = None


def _integer(term: object) -> int:
    value = getattr(term, "value", "")
    try:
        return int(value)
    except ValueError:
        return 0
