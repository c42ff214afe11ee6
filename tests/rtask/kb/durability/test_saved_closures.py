"""The closure is read from the folder after a restart, and rebuilt if none there fits."""

from __future__ import annotations

import logging
import os
import random
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import rtask
from rtask.kb.commit import inference
from rtask.kb.durability import saved_closures
from rtask.kb.durability.saved_closures import saved_folders
from rtask.kb.durability.settings import Settings
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Literal, iri
from tests.processes import end_of_checkpoints

pytestmark = pytest.mark.slow

_STRESS = Path(__file__).parents[3] / "benchmarks" / "reasoner" / "stress_closure.py"
_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
_RANGE = "http://www.w3.org/2000/01/rdf-schema#range"
_THING = iri("urn:t:Thing")
SCHEMA = """
@prefix : <urn:t:> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:Mug rdfs:subClassOf :Vessel . :Vessel rdfs:subClassOf :Thing . :Vessel owl:disjointWith :Pen .
:near a owl:TransitiveProperty, owl:SymmetricProperty . :serial a owl:InverseFunctionalProperty .
:on rdfs:domain :Vessel ; rdfs:range :Place .
"""


@pytest.fixture(autouse=True)
def save_small_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(saved_closures, "_MIN_ASSERTED", 0)


def _open(folder: Path, **options: object) -> KnowledgeBase:
    return rtask.open(folder, ontologies=False, **options)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with _open(tmp_path) as kb:
        kb.load(SCHEMA.encode(), format="turtle", graph="urn:t:schema")
        kb.update("INSERT DATA { <urn:t:m> a <urn:t:Mug> ; <urn:t:near> <urn:t:n> }", "nao-1")
    assert [path.name for path in saved_folders(tmp_path)] == ["closure-2"]
    return tmp_path


def _reasons(caplog: pytest.LogCaptureFixture) -> list[str]:
    """Return why saved closures were not used."""
    return [r.getMessage() for r in caplog.records if "rebuilt" in r.getMessage()]


def _assert_current(kb: KnowledgeBase) -> None:
    """Compare the stored inferred graph and the closure in use with a rebuild."""
    used = kb._inference.closure()
    rebuilt = kb._inference._build()
    assert set(used.inferred()) == set(rebuilt.inferred())
    stored = {(q.subject, q.predicate, q.object) for q in kb.match(graph=kb.graphs.inferred)}
    assert stored == set(rebuilt.inferred())
    assert [str(c) for c in used.contradictions()] == [str(c) for c in rebuilt.contradictions()]


