"""Words and places: found right after the commit, and again after the index was lost."""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import ForbiddenError, QuerySyntaxError, TooLargeError, UsageError
from rtask.kb.commit.commit import Request
from rtask.kb.search.text import words_of
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Literal, NamedNode, Quad

_LABEL = "http://www.w3.org/2000/01/rdf-schema#label"
_RT = "https://w3id.org/rtask-kg/ns#"
_P = f"PREFIX rt: <{_RT}> PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "


@pytest.fixture(params=["memory", "folder"])
def kb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KnowledgeBase]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with rtask.open(target, reason=False, ontologies=False, flush="os") as opened:
        opened.update(
            _P
            + """INSERT DATA {
            <urn:cup> rdfs:label "Red cup"@en, "Rote Tasse"@de ; rdfs:comment "holds coffee" .
            <urn:mug> rdfs:label "Red mug"@en-GB .
            <urn:cafe> rdfs:label "Café crème" .
            <urn:none> <urn:other> "red cup" . _:b rdfs:label "red cup" . }"""
        )
        yield opened


def _found(kb: KnowledgeBase, text: str, **options: object) -> set[str]:
    return {hit.subject.value for hit in kb.search(text, **options)}  # type: ignore[arg-type]


def test_words_are_found_whatever_their_case_and_accents(kb: KnowledgeBase) -> None:
    assert _found(kb, "red") == {"urn:cup", "urn:mug"}
    assert _found(kb, "cup RED") == {"urn:cup"}
    assert _found(kb, "cafe creme") == {"urn:cafe"}
    assert _found(kb, "cof*") == {"urn:cup"}
    assert _found(kb, "cof") == set()
    assert _found(kb, "red", lang="en") == {"urn:cup", "urn:mug"}
    assert _found(kb, "rote", lang="en") == set()
    [hit] = kb.search("rote tasse")
    assert (hit.text, hit.language) == ("Rote Tasse", "de")
    assert len(kb.search("red", limit=1)) == 1


def test_objects_and_robots_are_found_by_their_names(kb: KnowledgeBase) -> None:
    kb.update(_P + 'INSERT DATA { <urn:1> rt:name "tea box" . <urn:nao> rt:name "nao-1" }')
    assert _found(kb, "tea") == {"urn:1"}
    assert _found(kb, "nao-1") == {"urn:nao"}
    assert _found(kb, "red", among={"urn:mug", "urn:1"}) == {"urn:mug"}


@pytest.mark.parametrize("text", ["red OR", "NEAR(red cup)", "a-b", "red:cup", "^red", '"red'])
def test_operators_in_words_do_nothing(kb: KnowledgeBase, text: str) -> None:
    assert _found(kb, text) <= {"urn:mug", "urn:cup"}


@pytest.mark.parametrize("text", ["", '"', "(", "'*", " * "])
def test_a_search_needs_a_word(kb: KnowledgeBase, text: str) -> None:
    with pytest.raises(UsageError, match="no word"):
        kb.search(text)
    assert words_of("x " + text) == '"x"'


def test_commits_are_found_and_what_they_withdraw_is_not(kb: KnowledgeBase) -> None:
    assert _found(kb, "spoon") == set()
    kb.update(_P + 'INSERT DATA { <urn:spoon> rdfs:label "spoon" }')
    assert _found(kb, "spoon") == {"urn:spoon"}
    kb.update(_P + "DELETE WHERE { <urn:spoon> rdfs:label ?l }")
    assert _found(kb, "spoon") == set()
    with kb.transaction() as tx:
        tx.add("urn:fork", _LABEL, "fork", graph=kb.graphs.imported("a"))
        tx.add("urn:fork", _LABEL, "fork", graph=kb.graphs.imported("b"))
    kb.update(f"DROP GRAPH <{kb.graphs.imported('a').value}>")
    assert _found(kb, "fork") == {"urn:fork"}
    kb.update(f"CLEAR GRAPH <{kb.graphs.imported('b').value}>")
    assert _found(kb, "fork") == set()


def test_what_was_loaded_in_bulk_is_found(kb: KnowledgeBase) -> None:
    assert _found(kb, "red") == {"urn:cup", "urn:mug"}
    graph = kb.graphs.imported("bulk")
    quad = Quad(NamedNode("urn:bulk"), NamedNode(_LABEL), Literal("red herring"), graph)
    kb.bulk_add([quad], graph, Request(kb.access()))
    assert _found(kb, "red") == {"urn:cup", "urn:mug", "urn:bulk"}


