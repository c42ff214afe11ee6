"""The union of all graphs: kept exactly, or computed by each query."""

from __future__ import annotations

from pathlib import Path

import pytest

import rtask
from rtask.errors import StoreFormatError, UsageError
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s <urn:p> ?o }"


def _count(kb: KnowledgeBase) -> object:
    return kb.select(_COUNT)[0].value("n")


def _open(target: Path | str, union: str | None = None) -> KnowledgeBase:
    return rtask.open(target, union=union, ontologies=False)


@pytest.mark.parametrize(("union", "counted"), [(None, 1), ("merged", 1), ("view", 2)])
def test_a_triple_of_two_graphs_is_counted_once_unless_the_union_is_a_view(
    union: str | None, counted: int
) -> None:
    with _open(":memory:", union) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-2")
        assert _count(kb) == counted
        assert kb.select(_COUNT, timeout_s=20.0)[0].value("n") == counted
        assert len(kb.select("SELECT DISTINCT ?s ?o { ?s <urn:p> ?o }")) == 1
        stats = kb.stats()
        assert stats["shared"] == 1
        graph = kb.graphs.agent("nao-1").value
        assert len(kb.select(f"SELECT * FROM <{graph}> {{ ?s <urn:p> ?o }}")) == 1
        assert kb.verify() == []


@pytest.mark.parametrize("copies", [600, 6_000], ids=["stored at once", "stored in two steps"])
def test_the_first_statements_of_all_are_counted_once_too_and_in_no_record(copies: int) -> None:
    """A union that held nothing is filled without looking anything up."""
    one, two = (
        f"GRAPH <urn:g{graph}> {{ {' . '.join(f'<urn:a> <urn:p> {n}' for n in range(copies))} }}"
        for graph in (1, 2)
    )
    with _open(":memory:") as kb:
        commit = kb.update(f"INSERT DATA {{ {one} {two} }}", access=Access(None, "admin"))
        assert (commit.added, _count(kb)) == (2 * copies, copies)
        assert kb.verify() == []
        kb.update("DELETE DATA { GRAPH <urn:g1> { <urn:a> <urn:p> 0 , 1 } }")
        kb.update("DELETE DATA { GRAPH <urn:g2> { <urn:a> <urn:p> 1 } }")
        assert _count(kb) == copies - 1
        assert kb.verify() == []


@pytest.mark.parametrize("total", [6, 200])
def test_what_goes_stays_in_the_union_and_in_what_follows_while_another_graph_holds_it(
    total: int,
) -> None:
    def told(numbers: range) -> str:
        return f"DATA {{ <urn:a> <urn:p> {' , '.join(map(str, numbers))} }}"

    with _open(":memory:") as kb:
        kb.update(
            "PREFIX s: <http://www.w3.org/2000/01/rdf-schema#> "
            "INSERT DATA { <urn:p> s:subPropertyOf <urn:q> }"
        )
        kb.update(f"INSERT {told(range(total))}", "nao-1")
        kb.update(f"INSERT {told(range(2))}", "nao-2")
        kb.update(f"DELETE {told(range(5))}", "nao-1")
        left = sorted([0, 1, *range(5, total)])
        for name in ("p", "q"):
            rows = kb.select(f"SELECT ?o {{ <urn:a> <urn:{name}> ?o }}")
            assert sorted(int(row["o"].value) for row in rows) == left
        assert kb.verify() == []


def test_the_union_is_chosen_once(tmp_path: Path) -> None:
    _open(tmp_path / "a", "view").close()
    with _open(tmp_path / "a") as kb:
        assert kb.store.is_view
    with pytest.raises(StoreFormatError, match="made with union='view', not 'merged'"):
        _open(tmp_path / "a", "merged")
    with pytest.raises(UsageError, match="one of merged, view"):
        _open(tmp_path / "b", "both")


def test_both_unions_give_the_same_after_the_same_writes(tmp_path: Path) -> None:
    kept = []
    for union in ("merged", "view"):
        with _open(tmp_path / union, union) as kb:
            kb.update(
                "PREFIX s: <http://www.w3.org/2000/01/rdf-schema#> "
                "INSERT DATA { <urn:Mug> s:subClassOf <urn:Cup> }"
            )
            kb.update("INSERT DATA { <urn:a> a <urn:Mug> ; <urn:p> 1 }", "nao-1")
            kb.update(
                "INSERT DATA { <urn:b> <urn:p> 1 } ; "
                "INSERT { ?s <urn:q> ?o } WHERE { ?s <urn:p> ?o } ; "
                "DELETE { ?s <urn:p> ?o } INSERT { ?s <urn:r> ?n } "
                "WHERE { ?s <urn:q> ?o BIND(?o + 1 AS ?n) }",
                "nao-1",
            )
            kb.update("DELETE WHERE { <urn:b> ?p ?o }", "nao-1")
            rows = kb.select(
                "SELECT DISTINCT ?s ?p ?o { ?s ?p ?o FILTER(STRSTARTS(STR(?s), 'urn:')) }"
            )
            kept.append({tuple(map(str, row)) for row in rows})
            assert kb.verify() == []
        with _open(tmp_path / union) as kb:
            assert kb.query("ASK { <urn:a> a <urn:Cup> }") is True
    assert kept[0] == kept[1]
    assert len(kept[0]) > 4
