"""A small knowledge base to branch off, and how its tests write and ask."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase

_RT = ontology.NS
_PREFIXES = f"PREFIX rt: <{_RT}> " + " ".join(
    f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("owl", "rdfs", "rdf", "time", "xsd")
)
_SCHEMA = """INSERT DATA { GRAPH <urn:lab/onto> {
    <urn:lab/onto> a owl:Ontology .
    <urn:Cup> rdfs:subClassOf <urn:Vessel> . <urn:Vessel> rdfs:subClassOf <urn:Thing> .
    <urn:Cup> owl:disjointWith <urn:Box> .
    <urn:on> a owl:ObjectProperty ; rdfs:domain <urn:Thing> ; rdfs:range <urn:Place> .
    <urn:in> a owl:TransitiveProperty .
    <urn:mass> a owl:DatatypeProperty, owl:FunctionalProperty . } }"""


@pytest.fixture
def kb(tmp_path: Path) -> Iterator[KnowledgeBase]:
    with rtask.open(tmp_path / "kb", base="urn:lab/", ontologies=False, flush="os") as opened:
        write(opened, _SCHEMA)
        write(opened, "INSERT DATA { <urn:c0> a <urn:Cup> ; <urn:mass> 0.3e0 }")
        yield opened


def write(kb: KnowledgeBase, text: str, **options: object) -> int:
    return kb.update(f"{_PREFIXES} {text}", **options).seq  # type: ignore[arg-type]


def holds(kb: KnowledgeBase, pattern: str) -> bool:
    return bool(kb.query(f"{_PREFIXES} ASK {{ {pattern} }}"))


def inferred(kb: KnowledgeBase) -> set[str]:
    return {str(quad) for quad in kb.match(graph=kb.graphs.inferred)}
