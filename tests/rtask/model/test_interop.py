"""The graph as rdflib and owlready2 see it, and their changes as commits."""

from __future__ import annotations

from typing import Any

import pytest
import rdflib
from rdflib.namespace import RDF

import ontology
from rtask.errors import ForbiddenError
from rtask.knowledge_base import KnowledgeBase

pytestmark = pytest.mark.slow

RT = rdflib.Namespace(ontology.NS)


def test_rdflib_reads_the_union_with_what_is_derived(still_lab: KnowledgeBase) -> None:
    data = still_lab.rdflib()
    mug = rdflib.URIRef(still_lab.base + "object/1")
    assert (mug, RDF.type, RT.Container) in data
    assert [str(v) for v in data.objects(mug, RT.mass)] == ["0.3"]
    own = data.graph(rdflib.URIRef(still_lab.graphs.agent("nao-1").value))
    assert (mug, RDF.type, RT.Mug) in own
    assert (mug, RDF.type, RT.Container) not in own
    assert own.identifier in {graph.identifier for graph in data.graphs((mug, None, None))}


def test_rdflib_asks_the_store(still_lab: KnowledgeBase) -> None:
    data = still_lab.rdflib()
    text = "SELECT ?o (COUNT(?g) AS ?n) { ?o rt:hasGrasp ?g } GROUP BY ?o ORDER BY ?n"
    rows = [(str(row.o)[-1], row.n.toPython()) for row in data.query(text, initNs={"rt": RT})]
    assert rows == [("2", 1), ("1", 2)]
    assert bool(data.query("ASK { ?s ?p ?o }"))
    bound = data.query("SELECT ?m { ?o rt:mass ?m }", initBindings={"m": rdflib.Literal(0.3)})
    assert len(list(bound)) <= 1
    made = data.query(f"CONSTRUCT {{ ?o a <{RT.X}> }} WHERE {{ ?o <{RT.hasGrasp}> ?g }}")
    assert made.graph is not None
    assert len(made.graph) == 2


def test_rdflib_writes_one_commit_in_the_agents_graph(lab: KnowledgeBase) -> None:
    before = lab.seq
    mug = rdflib.URIRef(lab.base + "object/1")
    with lab.rdflib("nao-1", writable=True) as data:
        data.add((mug, RT.name, rdflib.Literal("cup")))
        data.remove((mug, RT.mass, None))
        data.set((mug, RT.graspWidth, rdflib.Literal(0.06)))
        assert {str(v) for v in data.objects(mug, RT.name)} == {"mug", "cup"}
        assert list(data.objects(mug, RT.mass)) == []
        assert lab.seq == before
    assert lab.seq == before + 1
    names = lab.match(lab.base + "object/1", ontology.NS + "name")
    assert {q.graph_name for q in names} == {lab.graphs.agent("nao-1")}
    assert lab.match(lab.base + "object/1", ontology.NS + "mass") == []


def test_rdflib_respects_rights_and_failures(lab: KnowledgeBase) -> None:
    mug, before = rdflib.URIRef(lab.base + "object/1"), lab.seq
    with pytest.raises(ForbiddenError, match="read-only"):
        lab.rdflib().add((mug, RT.name, rdflib.Literal("cup")))
    with pytest.raises(ForbiddenError), lab.rdflib("pr2", writable=True) as data:
        data.remove((mug, RT.mass, None))
    with pytest.raises(RuntimeError), lab.rdflib(writable=True) as data:  # noqa: PT012
        data.add((mug, RT.name, rdflib.Literal("cup")))
        raise RuntimeError
    assert lab.seq == before


@pytest.fixture
def world(lab: KnowledgeBase) -> Any:
    pytest.importorskip("owlready2")
    return lab.owlready()


def test_owlready_sees_individuals_and_classes(lab: KnowledgeBase, world: Any) -> None:
    mug = world[lab.base + "object/1"]
    assert mug.mass == [0.3]
    assert world[ontology.NS + "Mug"] in mug.is_a
    assert world[ontology.NS + "Mug"] in world[ontology.NS + "Container"].subclasses()


def test_what_owlready_changed_is_one_commit(lab: KnowledgeBase, world: Any) -> None:
    graph = lab.graphs.agent("nao-1")
    assert lab.update_from(world, graph, "nao-1") is None
    world[lab.base + "object/1"].mass = [0.35]
    commit = lab.update_from(world, graph, "nao-1")
    assert commit is not None
    assert (commit.added, commit.removed) == (1, 1)
    (quad,) = lab.match(lab.base + "object/1", ontology.NS + "mass")
    assert (str(getattr(quad.object, "value", "")), quad.graph_name) == ("0.35", graph)
    assert lab.update_from(world, graph, "nao-1") is None


def test_two_worlds_are_apart(lab: KnowledgeBase, world: Any) -> None:
    other = lab.owlready()
    other[lab.base + "object/1"].mass = [9.0]
    assert world[lab.base + "object/1"].mass == [0.3]


def test_using_the_graph_imports_neither() -> None:
    import subprocess
    import sys

    code = (
        "import rtask, rtask.knowledge_base, sys;"
        "print([m for m in ('rdflib', 'owlready2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
