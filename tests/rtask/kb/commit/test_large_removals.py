"""Large removals load again what stays: the same content, all or nothing, no read in between."""

from __future__ import annotations

import random
import threading
from pathlib import Path

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import StoreError
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import replay
from rtask.kb.store import replacement, union
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.replacement import ReplacementError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import BlankNode, Quad, iri, literal
from tests.commands import run_program

_BELOW = iri("http://www.w3.org/2000/01/rdf-schema#subClassOf")
_TYPE = iri("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")


@pytest.fixture(autouse=True)
def count_as_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replacement, "MIN_REPLACED", 20)
    monkeypatch.setattr(union, "_LARGE", 10)


def _open(folder: Path | str, **options: object) -> KnowledgeBase:
    return rtask.open(folder, ontologies=False, **options)


def _fill(kb: KnowledgeBase, count: int = 60) -> None:
    kb.update("INSERT DATA { <urn:keep> <urn:p> 1 }", "nao-1")
    kb.update("CREATE GRAPH <urn:empty>")
    with kb.transaction() as tx:
        tx.add("urn:Mug", _BELOW.value, iri("urn:Vessel"), graph="urn:schema")
        quads = [
            Quad(iri(f"urn:m{n}"), _TYPE, iri("urn:Mug"), iri("urn:big")) for n in range(count)
        ]
        quads.append(Quad(iri("urn:keep"), iri("urn:p"), literal(1), iri("urn:big")))
        quads.append(Quad(BlankNode("mine"), iri("urn:p"), BlankNode("other"), iri("urn:blank")))
        tx.add_quads(quads)


def _content(kb: KnowledgeBase) -> tuple[set[ox.Quad], set[object]]:
    return set(kb.store.quads_for_pattern(None, None, None)), set(kb.store.named_graphs())


def _replayed(folder: Path) -> tuple[set[ox.Quad], set[object]]:
    """Return what the journal leads to, each removal made one by one."""
    store = EmbeddedStore(ox.Store())
    for record in JournalFile(folder / "journal").records():
        replay(store, record, merged=True)
    return set(store.quads_for_pattern(None, None, None)), set(store.named_graphs())


