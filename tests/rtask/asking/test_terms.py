"""Terms go in as they come out: every printed form of every term is read as that term."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import ontology
import rtask
from rtask.asking.terms import Reader, reader_of
from rtask.cli.options import prefixes
from rtask.cli.query import _short
from rtask.errors import UnknownTermError, UsageError
from rtask.kb.store.naming import Names, prefixed
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, Literal, NamedNode, iri, stored, written
from simulate.demo.recorded import unpack

RT = ontology.NS


@pytest.fixture(scope="module", params=["sample", "demo"])
def store(
    request: pytest.FixtureRequest, kb: KnowledgeBase, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[KnowledgeBase]:
    """Return the ontology's sample with hard names, and the store that a demo left."""
    if request.param == "sample":
        yield kb
        return
    folder = unpack(tmp_path_factory.mktemp("recorded") / "demo")["store"]
    with rtask.open(folder, mode="r") as opened:
        assert isinstance(opened, KnowledgeBase)
        yield opened


def _terms(kb: KnowledgeBase, kind: type) -> list[NamedNode | Literal]:
    found = {term for quad in kb.match() for term in quad if isinstance(term, kind)}
    assert len(found) > 100
    return sorted(found, key=str)


def test_every_printed_form_of_every_iri_of_a_store_is_read_back(store: KnowledgeBase) -> None:
    reader, names = reader_of(store), Names(store.store, store.graphs)
    known = prefixes(store.base)
    for term in _terms(store, NamedNode):
        forms = {written(term), term.value, prefixed(term, store.base), names(term)}
        for form in {*forms, _short(term, known)}:
            assert reader.term(form, "subject") == term, form


def test_every_printed_form_of_every_literal_of_a_store_is_read_back(store: KnowledgeBase) -> None:
    reader = reader_of(store)
    for term in _terms(store, Literal):
        for form in (written(term), prefixed(term, store.base)):
            assert stored(reader.term(form)) == term, form


def test_a_name_is_read_with_the_quotes_and_backslashes_that_are_in_it() -> None:
    name = 'o\'neil "big" \\ mug'
    with rtask.open(":memory:", base="urn:lab/") as graph:
        assert isinstance(graph, KnowledgeBase)
        with graph.transaction() as tx:
            tx.add("urn:lab/object/1", RT + "name", Literal(name))
        reader = reader_of(graph)
        for form in (name, f'"{name}"', str(Literal(name))):
            assert reader.term(form, "subject") == iri("urn:lab/object/1"), form
        with pytest.raises(UsageError, match="not an RDF term"):
            reader.term("o'neil", "subject")
        assert isinstance(reader.term(str(Literal(name))), Literal)


def test_a_name_in_quotes_is_a_thing_where_only_a_thing_can_stand(kb: KnowledgeBase) -> None:
    reader = reader_of(kb)
    asked = reader.statement('"panda-1"', "rt:canGrasp", '"the 5\\" mug, blue"')
    assert asked == (iri("urn:lab/robot/panda-1"), iri(RT + "canGrasp"), iri("urn:lab/object/7"))
    assert reader.statement("panda-1", "rt:canGrasp", '"the 5\\" mug, blue"') == asked  # as shells
    assert reader.statement("kb:object/8", "a", "rt:Mug")[1] == RDF_TYPE
    assert reader.statement("kb:object/8", "rt:name", '"twin"')[2] == Literal("twin")
    with pytest.raises(UsageError, match='2 things are called "twin": <urn:lab/object/8>'):
        reader.term('"twin"', "subject")
    with pytest.raises(UsageError, match='2 things are called "twin"'):
        reader.resource("twin")
    with pytest.raises(UsageError, match="'nobody' is not an RDF term"):
        reader.resource("nobody")
    with pytest.raises(UnknownTermError, match='nothing is called "nobody"'):
        reader.statement("kb:object/8", "rt:canGrasp", '"nobody"')


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("rt:Mug extra", "extra"),
        ("<urn:a> . <urn:b> <urn:c> <urn:d>", ". <urn:b> <urn:c> <urn:d>"),
        ('"red"@en ; rt:p 1', "; rt:p 1"),
        ("3 4", "4"),
        ('kb:object/7 "another name"', '"another name"'),
        ("<urn:a>, <urn:b>", ", <urn:b>"),
    ],
)
def test_what_is_left_over_after_a_term_is_shown(kb: KnowledgeBase, text: str, left: str) -> None:
    with pytest.raises(UsageError) as raised:
        reader_of(kb).term(text)
    assert repr(left) in str(raised.value)
    assert "left over" in str(raised.value)


@pytest.mark.parametrize("text", ["", "mug", "foo:bar", "_:b0", "<urn:a", '"open', "<a b>", "[]"])
def test_what_is_no_term_is_an_error_that_says_what_is(text: str) -> None:
    with pytest.raises(UsageError):
        Reader("urn:lab/").term(text)


def test_a_prefix_that_is_nearly_right_is_suggested() -> None:
    with pytest.raises(UsageError, match="did you mean 'prov'"):
        Reader().term("porv:Agent")
