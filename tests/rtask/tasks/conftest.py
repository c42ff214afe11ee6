"""A lab in a graph: a Nao and a Panda at a shared table, each with a box of its own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES

BASE = "https://example.org/kb/"
NAO, PANDA, TABLE = f"{BASE}robot/nao-1", f"{BASE}robot/panda-1", f"{BASE}place/table"
CUP, JUG, PEN = f"{BASE}thing/1", f"{BASE}thing/2", f"{BASE}thing/3"
LEFT, RIGHT = f"{BASE}place/left", f"{BASE}place/right"


def placed(number: int, place: str) -> str:
    """Return the statements that a thing of product *number* is on a place."""
    thing, at = f"<{BASE}thing/{number}>", f"{BASE}placement/{number}"
    return f"""
  {thing} a rt:Exemplar ; rt:exemplarOf <{BASE}object/{number}> .
  <{at}> a rt:Placement ; rt:placementOf {thing} ; rt:placedOn <{place}> ;
    time:hasBeginning <{at}/begin> .
  <{at}/begin> time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp ."""


def robot(iri: str, name: str, hand: str, opening: float, payload: float) -> str:
    """Return the statements about a robot with one hand."""
    return f"""
  <{iri}> a cora:Robot ; rt:name "{name}" ; rt:hasEndEffector <{iri}/hand> .
  <{iri}/hand> a rt:{hand} ; rt:name "{name} hand" ; rt:gripperType "{name}_hand" ;
    rt:minOpening 0.0e0 ; rt:maxOpening {opening}e0 ; rt:maxPayload {payload}e0 ."""


LAB = f"""{PREFIXES}
INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  {robot(NAO, "nao-1", "Hand", 0.05, 0.2)}
  {robot(PANDA, "panda-1", "ParallelJawGripper", 0.08, 3.0)}
  <{TABLE}> a rt:SupportSurface ; rt:name "table" .
  <{LEFT}> a rt:SupportSurface ; rt:name "left box" .
  <{RIGHT}> a rt:SupportSurface ; rt:name "right box" .
  <{NAO}> rt:reaches <{TABLE}>, <{LEFT}> . <{PANDA}> rt:reaches <{TABLE}>, <{RIGHT}> .
  <{BASE}object/1> a rt:Cup ; rt:objectId "lab/1" ; rt:name "red cup" ;
    rt:graspWidth 0.04e0 ; rt:mass 0.1e0 .
  <{BASE}object/2> a rt:Bottle ; rt:objectId "lab/2" ; rt:name "jug" ;
    rt:graspWidth 0.07e0 ; rt:mass 1.0e0 .
  <{BASE}object/3> a rt:Pen ; rt:objectId "lab/3" ; rt:name "pen" ;
    rt:graspWidth 0.01e0 ; rt:mass 0.02e0 .
  {placed(1, RIGHT)} {placed(2, TABLE)} {placed(3, TABLE)}
}} }}"""


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    """The lab; tests only read it."""
    with rtask.open(":memory:", base=BASE) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(LAB)
        yield graph