@pytest.fixture
def replaced(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Number of statements that each replacement took away."""
    found: list[int] = []
    real = replacement.replace_contents

    def noted(store: EmbeddedStore, change: object) -> None:
        found.append(len(change.removed))  # type: ignore[attr-defined]
        real(store, change)  # type: ignore[arg-type]

    monkeypatch.setattr("rtask.kb.commit.committer.replace_contents", noted)
    return found


def test_dropping_a_graph_leaves_the_rest_as_it_was(tmp_path: Path, replaced: list[int]) -> None:
    with _open(tmp_path) as kb:
        _fill(kb)
        kb.update("DROP GRAPH <urn:big>")
        assert len(replaced) == 1
        assert replaced[0] > 120  # the graph, what was derived from it, and two numbers
        assert _content(kb) == _replayed(tmp_path)
        assert kb.store.contains_named_graph(iri("urn:empty"))
        assert not kb.store.contains_named_graph(iri("urn:big"))
        assert len(kb.match("urn:keep")) == 1
        assert len(kb.select("SELECT * { <urn:keep> ?p ?o }")) == 1
        assert [quad.object for quad in kb.match(graph="urn:blank")] == [BlankNode("other")]
        assert kb.match(graph=kb.graphs.inferred) == []
        assert kb.verify() == []
        kb.update("INSERT DATA { <urn:m> a <urn:Mug> }")
        assert len(kb.match("urn:m", graph=kb.graphs.inferred)) == 1
    with _open(tmp_path) as kb:
        assert kb.verify() == []


@pytest.mark.slow
@pytest.mark.parametrize("place", ["folder", "memory"])
def test_dropping_everything(tmp_path: Path, replaced: list[int], place: str) -> None:
    with _open(tmp_path if place == "folder" else ":memory:") as kb:
        _fill(kb)
        assert kb.select("SELECT (COUNT(*) AS ?n) { ?s a ?c }", timeout_s=60.0)
        kb.update("DROP ALL")
        assert len(replaced) == 1
        assert kb.match("urn:keep") == []
        count = kb.select("SELECT (COUNT(*) AS ?n) { ?s a <urn:Mug> }", timeout_s=60.0)
        assert int(str(count[0].value("n"))) == 0
        assert kb.verify() == []
        assert kb.seq == 4


def test_replacing_a_graph_by_another_content(tmp_path: Path, replaced: list[int]) -> None:
    with _open(tmp_path) as kb:
        _fill(kb)
        text = "".join(f"<urn:n{n}> a <urn:Mug> .\n" for n in range(50))
        kb.load(text.encode(), format="turtle", graph="urn:big", replace=True)
        assert len(replaced) == 1
        assert _content(kb) == _replayed(tmp_path)
        assert len(kb.match(graph="urn:big")) == 50
        assert kb.verify() == []


@pytest.mark.slow
def test_random_removals_lead_where_the_journal_leads(tmp_path: Path) -> None:
    rng = random.Random(2)
    with _open(tmp_path) as kb:
        for _ in range(40):
            graph = f"urn:g{rng.randrange(3)}"
            with kb.transaction() as tx:
                if rng.random() < 0.5:
                    tx.clear(graph)
                for _ in range(rng.randrange(60)):
                    tx.add(f"urn:s{rng.randrange(40)}", "urn:p", rng.randrange(3), graph=graph)
            assert _content(kb) == _replayed(tmp_path)
        assert [f for f in kb.verify() if f.severity == "error"] == []


_DIE = """
import os, sys
import pyoxigraph as ox
import rtask
from rtask.kb.store import replacement, union
from rtask.kb.store.embedded import EmbeddedStore
replacement.MIN_REPLACED, union._LARGE = 20, 10
sys.path.insert(0, sys.argv[3])
from test_large_removals import _fill
kb = rtask.open(sys.argv[1], ontologies=False)
_fill(kb)
kb.checkpoint()  # what was before it is not replayed
moment = sys.argv[2]
die = lambda *_, **__: os._exit(9)
class Dying:
    def __init__(self, store): self.store = store
    def __getattr__(self, name): return getattr(self.store, name)
    def clear(self):
        if moment == "renamed": die()
        self.store.clear()
        if moment == "empty": die()
fill = EmbeddedStore.bulk_extend
def dying_fill(store, quads):
    quads = list(quads)
    fill(store, quads[: len(quads) // 2] if moment == "half" else quads)
    die()
if moment in ("half", "loaded"): EmbeddedStore.bulk_extend = dying_fill
if moment == "journalled": replacement.remaining = die
elif moment == "written": replacement.os.fsync = die
else:
    real = replacement.embedded_store
    class Wrapped:
        def __init__(self, store): self.raw = Dying(store.raw)
    replacement.embedded_store = lambda store, what: Wrapped(real(store, what))
if sys.argv[4] == "drop":
    kb.update("DROP GRAPH <urn:big>")
else:
    text = "".join(f"<urn:n{n}> a <urn:Mug> .\\n" for n in range(50))
    kb.load(text.encode(), format="turtle", graph="urn:big", replace=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("moment", "action"),
    [
        ("written", "drop"),
        ("loaded", "drop"),
        ("half", "replace"),
        *(
            pytest.param(moment, action, marks=pytest.mark.deep)
            for moment, action in (
                ("journalled", "drop"),
                ("renamed", "drop"),
                ("empty", "drop"),
                ("empty", "replace"),
            )
        ),
    ],
)
def test_a_kill_in_the_middle_is_made_up_for_at_the_next_opening(
    tmp_path: Path, moment: str, action: str
) -> None:
    here = str(Path(__file__).parent)
    died = run_program(_DIE, str(tmp_path), moment, here, action)
    assert died.returncode == 9, died.stderr
    with _open(tmp_path) as kb:
        assert kb.seq == 4
        assert _content(kb) == _replayed(tmp_path)
        assert len(kb.match(graph="urn:big")) == (50 if action == "replace" else 0)
        assert [one for one in kb.verify() if one.severity == "error"] == []
        assert not list(tmp_path.glob("staying*"))


def test_a_failure_in_the_middle_refuses_writes_until_the_folder_is_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: object) -> None:
        raise OSError("the disk is gone")

    with _open(tmp_path) as kb:
        _fill(kb)
        monkeypatch.setattr(replacement, "_load", fail)
        with pytest.raises(ReplacementError, match="the disk is gone"):
            kb.update("DROP GRAPH <urn:big>")
        monkeypatch.undo()
        with pytest.raises(StoreError, match="open the knowledge base again"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with _open(tmp_path) as kb:
        assert kb.seq == 4
        assert kb.match(graph="urn:big") == []
        assert kb.verify() == []


@pytest.mark.slow
def test_no_read_sees_the_store_half_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    emptied, seen = threading.Event(), []
    real = replacement._load

    def slowly(store: EmbeddedStore, *rest: object) -> None:
        real(store, (), (), ())  # empty
        emptied.set()
        assert not done.wait(0.3), "a read went on"
        real(store, *rest)  # type: ignore[arg-type]

    with _open(tmp_path) as kb:
        _fill(kb)
        done = threading.Event()

        def read() -> None:
            assert emptied.wait(60)
            seen.append(len(kb.match(graph="urn:schema")))
            done.set()

        monkeypatch.setattr(replacement, "_load", slowly)
        reader = threading.Thread(target=read)
        reader.start()
        kb.update("DROP GRAPH <urn:big>")
        reader.join()
        assert seen == [1]
