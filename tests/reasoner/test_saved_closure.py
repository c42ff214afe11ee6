"""A closure that is written to a folder and read again goes on as if nothing had happened."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner import Closure, Config
from reasoner.saved.container import DamagedFolderError, read_folder, read_head, write_folder
from reasoner.saved.image import Image, fingerprint
from reasoner.terms.table import TermTable
from reasoner.terms.vocabulary import XSD
from tests.reasoner.test_closure_properties import IN_BULK, RULES, clashes
from tests.reasoner.ttl import triples
from tests.reasoner.worlds import NARROW, WIDE

SOME = settings(
    max_examples=50,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def reopened(closure: Closure, rules=(), config: Config | None = None) -> Closure:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "saved"
        closure.image().write(folder, {"made_by": closure.fingerprint()})
        head = read_head(folder)
        assert head["made_by"] == fingerprint(rules, "reject")
        return Closure.from_image(Image.read(folder, head), rules, config)


def proofs(closure: Closure) -> list[object]:
    first = sorted(closure.inferred(), key=str)[:4]
    found = [closure.explain(triple, budget=10_000_000) for triple in first]
    return [proof.to_dict() for proof in found]


def assert_same(one: Closure, other: Closure) -> None:
    assert set(one.inferred()) == set(other.inferred())
    assert clashes(one) == clashes(other)
    assert proofs(one) == proofs(other)
    assert one.digest() == other.digest()


def run_script(world, script, rules) -> None:
    """Edit, and save and reopen between the edits; each time compare with a rebuilt closure."""
    asserted = {*world[0], *world[1]}
    closure = reopened(Closure.build(asserted, [], rules), rules)
    assert_same(closure, Closure.build(asserted, [], rules, IN_BULK))
    for (add, picks), reopen in script:
        ordered = sorted(asserted, key=str)
        remove = {ordered[i % len(ordered)] for i in picks if ordered} - set(add)
        closure.stage(add=add, remove=remove).apply()
        asserted = (asserted - remove) | set(add)
        if reopen:
            closure = reopened(closure, rules)
        assert_same(closure, Closure.build(asserted, [], rules, IN_BULK))


@pytest.mark.slow
@pytest.mark.parametrize("rules", [(), RULES], ids=["ontology", "rules"])
@pytest.mark.parametrize("size", [WIDE, NARROW], ids=["wide", "narrow"])
def test_edits_after_reopening_give_what_a_rebuild_gives(size, rules):
    edits = size.edits().flatmap(
        lambda script: st.tuples(*(st.tuples(st.just(step), st.booleans()) for step in script))
    )

    @SOME
    @given(size.worlds(), edits)
    def check(world, script):
        run_script(world, script, rules)

    check()


def test_a_script_with_every_kind_of_condition_survives():
    rules = (
        *RULES,
        "CONSTRUCT { ?x <urn:t:twice> ?v } WHERE { ?x <urn:t:d0> ?w BIND(?w + ?w AS ?v) }",
        "CONSTRUCT { ?x <urn:t:d1> 'small' } WHERE { ?x <urn:t:d0> ?w "
        "FILTER (?w < 2 || DATATYPE(?w) IN (<urn:t:none>)) }",
    )
    data = triples(
        "<urn:t:i0> a <urn:t:C0> ; <urn:t:d0> 1, 1.0, 7 ; <urn:t:p0> <urn:t:i1> ."
        "<urn:t:i1> <urn:t:p1> <urn:t:i0> . <urn:t:i1> owl:sameAs <urn:t:i2> ."
        "<urn:t:d1> rdfs:range xsd:integer . <urn:t:p0> a owl:FunctionalProperty ."
        "[] a owl:AllDifferent ; owl:members ( <urn:t:i1> <urn:t:i2> ) ."
    )
    before = Closure.build(data, [], rules)
    assert before.contradictions()
    after = reopened(before, rules)
    assert_same(after, before)
    assert after._state.program.rules == before._state.program.rules
    assert after._state.program.distinct == before._state.program.distinct
    assert after.stats() == before.stats()


TERMS = [
    NamedNode("urn:caf\u00e9"),
    BlankNode("b1"),
    Literal('line\nbreak "quoted" \\ \t \u0001 \U0001f916'),
    Literal("caf\u00e9", language="fr"),
    Literal(""),
    Literal("1.50", datatype=NamedNode(XSD + "decimal")),
    Literal("not a number", datatype=NamedNode(XSD + "integer")),
]


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_terms_are_read_back_as_they_were(term):
    subject, predicate = NamedNode("urn:s"), NamedNode("urn:p")
    closure = reopened(Closure.build([], [(subject, predicate, term)]))
    assert closure.match(subject) == [(subject, predicate, term)]
    assert closure.match(None, None, term) == [(subject, predicate, term)]


def test_literals_of_one_value_are_known_as_such_after_reopening():
    data = triples(":p rdfs:domain :C . :i :p 1 .")
    closure = reopened(Closure.build([], data))
    same = (
        NamedNode(data[1][0].value),
        data[1][1],
        Literal("1.0", datatype=NamedNode(XSD + "decimal")),
    )
    assert closure.contains(same)
    closure.stage(add=[same]).apply()
    again = reopened(closure)
    assert set(again.match(same[0], same[1])) == {data[1], same}


def test_terms_that_share_a_hash_are_told_apart(monkeypatch):
    monkeypatch.setattr("reasoner.terms.table.hash_of", lambda text: len(text) % 3)
    data = triples(" ".join(f":i{n} :p {n}, :o{n} ." for n in range(30)))
    closure = reopened(Closure.build([], data))
    assert set(closure.match()) == set(data)
    assert closure.match(NamedNode("urn:unknown")) == []


def test_what_is_said_of_reifiers_stays_left_out_after_reopening():
    text = ":r rdf:reifies <<( :a :b :c )>> . :r :confidence 0.5 ."
    closure = reopened(Closure.build([], triples(text)))
    closure.stage(add=triples(":r :source :x .")).apply()
    assert closure.match() == []


def test_the_changes_since_it_was_read_are_counted():
    closure = reopened(Closure.build(triples(":Mug rdfs:subClassOf :Vessel ."), []))
    assert (closure.changes, closure.size) == (0, 1)
    closure.stage(add=triples(":m a :Mug .")).apply()
    assert (closure.changes, closure.size) == (3, 2)  # asserted, and the same and one more derived


# Folders.


@pytest.fixture
def folder(tmp_path):
    closure = Closure.build(triples(":Mug rdfs:subClassOf :Vessel ."), triples(":m a :Mug ."))
    closure.image().write(tmp_path / "saved", {"kind": "test"})
    return tmp_path / "saved"


def read(folder: Path) -> TermTable:
    arrays, document = read_folder(folder, read_head(folder))
    return TermTable.of_arrays(arrays, document["variants"])


def test_every_flipped_bit_is_noticed(folder):
    for path in sorted(folder.iterdir()):
        whole = path.read_bytes()
        for at in range(0, len(whole), max(1, len(whole) // 97)):
            damaged = bytearray(whole)
            damaged[at] ^= 1 << (at % 8)
            path.write_bytes(bytes(damaged))
            with pytest.raises(DamagedFolderError):
                read(folder)
        path.write_bytes(whole)
    assert len(read(folder).resources) > 0


@pytest.mark.parametrize("name", ["head.json", "arrays.bin", "program.json"])
@pytest.mark.parametrize("kept", [0, 0.5, None], ids=["emptied", "cut", "deleted"])
def test_a_cut_or_missing_file_is_noticed(folder, name, kept):
    path = folder / name
    if kept is None:
        path.unlink()
    else:
        content = path.read_bytes()
        path.write_bytes(content[: int(len(content) * kept)])
    with pytest.raises(DamagedFolderError, match=name):
        read(folder)


def test_another_format_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("reasoner.saved.container.FORMAT", 99)
    write_folder(tmp_path / "later", {}, {}, {})
    monkeypatch.undo()
    with pytest.raises(DamagedFolderError, match="format 99"):
        read_head(tmp_path / "later")


def test_a_half_written_folder_has_another_name_and_is_written_over(folder):
    left = folder.with_name("next.tmp")
    left.mkdir()
    (left / "arrays.bin").write_bytes(b"half")
    write_folder(folder.with_name("next"), {}, {"a": 1}, {})
    assert not left.exists()
    assert json.loads((folder.with_name("next") / "program.json").read_text()) == {"a": 1}


def test_other_rules_give_another_fingerprint():
    one = fingerprint(["CONSTRUCT { ?x <urn:a> ?y } WHERE { ?x <urn:b> ?y }"], "reject")
    assert one != fingerprint([], "reject")
    assert one["engine"] == fingerprint([], "reject")["engine"]
    assert fingerprint([], "keep") != fingerprint([], "reject")
