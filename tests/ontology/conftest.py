"""The vocabulary and its sample, closed by two engines that know nothing of each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import pyoxigraph as ox
import pytest
import rdflib

import ontology
import reasoner

INFERRED = ox.NamedNode(ontology.BASE + "sample/graph/inferred")
_OWL = "http://www.w3.org/2002/07/owl#"
_XSD_DOUBLE = "http://www.w3.org/2001/XMLSchema#double"
_RDFS = "http://www.w3.org/2000/01/rdf-schema#"

Triple = tuple[ox.NamedNode | ox.BlankNode, ox.NamedNode, ox.NamedNode | ox.BlankNode | ox.Literal]


def parse(paths: Iterable[object]) -> list[ox.Quad]:
    """Parse files; blank nodes of different files stay apart."""
    return [quad for path in paths for quad in ox.parse(path=str(path), rename_blank_nodes=True)]


@pytest.fixture(scope="session")
def schema() -> list[Triple]:
    return [(q.subject, q.predicate, q.object) for q in parse(ontology.modules())]


@pytest.fixture(scope="session")
def sample() -> list[ox.Quad]:
    return parse([ontology.path("examples/sample.trig")])


@dataclass(frozen=True)
class Closed:
    """The sample with its inferred graph; queries see the union of all graphs."""

    store: ox.Store

    def rows(self, text: str) -> list[tuple[str, ...]]:
        solutions = self.store.query(text, use_default_graph_as_union=True)
        assert isinstance(solutions, ox.QuerySolutions)
        return [tuple("-" if v is None else _local(v) for v in row) for row in solutions]

    def triples(self) -> set[Triple]:
        return {(q.subject, q.predicate, q.object) for q in self.store}


def _local(term: object) -> str:
    value = str(getattr(term, "value", term))
    if isinstance(term, ox.NamedNode):
        return value.rstrip("/#").replace("#", "/").rsplit("/", 1)[-1]
    return value if _number(term) is None else repr(_number(term))


def _number(term: object) -> float | None:
    """Return the value of an ``xsd:double``."""
    if isinstance(term, ox.Literal) and term.datatype.value == _XSD_DOUBLE:
        return float(term.value)
    return None


def _by_engine(schema: list[Triple], asserted: list[Triple]) -> list[Triple]:
    closure = reasoner.Closure.build(
        schema, asserted, rules=[path.read_text() for path in ontology.rules()]
    )
    return list(closure.match(None, None, None))


def _by_owlrl(schema: list[Triple], asserted: list[Triple]) -> list[Triple]:
    """Alternate owlrl and the rules until neither adds anything.

    Sound for these rules, although three of them negate: what they negate never depends on what
    a rule derives. owlrl's key rule merges everything that has a one-property key, hence no keys.
    """
    import owlrl

    leave_out = {_OWL + "hasKey", _OWL + "imports", _OWL + "versionIRI"}
    leave_out |= {_RDFS + name for name in ("label", "comment", "isDefinedBy")}
    store = ox.Store()
    store.extend(
        ox.Quad(*triple) for triple in [*schema, *asserted] if triple[1].value not in leave_out
    )
    rules = [path.read_text() for path in ontology.rules()]
    while True:
        graph = rdflib.Graph()
        graph.parse(data=store.dump(format=ox.RdfFormat.N_TRIPLES, from_graph=ox.DefaultGraph()))
        owlrl.DeductiveClosure(owlrl.OWLRL_Semantics).expand(graph)
        sound = rdflib.Graph()
        for s, p, o in graph:
            if isinstance(s, rdflib.Literal) or p.startswith("http://www.daml.org/"):
                continue  # literals as subjects, and its complaints about 0.0
            sound.add((s, p, o))
        store.load(sound.serialize(format="nt").encode(), format=ox.RdfFormat.N_TRIPLES)
        before = len(store)
        for rule in rules:
            derived = store.query(rule)
            assert isinstance(derived, ox.QueryTriples)
            store.extend(ox.Quad(t.subject, t.predicate, t.object) for t in derived)
        if len(store) == before:
            return [(q.subject, q.predicate, q.object) for q in store]


def _closed(triples: list[Triple], sample: list[ox.Quad]) -> Closed:
    asserted = {(q.subject, q.predicate, q.object) for q in sample}
    store = ox.Store()
    store.extend(sample)
    store.extend(ox.Quad(*triple, INFERRED) for triple in set(triples) - asserted)
    return Closed(store)


@pytest.fixture(scope="session")
def closed_by_engine(schema: list[Triple], sample: list[ox.Quad]) -> Closed:
    asserted = [(q.subject, q.predicate, q.object) for q in sample]
    return _closed(_by_engine(schema, asserted), sample)


@pytest.fixture(scope="session")
def closed_by_owlrl(schema: list[Triple], sample: list[ox.Quad]) -> Closed:
    asserted = [(q.subject, q.predicate, q.object) for q in sample]
    # rdflib and owlrl rewrite 0.49e0 as 0.49: give numbers back the form in which they came
    written = {_number(o): o for _, _, o in asserted if _number(o) is not None}
    derived = [(s, p, written.get(_number(o), o)) for s, p, o in _by_owlrl(schema, asserted)]
    # Labels take no part in reasoning, and are spared owlrl; questions read them.
    labels = [triple for triple in schema if triple[1].value == _RDFS + "label"]
    return _closed([*derived, *labels], sample)


@pytest.fixture(scope="session")
def closed(closed_by_engine: Closed) -> Closed:
    """Close by our engine; owlrl, which takes twenty seconds, is its oracle in one test file."""
    return closed_by_engine
