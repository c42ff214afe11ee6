"""Large commits go another way into the store than small ones, with the same result."""

from __future__ import annotations

import gc
import random
import re
from collections.abc import Iterable
from pathlib import Path

import pyoxigraph as ox
import pytest

import rtask
from reasoner import closure
from rtask.kb.commit import committer
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import replay
from rtask.kb.store import commit_writes, embedded
from rtask.kb.store.collector import collector_paused
from rtask.kb.store.embedded import EmbeddedStore
from rtask.knowledge_base import KnowledgeBase
from tests.commands import run_program

_SCHEMA = """
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<urn:Mug> rdfs:subClassOf <urn:Vessel>, [ a owl:Class ; owl:unionOf ( <urn:Vessel> <urn:Pan> ) ] .
<urn:Vessel> owl:disjointWith <urn:Pan> .
<urn:near> a owl:SymmetricProperty ; rdfs:domain <urn:Body> .
<urn:inside> a owl:TransitiveProperty .
"""


def _count_as_large() -> None:
    committer.LARGE = commit_writes.LARGE = embedded.LARGE = 50
    closure.LISTED_TRIPLES = 10
    embedded._BULK = 40


@pytest.fixture
def count_as_large(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in (
        (committer, "LARGE"), (commit_writes, "LARGE"), (embedded, "LARGE"), (embedded, "_BULK"),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, getattr(module, name))
    monkeypatch.setattr(closure, "LISTED_TRIPLES", closure.LISTED_TRIPLES)
    _count_as_large()


def _mugs(rng: random.Random, count: int) -> str:
    lines = []
    for n in range(count):
        lines.append(f"<urn:m{n}> a <urn:Mug> ; <urn:mass> {rng.random():.3f} .")
        lines.append(f"<urn:m{n}> <urn:near> <urn:m{rng.randrange(count)}> .")
        lines.append(f"<urn:m{n}> <urn:inside> <urn:m{n // 3}> .")
    return "\n".join(lines)


def _work(kb: KnowledgeBase) -> Iterable[int]:
    """Make commits, large ones among them, that meet what is asserted and derived already."""
    rng = random.Random(5)
    kb.load(_SCHEMA.encode(), format="turtle", graph="urn:schema")
    kb.update("INSERT DATA { <urn:m1> a <urn:Vessel> . <urn:m2> <urn:mass> 7 }", "nao-1")
    yield kb.seq
    kb.load(_mugs(rng, 40).encode(), format="turtle", graph="urn:big")
    yield kb.seq
    with kb.transaction() as tx:
        tx.clear("urn:big")
        tx.load(_mugs(rng, 30).encode(), "turtle", graph="urn:big")
        tx.load(b"<urn:m3> a <urn:Vessel>, <urn:Body> .", "turtle", graph="urn:other")
    yield kb.seq


def _content(store: EmbeddedStore) -> set[ox.Quad]:
    return set(store.quads_for_pattern(None, None, None))


def _said(kb: KnowledgeBase) -> list[str]:
    """Return all statements but the notes of commits, without names that are redrawn."""
    kept = (kb.graphs.meta, kb.graphs.provenance)
    texts = (
        " ".join(map(str, quad))
        for quad in _content(kb.store)
        if quad.graph_name not in kept and not isinstance(quad.graph_name, ox.DefaultGraph)
    )
    return sorted(re.sub(r"genid/[^>]+|_:\w+", "", text) for text in texts)


@pytest.mark.slow
def test_a_large_commit_leads_where_small_ones_lead(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    found = []
    for name in ("small", "large"):
        if name == "large":
            request.getfixturevalue("count_as_large")
        with rtask.open(tmp_path / name, ontologies=False, base="urn:lab/") as kb:
            states = [(seq, _said(kb), kb.verify()) for seq in _work(kb)]
            assert kb.contradictions() == []
        found.append(states)
    assert found[0] == found[1]
    assert all(not problems for _, _, problems in found[1])


@pytest.mark.usefixtures("count_as_large")
def test_the_journal_leads_to_the_same_statements_and_numbers(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        for _ in _work(kb):
            store = EmbeddedStore(ox.Store())
            for record in JournalFile(tmp_path / "kb" / "journal").records():
                replay(store, record, merged=True)
            assert _content(kb.store) == _content(store)
            for graph in kb.store.named_graphs():
                if graph not in (kb.graphs.meta, kb.graphs.provenance):
                    assert kb.catalogue.triple_count(graph) == kb.store.count(graph)


@pytest.mark.usefixtures("count_as_large")
def test_subscribers_hear_of_what_a_large_commit_derives() -> None:
    with rtask.open(":memory:", ontologies=False) as kb:
        kb.load(_SCHEMA.encode(), format="turtle", graph="urn:schema")
        with kb.subscribe() as everything:
            kb.load(_mugs(random.Random(1), 40).encode(), format="turtle", graph="urn:big")
            change = everything.get(10)
        derived = kb.match(graph=kb.graphs.inferred)
        assert set(change.inferred_added) <= set(derived)
        assert change.commit.derived == len(change.inferred_added) > 10
        assert (
            change.commit.added
            == len(change.added)
            == kb.catalogue.triple_count(ox.NamedNode("urn:big"))
        )


@pytest.mark.slow
@pytest.mark.usefixtures("count_as_large")
@pytest.mark.parametrize("step", [1, 2, 3, 4, 9])
def test_a_failure_in_the_middle_takes_back_what_was_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    with rtask.open(tmp_path, ontologies=False) as kb:
        work = iter(_work(kb))
        seq = next(work)
        before = _content(kb.store)
        real, calls = EmbeddedStore.bulk_extend, []

        def fail(store: EmbeddedStore, quads: Iterable[ox.Quad]) -> None:
            calls.append(1)
            if len(calls) == step:
                real(store, list(quads)[:20])
                raise RuntimeError("the disk is gone")
            real(store, quads)

        monkeypatch.setattr(EmbeddedStore, "bulk_extend", fail)
        try:
            next(work)
        except RuntimeError:
            assert kb.seq == seq
            assert _content(kb.store) == before
        else:
            assert step > len(calls) >= 3
        monkeypatch.undo()
        kb.update("INSERT DATA { <urn:m1> a <urn:Mug> }", "nao-1")
        assert [one for one in kb.verify() if one.severity == "error"] == []


_DIE = """
import os, sys
import rtask
sys.path.insert(0, sys.argv[3])
from test_large_commits import _count_as_large, _work
from rtask.kb.store.embedded import EmbeddedStore
_count_as_large()
real, left = EmbeddedStore.bulk_extend, [int(sys.argv[2])]
def dying(store, quads):
    left[0] -= 1
    if not left[0]:
        real(store, list(quads)[:25])
        os._exit(9)
    real(store, quads)
kb = rtask.open(sys.argv[1], ontologies=False)
work = _work(kb)
next(work)
kb.checkpoint()  # what was before it is not replayed
EmbeddedStore.bulk_extend = dying
list(work)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "step", [1, 3, *(pytest.param(step, marks=pytest.mark.deep) for step in (2, 5))]
)
def test_a_kill_in_the_middle_is_made_up_for_at_the_next_opening(tmp_path: Path, step: int) -> None:
    died = run_program(_DIE, str(tmp_path / "kb"), str(step), str(Path(__file__).parent))
    assert died.returncode == 9, died.stderr
    with (
        rtask.open(tmp_path / "kb", ontologies=False) as kb,
        rtask.open(":memory:", ontologies=False, base=kb.base) as whole,
    ):
        reached = [_said(whole) for seq in _work(whole) if seq <= kb.seq]
        assert _said(kb) == reached[-1]
        assert kb.verify() == []


def test_pauses_of_the_collector_may_overlap_and_end() -> None:
    assert gc.isenabled()
    with collector_paused():
        with collector_paused():
            assert not gc.isenabled()
        assert not gc.isenabled()
    assert gc.isenabled()
