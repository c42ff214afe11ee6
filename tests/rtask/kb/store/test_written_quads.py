"""Quads that are stored and journalled as text arrive as the same quads made one by one."""

from __future__ import annotations

import pyoxigraph as ox
import pytest

from reasoner import Closure
from rtask.kb.durability.journal import body_of
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.quads import InGraph, QuadChain, WrittenTriples, quads_written
from rtask.rdf.terms import DEFAULT, BlankNode, Literal, NamedNode, Quad, Triple

_A, _P = NamedNode("urn:a"), NamedNode("urn:p")
_HARD = [
    Literal(" .\n <urn:g> .\n"),
    Literal('"quoted" \\ \t and _:b'),
    Literal("für", language="de"),
    Literal("0.5", datatype=NamedNode("http://www.w3.org/2001/XMLSchema#decimal")),
    Triple(_A, _P, Literal("in a triple term")),
    NamedNode("urn:ünicode"),
]
_GRAPHS = [NamedNode("urn:g"), NamedNode("urn:other"), BlankNode("graph"), DEFAULT]
_QUADS = dict.fromkeys(Quad(_A, _P, value, graph) for graph in _GRAPHS for value in _HARD)
_BLANK = dict.fromkeys(Quad(BlankNode("own"), _P, BlankNode("label"), g) for g in _GRAPHS)


def test_quads_are_grouped_by_graph_and_keep_their_terms() -> None:
    written = quads_written({**_QUADS, **_BLANK})
    assert [part.graph for part in written] == _GRAPHS
    assert dict.fromkeys(QuadChain(*written)) == {**_QUADS, **_BLANK}
    for part in written:
        assert part.written is not None
        lines = part.written.text.splitlines()
        assert len(lines) == len(part) == len(_HARD) + 1
        text = ox.parse(part.written.text, format=ox.RdfFormat.N_TRIPLES)
        assert {quad.triple for quad in text} == {Triple(*key) for key in part.triples}


@pytest.mark.parametrize("quads", [_QUADS, _BLANK], ids=["without blank nodes", "blank nodes"])
def test_the_store_takes_text_as_it_takes_quads(quads: dict[Quad, None]) -> None:
    store = EmbeddedStore(ox.Store())
    for part in quads_written(quads):
        store.bulk_extend(part)
    assert set(store.quads_for_pattern(None, None, None)) == set(quads)


def test_the_journal_holds_the_same_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtask.kb.durability.journal._BLOCK", 3)
    quads = {**_QUADS, **_BLANK}
    as_text = body_of(QuadChain(*quads_written(quads)), quads)
    as_quads = body_of(quads, QuadChain(*quads_written(quads)))
    assert as_text.count(b"D ") == as_text.count(b"A ")
    assert sorted(as_text.splitlines()) == sorted(as_quads.splitlines())


def test_text_is_made_once_and_only_if_somebody_asks() -> None:
    asked = []
    triples = WrittenTriples([(_A, _P, _A)], lambda: asked.append(1) or b"<a> <b> <c> .\n")
    part = InGraph(triples, _GRAPHS[0])
    assert (len(part), list(part)) == (1, [Quad(_A, _P, _A, _GRAPHS[0])])
    assert not asked
    assert (triples.text, triples.is_ground, triples.text) == (triples.text, True, triples.text)
    assert len(asked) == 1


def test_what_is_derived_writes_itself_and_comes_in_parts() -> None:
    rdf, rdfs = (
        "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
        "http://www.w3.org/2000/01/rdf-schema#",
    )
    below, kind = NamedNode(rdfs + "subClassOf"), NamedNode(rdf + "type")
    schema = [(NamedNode("urn:Mug"), below, NamedNode("urn:Vessel"))]
    schema += [(_P, NamedNode(rdfs + "subPropertyOf"), NamedNode("urn:q"))]
    data = [(NamedNode(f"urn:m{n}"), kind, NamedNode("urn:Mug")) for n in range(25)]
    data += [(NamedNode(f"urn:m{n}"), _P, Literal(f"line\n{n}")) for n in range(7)]
    missing, surplus = Closure.build(schema, data).compare([])
    assert (len(missing), surplus) == (32, [])
    text = ox.parse(missing.ntriples(), format=ox.RdfFormat.N_TRIPLES)
    assert {quad.triple for quad in text} == {Triple(*triple) for triple in missing}
    parts = list(InGraph(missing, _GRAPHS[0]).parts(10))
    assert [len(part) for part in parts] == [10, 10, 5, 7]
    assert dict.fromkeys(QuadChain(*parts)) == dict.fromkeys(InGraph(missing, _GRAPHS[0]))
    assert all(part.written is not None for part in parts)
