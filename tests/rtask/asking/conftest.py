"""A graph with the ontology, its sample, and things whose names are hard to read back."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase

_MORE = """
PREFIX rt: <https://w3id.org/rtask-kg/ns#>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
INSERT DATA {
  <urn:lab/robot/panda-1> a rt:Robot ; rt:name "panda-1" .
  <urn:lab/object/7> a rt:Mug ; rt:name "the 5\\" mug, blue" .
  <urn:lab/object/8> a rt:Mug ; rt:name "twin" .
  <urn:lab/object/9> a rt:Mug ; rt:name "twin" .
  <urn:lab/object/10> a rt:Mug ; rt:name "kettle-4" .
  <urn:lab/odd/a(b),c;d=e%20f~g@h> a rt:Mug ; rdfs:label "odd"@en .
  <urn:lab/graph/x#frag?> a rt:Mug .
  <urn:lab/> rdfs:label "a name that goes on and on, far beyond what a line can show of it" .
  <mailto:ann@example.org> a rt:Robot .
  <x-own:thing> a rt:Mug .
}"""


@pytest.fixture(scope="session")
def kb() -> Iterator[KnowledgeBase]:
    graph = rtask.open(":memory:", base="urn:lab/")
    assert isinstance(graph, KnowledgeBase)
    with graph:
        graph.load(ontology.path("examples/sample.trig"))
        graph.update(_MORE)
        yield graph
