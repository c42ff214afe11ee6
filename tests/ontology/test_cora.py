"""Our rendering of CORA says what the published files say (IEEE 1872-2015)."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
import rdflib
from rdflib.collection import Collection
from rdflib.namespace import OWL, RDF, RDFS

import ontology

FILES = ("cora-bare", "sumo-cora", "corax", "rparts", "pos", "cora")
SPACES = tuple(ontology.PREFIXES[p] for p in ("cora", "sumo", "corax", "rparts", "pos"))
AXIOMS = (
    RDFS.subClassOf,
    RDFS.subPropertyOf,
    RDFS.domain,
    RDFS.range,
    RDF.type,
    OWL.disjointWith,
    OWL.disjointUnionOf,
    OWL.equivalentClass,
    OWL.equivalentProperty,
)
Fact = tuple[str, str, str]


def _text(graph: rdflib.Graph, node: rdflib.term.Node) -> str:
    """Write a class expression so that equal ones have equal text."""
    if not isinstance(node, rdflib.BNode):
        return str(node)
    if (node, RDF.first, None) in graph:
        return "(" + " ".join(sorted(_text(graph, n) for n in Collection(graph, node))) + ")"
    parts = [f"{p}={_text(graph, o)}" for p, o in graph.predicate_objects(node)]
    return "[" + " ".join(sorted(parts)) + "]"


def _facts(graph: rdflib.Graph) -> set[Fact]:
    return {
        (str(s), str(p), _text(graph, o))
        for p in AXIOMS
        for s, o in graph.subject_objects(p)
        if isinstance(s, rdflib.URIRef) and str(s).startswith(SPACES) and o != OWL.topObjectProperty
    }


def _removed() -> list[Fact]:
    facts = []
    for patch in tomllib.loads(ontology.patches().read_text())["patch"]:
        for fault in patch["remove"] if "ieee1872-owl" in patch["ontology"] else ():
            value = fault.get("object") or "(" + " ".join(sorted(fault["members"])) + ")"
            facts.append((fault["subject"], fault["predicate"], value))
    return facts


@pytest.fixture(scope="module")
def ours() -> set[Fact]:
    graph = rdflib.Graph()
    for path in sorted(ontology.path("cora/pos.ttl").parent.glob("*.ttl")):
        graph.parse(path)
    return _facts(graph)


@pytest.fixture(scope="module")
def published(ontologies_dir: Path) -> set[Fact]:
    graph = rdflib.Graph()
    for name in FILES:
        graph.parse(ontologies_dir / "cora" / f"{name}.owl")
    return _facts(graph)


def test_patches_are_not_in_our_rendering(ours: set[Fact]) -> None:
    assert len(_removed()) == 2
    assert ours.isdisjoint(_removed())


def test_patches_are_in_the_published_files(published: set[Fact]) -> None:
    assert published.issuperset(_removed())


def test_nothing_published_is_missing(ours: set[Fact], published: set[Fact]) -> None:
    assert len(published) > 300
    assert published - set(_removed()) - ours == set()


def test_nothing_is_added(ours: set[Fact], published: set[Fact]) -> None:
    assert ours - published == set()


def test_no_published_wording_is_taken_over(ontologies_dir: Path) -> None:
    theirs, mine = rdflib.Graph(), rdflib.Graph()
    for name in FILES:
        theirs.parse(ontologies_dir / "cora" / f"{name}.owl")
    for path in sorted(ontology.path("cora/pos.ttl").parent.glob("*.ttl")):
        mine.parse(path)
    words = {str(o) for o in mine.objects(None, RDFS.comment)}
    assert words.isdisjoint({str(o) for o in theirs.objects(None, RDFS.comment)})