def test_the_first_write_after_opening_goes_on_from_the_saved_closure(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _open(folder) as kb:
        monkeypatch.setattr(type(kb._inference), "_build", None)  # building it would fail
        assert kb.update("INSERT DATA { <urn:t:k> a <urn:t:Mug> }").derived == 2
        assert kb.explain("urn:t:m", _TYPE, _THING).holds
        monkeypatch.undo()
        _assert_current(kb)


def test_two_are_kept_and_each_close_after_a_change_saves_one(folder: Path) -> None:
    for number in range(3):
        with _open(folder) as kb:
            kb.update(f"INSERT DATA {{ <urn:t:m{number}> a <urn:t:Mug> }}")
    with _open(folder) as kb:
        kb.explain("urn:t:m", _TYPE, _THING)
    assert [path.name for path in saved_folders(folder)] == ["closure-5", "closure-4"]


def test_commits_after_it_are_followed_from_the_journal(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = folder.parent / "first"
    shutil.copytree(folder / "closure-2", first)
    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:n> a <urn:t:Mug> . <urn:t:n> <urn:t:near> <urn:t:o> }")
        kb.update("DELETE DATA { <urn:t:n> a <urn:t:Mug> }")
        kb.update("INSERT DATA { GRAPH <urn:t:g> { <urn:t:m> a <urn:t:Mug> } }")
        kb.update(f"DROP GRAPH <{kb.graphs.agent('nao-1').value}>")
        kb.update("INSERT DATA { <urn:t:a> <urn:t:serial> 1 . <urn:t:b> <urn:t:serial> 1 }")
    shutil.rmtree(folder / "closure-7")
    assert saved_folders(folder) == [folder / "closure-2"]
    with _open(folder) as kb:
        _assert_current(kb)
        assert kb.seq == 7
    assert _reasons(caplog) == []


def test_random_edits_with_reopening_give_what_a_rebuild_gives(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng = random.Random(5)
    things = [f"<urn:t:i{n}>" for n in range(8)]
    known: list[tuple[str, str]] = []

    def edit(kb: KnowledgeBase) -> None:
        graph = f"<urn:t:g{rng.randrange(3)}>"
        if known and rng.random() < 0.4:
            graph, triple = known.pop(rng.randrange(len(known)))
            kb.update(f"DELETE DATA {{ GRAPH {graph} {{ {triple} }} }}")
            return
        s, o = rng.choice(things), rng.choice(things)
        triple = rng.choice(
            [
                f"{s} a <urn:t:Mug>",
                f"{s} <urn:t:near> {o}",
                f"{s} <urn:t:on> {o}",
                f"{s} <urn:t:serial> {rng.randrange(4)}",
                f"<urn:t:on> <{_RANGE}> <urn:t:R{rng.randrange(2)}>",
            ]
        )
        kb.update(f"INSERT DATA {{ GRAPH {graph} {{ {triple} }} }}")
        known.append((graph, triple))

    for _ in range(12):
        with _open(folder) as kb:
            for _ in range(rng.randrange(5)):
                edit(kb)
            if rng.random() < 0.5:
                for path in saved_folders(folder)[: rng.randrange(2)]:
                    shutil.rmtree(path)
            _assert_current(kb)
    assert _reasons(caplog) == []


def _assert_rebuilt(folder: Path, caplog: pytest.LogCaptureFixture, why: str) -> None:
    with caplog.at_level(logging.WARNING), _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:later> a <urn:t:Mug> }")
        _assert_current(kb)
    assert any(re.search(why, reason) for reason in _reasons(caplog)), _reasons(caplog)


@pytest.mark.parametrize("name", ["head.json", "arrays.bin", "program.json"])
@pytest.mark.parametrize("damage", ["flip", "cut", "delete"])
def test_damage_is_noticed_and_the_closure_built_anew(
    folder: Path, caplog: pytest.LogCaptureFixture, name: str, damage: str
) -> None:
    path = folder / "closure-2" / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    if damage == "delete":
        path.unlink()
    else:
        path.write_bytes(content if damage == "flip" else content[: len(content) // 2])
    _assert_rebuilt(folder, caplog, name)


def test_damage_is_reported_by_verify_and_removed_by_repair(folder: Path) -> None:
    (folder / "closure-2" / "arrays.bin").write_bytes(b"")
    with _open(folder) as kb:
        [finding] = kb.verify()
        assert (finding.severity, finding.part) == ("note", "closure")
        assert "closure-2" in finding.detail
        kb.verify(repair=True)
        assert kb.verify() == []


def test_one_made_by_other_rules_is_not_used(
    folder: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    rule = "CONSTRUCT { ?x <urn:t:seen> true } WHERE { ?x a <urn:t:Mug> }"
    monkeypatch.setattr("rtask.kb.commit.inference.shipped_rules", lambda: [rule])
    with _open(folder) as kb:
        assert kb._inference.closure().contains((iri("urn:t:m"), iri("urn:t:seen"), Literal(True)))
    assert any("other rules or another version" in why for why in _reasons(caplog))


def test_one_made_by_another_version_of_the_reasoner_is_not_used(
    folder: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reasoner.saved.image._engine", lambda: "another version")
    _assert_rebuilt(folder, caplog, "another version of the reasoner")


def test_one_of_another_numbering_is_not_used(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    replace(Settings.load(folder), epoch="another").save(folder)
    _assert_rebuilt(folder, caplog, "renumbered")


def test_one_from_commits_that_were_lost_is_not_used(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A power cut may take commits that a saved closure knows; others then get their numbers."""
    behind = folder.parent / f"{folder.name}-behind"
    shutil.copytree(folder, behind)
    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:lost> a <urn:t:Mug> }")
    shutil.copytree(folder / "closure-3", behind / "closure-3")
    with _open(behind) as kb:
        _assert_current(kb)
        kb.update("INSERT DATA { <urn:t:other> a <urn:t:Mug> }")
    assert any("belongs to commit 3" in why for why in _reasons(caplog))
    caplog.clear()
    shutil.rmtree(behind / "closure-3")
    shutil.copytree(folder / "closure-3", behind / "closure-3")
    _assert_rebuilt(behind, caplog, "commit 3 is another one")


def test_statements_that_the_journal_does_not_hold_are_noticed(
    folder: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = folder.parent / f"{folder.name}-kept"
    shutil.copytree(folder / "closure-2", kept)
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 10)
    with _open(folder) as kb:
        lines = "".join(f"<urn:t:b{n}> a <urn:t:Mug> .\n" for n in range(30))
        kb.load(lines.encode(), format="turtle", graph="urn:t:bulk")
    for path in saved_folders(folder):
        shutil.rmtree(path)
    shutil.copytree(kept, folder / "closure-2")
    _assert_rebuilt(folder, caplog, "the journal does not hold")


def _newest(folder: Path) -> str:
    return saved_folders(folder)[0].name.removeprefix("closure-")


def test_writing_without_reasoning_in_between_is_made_up_for(folder: Path) -> None:
    with _open(folder, reason=False) as kb:
        kb.update("INSERT DATA { <urn:t:later> a <urn:t:Mug> }")
    with _open(folder) as kb:
        _assert_current(kb)


def test_a_bulk_load_saves_the_closure_at_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 10)
    with _open(folder) as kb:
        lines = "".join(f"<urn:t:b{n}> a <urn:t:Mug> .\n" for n in range(30))
        kb.load(lines.encode(), format="turtle", graph="urn:t:bulk")
        assert [path.name for path in saved_folders(folder)] == [f"closure-{kb.seq}"]
    with _open(folder) as kb:
        monkeypatch.setattr(type(kb._inference), "_build", None)
        assert kb.update("INSERT DATA { <urn:t:k> a <urn:t:Mug> }").derived == 2


def test_a_checkpoint_saves_it_when_enough_has_changed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(saved_closures, "_DUE_CHANGES", 3)
    monkeypatch.setattr("rtask.kb.durability.recovery._EVERY_S", 0.0)
    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:k> <urn:t:p> 1 }")
        end_of_checkpoints()
        assert _newest(folder) == "2"
        kb.update("INSERT DATA { <urn:t:k> a <urn:t:Mug> }")
        end_of_checkpoints()
        assert _newest(folder) == "4"


def test_a_full_disk_leaves_the_commit_and_no_saved_closure(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*args: object) -> None:
        raise OSError(28, "No space left on device")

    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:k> a <urn:t:Mug> }")
        monkeypatch.setattr("reasoner.saved.container._write", full)
    assert "was not saved" in caplog.text
    assert [path.name for path in saved_folders(folder)] == ["closure-2"]
    monkeypatch.undo()
    with _open(folder) as kb:
        _assert_current(kb)


def test_a_folder_open_for_reading_uses_it_and_writes_none(folder: Path) -> None:
    with _open(folder, mode="r") as kb:
        assert kb.explain("urn:t:m", _TYPE, _THING).holds
    assert [path.name for path in saved_folders(folder)] == ["closure-2"]


def test_what_other_rules_derived_is_derived_again_at_the_next_opening(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As after an upgrade that brings a rule."""
    rule = "CONSTRUCT { ?x a <urn:t:Ruled> } WHERE { ?x a <urn:t:Mug> }"
    shipped = inference.shipped_rules()
    monkeypatch.setattr(inference, "shipped_rules", lambda: [*shipped, rule])
    with caplog.at_level(logging.WARNING), _open(folder, mode="r"):
        assert "open it once for writing" in caplog.text
    with _open(folder) as kb:
        assert kb.query("ASK { <urn:t:m> a <urn:t:Ruled> }")
        _assert_current(kb)
        last = kb.seq
    with _open(folder) as kb:
        assert kb.seq == last, "once is enough"
    monkeypatch.setattr(inference, "shipped_rules", lambda: shipped)
    with _open(folder) as kb:
        assert not kb.query("ASK { <urn:t:m> a <urn:t:Ruled> }")
        _assert_current(kb)


def test_rebuilding_the_store_or_the_closure_discards_it(folder: Path) -> None:
    from rtask.kb.maintenance.rebuild import rebuild_store

    rebuild_store(folder)
    assert saved_folders(folder) == []
    with _open(folder) as kb:
        kb.update("INSERT DATA { <urn:t:k> a <urn:t:Mug> }")
    with _open(folder) as kb:
        kb.rebuild()
        assert saved_folders(folder) == []


@pytest.mark.parametrize("kills", [1, pytest.param(6, marks=pytest.mark.deep)])
def test_kills_while_it_is_written_leave_no_torn_one(kills: int) -> None:
    """The short form of the stress test."""
    done = subprocess.run(
        [sys.executable, str(_STRESS), "--kills", str(kills), "--triples", "3000", "--seed", "3"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == 0, done.stderr
    assert re.search(rf"{kills} kills, .* none torn", done.stdout), done.stdout