def test_instances_of_a_class_derived_ones_too() -> None:
    with rtask.open(":memory:") as kb:
        kb.update(_P + 'INSERT DATA { <urn:m> a rt:Mug ; rdfs:label "zebra mug" }')
        kb.update(_P + 'INSERT DATA { <urn:t> a rt:Table ; rdfs:label "zebra table" }')
        assert _found(kb, "zebra", cls=_RT + "Container") == {"urn:m"}
        assert _RT + "Mug" in _found(kb, "mug")  # terms of the ontology


def _reopened(folder: Path) -> set[str]:
    with rtask.open(folder, reason=False, ontologies=False) as kb:
        return _found(kb, "word")


def test_the_index_catches_up_and_is_made_anew_when_it_is_lost(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with rtask.open(folder, reason=False, ontologies=False) as kb:
        kb.update(_P + 'INSERT DATA { <urn:1> rdfs:label "word" }')
        assert _found(kb, "word") == {"urn:1"}
    with rtask.open(folder, reason=False, ontologies=False) as kb:  # nobody searches
        kb.update(_P + 'INSERT DATA { <urn:2> rdfs:label "word" }')
        kb.update(_P + "DELETE WHERE { <urn:1> ?p ?o }")
    assert _reopened(folder) == {"urn:2"}
    index = folder / "index.sqlite"
    index.unlink()
    assert _reopened(folder) == {"urn:2"}
    index.write_bytes(b"this is no database" * 1_000)
    assert _reopened(folder) == {"urn:2"}
    with sqlite3.connect(index) as db:
        db.execute("UPDATE facts SET value = 'other' WHERE name = 'epoch'")
        db.execute("DELETE FROM texts")
    db.close()
    assert _reopened(folder) == {"urn:2"}
    with sqlite3.connect(index) as db:  # as an earlier version of RTASK left it
        db.execute("UPDATE facts SET value = '1' WHERE name = 'format'")
        db.execute("DELETE FROM texts")
    db.close()
    assert _reopened(folder) == {"urn:2"}
    with rtask.open(folder, mode="r") as kb:
        assert _found(kb, "word") == {"urn:2"}


def test_the_index_equals_a_new_one_after_random_commits(tmp_path: Path) -> None:
    chance = random.Random(3)
    words = ["red", "green", "cup", "mug"]
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False, flush="os") as kb:
        for step in range(60):
            subject, word = chance.randrange(5), chance.choice(words)
            if chance.random() < 0.6:
                kb.update(_P + f'INSERT DATA {{ <urn:{subject}> rdfs:label "{word} {step}" }}')
            else:
                kb.update(_P + f"DELETE WHERE {{ <urn:{subject}> rdfs:label ?l }}")
            if step % 7 == 0:
                followed = [_found(kb, w) for w in words]
                kb.index.rebuild()
                assert followed == [_found(kb, w) for w in words]


def test_sparql_looks_words_up(kb: KnowledgeBase) -> None:
    rows = kb.select(
        _P
        + """SELECT ?s ?l ?sc ?t { SERVICE <urn:rtask:text> {
              ?s rt:matches "red c*" ; rt:score ?sc ; rt:text ?t . } ?s rdfs:label ?l }"""
    )
    assert {row.value("s") for row in rows} == {"urn:cup"}
    assert {row.value("l") for row in rows} == {"Red cup", "Rote Tasse"}
    assert rows[0].value("t") == "Red cup"
    text = _P + 'SELECT ?s { SERVICE SILENT <urn:rtask:text> { ?s rt:matches "red" ; rt:limit 1 } }'
    assert len(kb.select(text)) == 1
    assert len(kb.select(text, timeout_s=30.0)) == 1
    with kb.stream(text.replace("SELECT ?s", "ASK")) as stream:
        assert b"true" in stream.read()
    assert kb.query(_P + 'ASK { SERVICE <urn:rtask:text> { <urn:mug> rt:matches "red" } }') is True
    assert kb.query(_P + 'ASK { SERVICE <urn:rtask:text> { <urn:mug> rt:matches "cup" } }') is False
    kb.update(
        _P
        + 'INSERT { ?s <urn:is> "red" } WHERE { SERVICE <urn:rtask:text> { ?s rt:matches "red" } }'
    )
    assert len(kb.match(predicate="urn:is")) == 2


