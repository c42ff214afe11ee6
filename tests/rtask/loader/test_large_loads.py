"""Shapes, quarantine and subscriptions hold for documents larger than a commit of updates."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import pytest
from pyoxigraph import Quad

import ontology
import rtask
from rtask.errors import ValidationError
from rtask.kb.commit import validation
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.quads import InGraph
from rtask.rdf.terms import RDF_TYPE, iri

RDFS = ontology.PREFIXES["rdfs"]

MUG = f"<urn:m{{n}}> a <{ontology.NS}Mug> ; <{ontology.NS}objectId> 'lab/m{{n}}' .\n"
TOO_LIGHT = f"<urn:m3> <{ontology.NS}mass> -1.0e0 .\n"
AND_AN_ACT = f"<urn:m3> a <{ontology.NS}Grasp> .\n"


def mugs(count: int, more: str = "") -> bytes:
    return ("".join(MUG.format(n=n) for n in range(count)) + more).encode()


@pytest.fixture
def small_commits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything beyond 20 statements counts as large."""
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 20)
    monkeypatch.setattr("rtask.loader.bulk.TEXT_BYTES", 10)
    monkeypatch.setattr(validation, "_BATCH", 7)


@pytest.mark.slow
@pytest.mark.usefixtures("small_commits")
def test_a_violation_in_a_large_document_refuses_all_of_it() -> None:
    with rtask.open(":memory:", validate=True) as kb:
        before = kb.seq
        with pytest.raises(ValidationError, match="mass"):
            kb.load(mugs(30, TOO_LIGHT), format="turtle")
        assert kb.seq == before
        assert kb.match("urn:m1") == []
        assert kb.load(mugs(30), format="turtle").added == 60
        assert [one for one in kb.verify() if one.severity == "error"] == []


@pytest.mark.slow
@pytest.mark.usefixtures("small_commits")
def test_a_warning_names_every_node_whatever_its_batch() -> None:
    faulty = "".join(TOO_LIGHT.replace("m3", f"m{n}") for n in (1, 12, 29))
    with rtask.open(":memory:", validate="warn") as kb:
        report = kb.load(mugs(30, faulty), format="turtle")
    named = {w.partition(" ")[0] for w in report.warnings if "/ns#mass>" in w}
    assert named == {"<urn:m1>", "<urn:m12>", "<urn:m29>"}


@pytest.mark.slow
@pytest.mark.usefixtures("small_commits")
def test_contradictory_statements_of_a_large_document_go_to_quarantine() -> None:
    with rtask.open(":memory:", on_inconsistency="quarantine") as kb:
        kb.load(mugs(30, AND_AN_ACT), format="turtle")
        aside = {one.quad.subject.value for one in kb.quarantined()}
        assert aside == {"urn:m3"}
        assert kb.contradictions() == []
        assert kb.query(f"ASK {{ <urn:m4> a <{ontology.NS}DrinkingVessel> }}") is True
        assert kb.verify() == []


@pytest.mark.slow
@pytest.mark.usefixtures("small_commits")
def test_subscribers_hear_of_a_large_document(tmp_path: Path) -> None:
    (tmp_path / "mugs.ttl").write_bytes(mugs(30))
    with rtask.open(tmp_path / "kb", base="urn:lab/") as kb:
        vessel = ontology.NS + "DrinkingVessel"
        with (
            kb.subscribe("urn:m7") as one,
            kb.subscribe(cls=vessel) as vessels,
            kb.subscribe_query(f"SELECT ?m {{ ?m a <{ontology.NS}Mug> }}") as rows,
        ):
            assert rows.get(10).added.to_dicts() == []
            before = kb.seq
            kb.load(tmp_path / "mugs.ttl")
            heard = one.get(10)
            assert len(heard.added) == 2
            assert {quad.subject.value for quad in heard.inferred_added} == {"urn:m7"}
            assert len(vessels.get(10).added) == 60
            assert len(rows.get(10).added) == 30
        with kb.subscribe("urn:m8", since=before) as late:
            assert len(late.get(10).added) == 2
        assert kb.verify() == []


def test_only_shapes_quarantine_and_subscribers_ask_for_exact_changes() -> None:
    for options, exact in (
        ({}, False),
        ({"validate": "warn"}, True),
        ({"on_inconsistency": "quarantine"}, True),
    ):
        with rtask.open(":memory:", ontologies=False, **options) as kb:  # type: ignore[call-overload]
            assert kb.needs_exact_changes is exact
            with kb.subscribe():
                assert kb.needs_exact_changes
            assert kb.needs_exact_changes is exact


@pytest.mark.slow
def test_a_subscriber_hears_of_more_statements_than_an_update_may_have() -> None:
    count = 210_000
    text = "".join(f"<urn:s{n}> <urn:p{n % 7}> <urn:o{n % 100}> .\n" for n in range(count))
    with rtask.open(":memory:", ontologies=False) as kb:
        with kb.subscribe("urn:s209999") as one, kb.subscribe(predicate="urn:p3") as many:
            report = kb.load(text.encode(), format="turtle")
            assert report.added == count
            assert len(one.get(10).added) == 1
            assert len(many.get(10).added) == count // 7
        assert kb.stats()["closure"] == "current"


@pytest.mark.parametrize("union", ["merged", "view"])
def test_what_follows_from_a_large_document_is_stored_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, union: str
) -> None:
    parts: list[int] = []
    bulk_extend = EmbeddedStore.bulk_extend

    def counted(store: EmbeddedStore, quads: Collection[Quad]) -> None:
        if isinstance(quads, InGraph):
            parts.append(len(quads))
        bulk_extend(store, quads)

    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 20)
    monkeypatch.setattr("rtask.kb.commit.bulk.MAX_QUADS", 20)
    monkeypatch.setattr("rtask.kb.commit.bulk._DERIVED_PART", 8)
    kinds = "".join(f"<urn:k{n}> <{RDFS}subClassOf> <urn:k{n + 1}> .\n" for n in range(3))
    things = "".join(f"<urn:x{n}> a <urn:k0> .\n" for n in range(20))
    with rtask.open(tmp_path / "kb", ontologies=False, union=union) as kb:
        kb.update(f"INSERT DATA {{ {kinds} }}")
        monkeypatch.setattr(EmbeddedStore, "bulk_extend", counted)
        [file] = kb.load((things + "<urn:y> <urn:p> 1 .\n").encode(), format="turtle").files
        assert file.derived == 60
        assert len(parts) >= 8
        assert max(parts) <= 8
        assert len(kb.match(None, RDF_TYPE, iri("urn:k3"), kb.graphs.inferred)) == 20
        assert kb.verify() == []
