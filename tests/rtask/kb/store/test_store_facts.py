"""Properties of the store that the knowledge base relies on; a change of one fails here."""

from __future__ import annotations

import threading
from pathlib import Path

import pyoxigraph as ox
import pytest

from rtask.kb.store.embedded import EmbeddedStore

_XSD = "http://www.w3.org/2001/XMLSchema#"


def _quad(number: int = 1, graph: str = "urn:g") -> ox.Quad:
    value = ox.Literal(number)
    return ox.Quad(ox.NamedNode("urn:s"), ox.NamedNode("urn:p"), value, ox.NamedNode(graph))


def test_a_folder_is_opened_for_writing_once(tmp_path: Path) -> None:
    store = ox.Store(tmp_path)
    with pytest.raises(OSError, match="lock"):
        ox.Store(tmp_path)
    del store
    ox.Store(tmp_path)


def test_a_backup_is_complete_and_refuses_an_existing_folder(tmp_path: Path) -> None:
    store = ox.Store(tmp_path / "store")
    store.add(_quad())
    store.backup(tmp_path / "copy")
    store.add(_quad(2))
    assert list(ox.Store.read_only(str(tmp_path / "copy"))) == [_quad()]
    with pytest.raises(RuntimeError, match="exists"):
        store.backup(tmp_path / "copy")


def test_an_update_that_fails_at_its_end_leaves_nothing() -> None:
    store = ox.Store()
    text = "INSERT DATA { <urn:a> <urn:p> 1 } ; CREATE GRAPH <urn:g> ; CREATE GRAPH <urn:g>"
    with pytest.raises(RuntimeError, match="already exists"):
        store.update(text)
    assert len(store) == 0
    assert list(store.named_graphs()) == []


def test_extend_that_fails_half_way_leaves_nothing() -> None:
    def quads() -> object:
        yield _quad()
        raise ValueError("no more")

    for extend in (ox.Store.extend, ox.Store.bulk_extend):
        store = ox.Store()
        with pytest.raises(ValueError, match="no more"):
            extend(store, quads())  # type: ignore[arg-type]
        assert len(store) == 0


def test_insert_data_renames_blank_nodes_and_extend_keeps_them() -> None:
    store, node = ox.Store(), ox.BlankNode("n")
    store.update("INSERT DATA { _:n <urn:p> 1 }")
    assert next(iter(store)).subject != node
    quad = ox.Quad(node, ox.NamedNode("urn:p"), ox.Literal(2))
    store.extend([quad])
    assert quad in store


@pytest.mark.parametrize(
    ("written", "datatype", "kept", "kept_type"),
    [
        ("01", "integer", "1", "integer"),
        ("1", "int", "1", "integer"),
        ("1", "nonNegativeInteger", "1", "integer"),
        ("2.50", "decimal", "2.5", "decimal"),
        ("1e3", "double", "1000", "double"),
        ("1", "boolean", "true", "boolean"),
        ("PT60S", "duration", "PT1M", "duration"),
        ("2026-01-01T00:00:00.000Z", "dateTime", "2026-01-01T00:00:00Z", "dateTime"),
        ("abc", "integer", "abc", "integer"),
    ],
)
def test_literals_are_normalised(written: str, datatype: str, kept: str, kept_type: str) -> None:
    store = ox.Store()
    value = ox.Literal(written, datatype=ox.NamedNode(_XSD + datatype))
    quad = ox.Quad(ox.NamedNode("urn:s"), ox.NamedNode("urn:p"), value)
    store.add(quad)
    assert next(iter(store)).object == ox.Literal(kept, datatype=ox.NamedNode(_XSD + kept_type))
    assert quad in store


def test_the_union_flag_counts_a_triple_once_for_each_graph() -> None:
    store = ox.Store()
    store.extend([_quad(graph="urn:g"), _quad(graph="urn:h")])
    rows = store.query("SELECT * { ?s ?p ?o }", use_default_graph_as_union=True)
    assert len(list(rows)) == 2  # type: ignore[arg-type]


def test_a_default_graph_given_wins_over_from() -> None:
    store = ox.Store()
    store.extend([_quad(1, "urn:g"), _quad(2, "urn:h")])
    text = "SELECT ?o FROM <urn:g> { ?s ?p ?o }"
    for graph, found in ((None, "1"), (ox.NamedNode("urn:h"), "2")):
        rows = list(store.query(text, default_graph=graph))  # type: ignore[arg-type]
        assert [row["o"].value for row in rows] == [found]


def test_rows_already_read_may_travel_between_threads() -> None:
    store = ox.Store()
    store.add(_quad())
    rows = [tuple(row) for row in store.query("SELECT * { ?s ?p ?o }")]  # type: ignore[union-attr]
    seen: list[object] = []
    thread = threading.Thread(target=lambda: seen.extend(rows))
    thread.start()
    thread.join()
    assert seen == rows


def test_triple_terms_pass_through_n_quads() -> None:
    inner = ox.Triple(ox.NamedNode("urn:a"), ox.NamedNode("urn:b"), ox.BlankNode("n"))
    quad = ox.Quad(ox.NamedNode("urn:s"), ox.NamedNode("urn:p"), inner, ox.NamedNode("urn:g"))
    text = ox.serialize([quad], format=ox.RdfFormat.N_QUADS)
    assert list(ox.parse(text, format=ox.RdfFormat.N_QUADS)) == [quad]


def _numbers(store: ox.Store | EmbeddedStore, number: int) -> list[int]:
    pattern = (ox.NamedNode("urn:s"), ox.NamedNode("urn:p"), ox.Literal(number))
    return sorted(int(quad.object.value) for quad in store.quads_for_pattern(*pattern))


def test_a_pattern_with_a_number_yields_that_number_only(tmp_path: Path) -> None:
    """The store on disk reads past numbers whose last byte is 255; ours does not."""
    store = ox.Store(tmp_path)
    store.extend(_quad(number) for number in range(250, 520))
    assert _numbers(store, 255) == list(range(255, 511))
    ours = EmbeddedStore(store)
    for number in (250, 255, 256, 511):
        assert _numbers(ours, number) == [number]
    written_otherwise = ox.Literal("0255", datatype=ox.NamedNode(_XSD + "integer"))
    [quad] = ours.quads_for_pattern(None, None, written_otherwise)
    assert quad.object == ox.Literal(255)