@pytest.mark.parametrize(
    "block",
    [
        "?s rt:score ?x",
        '?s rt:matches "a" ; rt:nothing ?x',
        "?s rt:matches ?x",
        '?s rt:matches "a" . ?s ?p ?o',
        '?s rt:matches "a" OPTIONAL { ?s ?p ?o }',
        '[] rt:matches "a"',
        "",
    ],
)
def test_other_questions_to_the_text_service_are_refused(kb: KnowledgeBase, block: str) -> None:
    with pytest.raises(QuerySyntaxError, match="urn:rtask:text"):
        kb.query(_P + f"ASK {{ SERVICE <urn:rtask:text> {{ {block} }} }}")
    with pytest.raises(ForbiddenError):
        kb.query(_P + "ASK { SERVICE <urn:rtask:texts> { ?s ?p ?o } }")


def _pose(name: str, x: float, y: float, z: float | None, frame: str = "urn:table") -> str:
    last = "" if z is None else f"; rt:z {z:e}"
    return f"<{name}> rt:inFrame <{frame}> ; rt:x {x:e} ; rt:y {y:e} {last} . "


def test_poses_near_a_point_are_found_nearest_first(kb: KnowledgeBase) -> None:
    kb.update(
        _P + "INSERT DATA { " + _pose("urn:p1", 0.1, 0, 0) + _pose("urn:p2", 0.3, 0.4, None)
        + _pose("urn:p3", 0, 0, 2.0) + _pose("urn:p4", 0, 0, 0, "urn:floor") + "}"
    )  # fmt: skip
    found = kb.near("urn:table", (0.0, 0.0, 0.0), 0.5)
    assert [place.pose.value for place in found] == ["urn:p1", "urn:p2"]
    assert found[1].distance == pytest.approx(0.5)  # exactly on it
    assert found[0].point == (0.1, 0.0, 0.0)
    kb.update(_P + "DELETE { ?p rt:x ?x } INSERT { ?p rt:x 9e0 } WHERE { ?p rt:x ?x ; rt:x 0.1e0 }")
    kb.update(_P + "DELETE WHERE { <urn:p2> rt:inFrame ?f }")
    assert kb.near("urn:table", (0.0, 0.0, 0.0), 0.5) == []
    assert [p.pose.value for p in kb.near("urn:table", (9.0, 0.0, 0.0), 0.01)] == ["urn:p1"]
    assert kb.near("urn:nowhere", (0.0, 0.0, 0.0), 1.0) == []
    with pytest.raises(UsageError, match="three finite numbers"):
        kb.near("urn:table", (0.0, 0.0), 1.0)


def test_near_agrees_with_a_comparison_of_all_distances(kb: KnowledgeBase) -> None:
    chance = random.Random(1)
    points = [[chance.uniform(-1, 1) for _ in range(3)] for _ in range(300)]
    with kb.transaction() as tx:
        for number, (x, y, z) in enumerate(points):
            name = f"urn:pose:{number}"
            tx.add(name, _RT + "inFrame", NamedNode("urn:f"))
            for axis, value in zip("xyz", (x, y, z), strict=True):
                tx.add(name, _RT + axis, value)
    for _ in range(20):
        centre, radius = [chance.uniform(-1, 1) for _ in range(3)], chance.uniform(0, 0.8)
        wanted = {
            f"urn:pose:{number}"
            for number, point in enumerate(points)
            if sum((a - b) ** 2 for a, b in zip(point, centre, strict=True)) ** 0.5 <= radius
        }
        assert {place.pose.value for place in kb.near("urn:f", centre, radius)} == wanted


def test_no_hit_of_the_text_service_is_left_out_in_silence(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cut list would make counts too small, and things that match would be said not to."""
    asked = _P + "ASK {{ SERVICE <urn:rtask:text> {{ {} rt:matches 'red' {} }} }}"
    for name in ("<urn:cup>", "<urn:mug>"):  # one of them is the second best
        assert kb.query(asked.format(name, "; rt:limit 1")) is True
    monkeypatch.setattr("rtask.sparql.service.MAX_HITS", 1)
    assert kb.query(asked.format("<urn:mug>", "")) is True
    count = "SELECT (COUNT(*) AS ?n) { SERVICE <urn:rtask:text> { ?s rt:matches 'red' %s } }"
    with pytest.raises(TooLargeError, match="more than 1 hits"):
        kb.query(_P + count % "")
    with pytest.raises(QuerySyntaxError, match="at most 1"):
        kb.query(_P + count % "; rt:limit 2")
    assert kb.select(_P + count % "; rt:limit 1")[0].value("n") == 1
