"""The copy of the asserted graphs follows every change, and holds each statement once."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pyoxigraph as ox
import pytest

import rtask
from rtask.kb.readers.main import apply_change
from rtask.kb.readers.messages import encode_change
from rtask.kb.store import merged_graphs
from rtask.kb.store.merged_graphs import MergedCopy, with_merged_graphs
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import GraphName

ALL = "SELECT ?s ?o { ?s <urn:p> ?o } ORDER BY ?s ?o"
LEFT_OUT = ox.NamedNode("urn:g:0")


def quad(rng: random.Random, graphs: int) -> ox.Quad:
    s, o, g = (
        ox.NamedNode(f"urn:{x}:{rng.randrange(n)}")
        for x, n in zip("sog", (3, 3, graphs), strict=True)
    )
    return ox.Quad(s, ox.NamedNode("urn:p"), o, g)


def rows(store: ox.Store, graphs: Sequence[GraphName], kept: MergedCopy | None) -> list[str]:
    dataset: dict[str, Any] = {"default_graph": graphs, "named_graphs": graphs}
    source, options = with_merged_graphs(store, ALL, dataset, kept)
    answer: Any = source.query(ALL, **options)
    return [str(row) for row in answer]


@pytest.mark.parametrize("seed", range(5))
def test_a_copy_that_followed_changes_answers_as_a_new_one(seed: int) -> None:
    rng, store, kept = random.Random(seed), ox.Store(), MergedCopy()
    store.extend(quad(rng, 3) for _ in range(12))
    for step in range(60):
        removed = [q for q in store if rng.random() < 0.2]
        added = [q for q in (quad(rng, 3 + step // 10) for _ in range(4)) if q not in store]
        dropped = [ox.NamedNode("urn:g:1")] if rng.random() < 0.05 else []
        change = encode_change(removed, added, [], dropped)
        for _ in range(rng.choice((1, 1, 2))):  # a reader may be sent what it has already
            apply_change(store, change, kept)
        graphs = [g for g in store.named_graphs() if g != LEFT_OUT]
        expected = {(str(q.subject), str(q.object)) for q in store if q.graph_name != LEFT_OUT}
        answer = rows(store, graphs, kept)
        assert len(answer) == len(expected)
        assert answer == rows(store, graphs, None)
        # another choice is not served from the copy of the first
        assert rows(store, graphs[1:], kept) == rows(store, graphs[1:], None)


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", ontologies=False) as opened:
        for robot in ("nao-1", "nao-2"):
            opened.update("INSERT DATA { <urn:s> <urn:p> 1 }", agent=robot)
        yield opened


def test_asserted_statements_of_a_reader_follow_commits_and_new_graphs(kb: KnowledgeBase) -> None:
    text = "SELECT ?o { <urn:s> <urn:p> ?o } ORDER BY ?o"

    def asserted() -> list[object]:
        return [row.value("o") for row in kb.select(text, inferred=False, timeout_s=60.0)]

    assert asserted() == [1]
    kb.update("DELETE DATA { <urn:s> <urn:p> 1 }", agent="nao-1")
    assert asserted() == [1]
    kb.update("INSERT DATA { <urn:s> <urn:p> 2 }", agent="nao-3")
    assert asserted() == [1, 2]
    kb.update("DELETE DATA { <urn:s> <urn:p> 1 }", agent="nao-2")
    assert asserted() == [2]


def test_a_copy_is_made_once_however_many_commits_follow(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    merged = merged_graphs._merged

    def counted(*given: object) -> ox.Store:
        made.append(1)
        return merged(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(merged_graphs, "_merged", counted)
    store, kept = ox.Store(), MergedCopy()
    graphs = [ox.NamedNode("urn:g:1"), ox.NamedNode("urn:g:2")]
    for number in range(5):
        s, p = ox.NamedNode("urn:s"), ox.NamedNode("urn:p")
        added = [ox.Quad(s, p, ox.Literal(number), graph) for graph in graphs]
        apply_change(store, encode_change([], added, [], []), kept)
        assert len(rows(store, graphs, kept)) == number + 1
    assert len(made) == 1


def in_process(kb: KnowledgeBase, text: str) -> list[str]:
    """Return an answer from the asserted graphs, in the order of its text."""
    return sorted(str(row) for row in kb.query(text, inferred=False))


@pytest.mark.parametrize("folder", [None, "kb"])
def test_the_copy_of_the_programs_own_process_follows_each_kind_of_change(
    folder: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[ox.Store] = []
    copying = merged_graphs._merged

    def counted(*args: Any) -> ox.Store:
        made.append(copying(*args))
        return made[-1]

    monkeypatch.setattr(merged_graphs, "_merged", counted)
    file = tmp_path / "more.ttl"
    file.write_text("<urn:s:9> <urn:p> <urn:o:9> .", encoding="utf-8")
    rng = random.Random(3)
    with rtask.open(":memory:" if folder is None else tmp_path / folder, ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:p> a <http://www.w3.org/2002/07/owl#SymmetricProperty> }")
        kb.update(
            "INSERT DATA { <urn:s:1> <urn:p> <urn:o:1> }"
        )  # from here on there is an inferred graph
        in_process(kb, ALL)
        changes: list[Callable[[], object]] = [
            lambda: kb.update(f"INSERT DATA {{ {triple(rng)} }}", "nao-1"),
            lambda: kb.update(f"INSERT DATA {{ {triple(rng)} }}", "nao-2"),
            lambda: kb.update(f"DELETE DATA {{ {triple(rng)} }}"),
            lambda: kb.update("DELETE WHERE { <urn:s:1> ?p ?o }"),
            lambda: kb.load(file, graph="urn:g:loaded"),
            lambda: kb.update("DROP GRAPH <urn:g:loaded>"),
        ]
        copies = len(made)
        for _ in range(12):
            for change in rng.sample(changes[:4], 2):
                change()
            assert in_process(kb, ALL) == fresh(kb)
        assert len(made) == copies, "commits are followed; nothing is copied again"
        for change in changes[4:]:
            change()
            assert in_process(kb, ALL) == fresh(kb)


def triple(rng: random.Random) -> str:
    return f"<urn:s:{rng.randrange(3)}> <urn:p> <urn:o:{rng.randrange(3)}>"


def fresh(kb: KnowledgeBase) -> list[str]:
    """Return the answer to ``ALL`` from each asserted statement, read one by one."""
    apart = {kb.graphs.inferred, kb.graphs.meta, kb.graphs.provenance}
    quads = {
        (quad.subject, quad.object)
        for quad in kb.store.quads_for_pattern(None, ox.NamedNode("urn:p"), None, None)
        if quad.graph_name not in apart and isinstance(quad.graph_name, ox.NamedNode)
    }
    return sorted(f"Row(s={s}, o={o})" for s, o in quads)
