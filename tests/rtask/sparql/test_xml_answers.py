"""Answers in XML: every parser reads them, and reads what is stored."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import pytest
import rdflib
from pyoxigraph import Literal, NamedNode, RdfFormat, Triple

import rtask
from rtask.errors import DataError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.xml_text import XmlWriter
from rtask.sparql.results import Triples

ROWS, GRAPH = "application/sparql-results+xml", "application/rdf+xml"
SELECT = "SELECT ?o { <urn:s> <urn:x#p> ?o }"
CONSTRUCT = "CONSTRUCT WHERE { <urn:s> <urn:x#p> ?o }"
LINES = "a\r\nb\rc\td <&> ]]> 'é \U0001f916"
UNWRITABLE = "a\x07b\x00c\ufffed\uffffe"


@pytest.fixture(scope="module")
def graph() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", reason=False, ontologies=False) as kb:
        yield kb


def store(kb: KnowledgeBase, text: str) -> None:
    kb.update("DELETE WHERE { ?s ?p ?o }")
    with kb.transaction() as tx:
        tx.add("urn:s", "urn:x#p", text)


def answers(kb: KnowledgeBase, query: str, form: str) -> list[bytes]:
    """Return the answer as this process and as a reader write it."""
    return [kb.serialize(query, form), kb.stream(query, form, timeout_s=60.0).read()]


@pytest.mark.parametrize(("query", "form"), [(SELECT, ROWS), (CONSTRUCT, GRAPH)])
def test_line_ends_come_back_as_they_were(graph: KnowledgeBase, query: str, form: str) -> None:
    store(graph, LINES)
    for answer in answers(graph, query, form):
        texts = [node.text for node in ET.fromstring(answer).iter() if node.text]
        assert LINES in texts


def test_rdflib_reads_the_graph_that_is_stored(graph: KnowledgeBase) -> None:
    store(graph, LINES)
    out = io.BytesIO()
    graph.dump(out, "rdfxml", graphs=[graph.graphs.shared])
    for data in (*answers(graph, CONSTRUCT, GRAPH), out.getvalue()):
        found = rdflib.Graph().parse(data=data, format="xml")
        assert [str(o) for o in found.objects()] == [LINES]


@pytest.mark.parametrize(("query", "form"), [(SELECT, ROWS), (CONSTRUCT, GRAPH)])
def test_characters_that_xml_cannot_hold_are_replaced_and_counted(
    graph: KnowledgeBase, query: str, form: str
) -> None:
    store(graph, UNWRITABLE)
    for answer in answers(graph, query, form):
        texts = [node.text for node in ET.fromstring(answer).iter() if node.text]
        assert "a\ufffdb\ufffdc\ufffdd\ufffde" in texts
        assert b"<!-- 4 characters were replaced by U+FFFD" in answer


def test_other_formats_keep_every_character(graph: KnowledgeBase) -> None:
    store(graph, UNWRITABLE)
    assert graph.select(SELECT)[0].value("o") == UNWRITABLE


def test_a_character_that_is_cut_by_a_piece_is_still_seen() -> None:
    out = io.BytesIO()
    xml = XmlWriter(out)
    for byte in "<p>\uffffï\r\ufffd</p>".encode():
        xml.write(bytes([byte]))
    xml.finish()
    assert ET.fromstring(out.getvalue()).text == "\ufffdï\r\ufffd"
    assert xml.replaced == 1


def test_a_property_that_is_no_name_in_xml_is_refused_by_name(graph: KnowledgeBase) -> None:
    with graph.transaction() as tx:
        tx.add("urn:other", "urn:x#12", 1)
    query = "CONSTRUCT WHERE { <urn:other> ?p ?o }"
    with pytest.raises(DataError, match=r"property <urn:x#12>.*Turtle"):
        graph.serialize(query, GRAPH)
    with pytest.raises(DataError, match=r"property <urn:x#12>.*Turtle"):
        graph.stream(query, GRAPH, timeout_s=60.0).read()
    with pytest.raises(UsageError, match="urn:x#12"):
        graph.dump(io.BytesIO(), "rdfxml")
    triples = Triples((Triple(NamedNode("urn:s"), NamedNode("urn:x#12"), Literal("")),))
    with pytest.raises(UsageError, match="urn:x#12"):
        triples.serialize(RdfFormat.RDF_XML)
