"""The W3C's update evaluation cases, through the computed delta instead of the store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyoxigraph as ox
import pytest

import rtask
from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import stored_quad
from rtask.sparql.syntax import check_update
from rtask.sparql.update_outline import read_update

_CASES = """
PREFIX mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#>
PREFIX ut: <http://www.w3.org/2009/sparql/tests/test-update#>
SELECT ?case ?action ?result ?request {
  ?case a mf:UpdateEvaluationTest ; mf:action ?action ; mf:result ?result .
  ?action ut:request ?request .
} ORDER BY ?case
"""
_SYNTAX = """
PREFIX mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#>
SELECT ?case ?file ?good {
  VALUES (?kind ?good) {
    (mf:PositiveUpdateSyntaxTest11 true) (mf:NegativeUpdateSyntaxTest11 false)
  }
  ?case a ?kind ; mf:action ?file .
} ORDER BY ?case
"""
_GRAPHS = """
PREFIX ut: <http://www.w3.org/2009/sparql/tests/test-update#>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
SELECT ?side ?file ?name {
  { ?side ut:data ?file } UNION { ?side ut:graphData [ ut:graph ?file ; rdfs:label ?name ] }
}
"""


def _manifests(folder: Path) -> ox.Store:
    store = ox.Store()
    for manifest in sorted((folder / "sparql11").glob("*/manifest.ttl")):
        store.load(path=manifest, format=ox.RdfFormat.TURTLE, base_iri=manifest.as_uri())
    return store


def _quads(store: ox.Store, side: Any) -> list[ox.Quad]:
    found = []
    for row in store.query(_GRAPHS, substitutions={ox.Variable("side"): side}):  # type: ignore[union-attr]
        path = Path(row["file"].value.removeprefix("file://"))
        graph = ox.NamedNode(row["name"].value) if row["name"] else ox.DefaultGraph()
        for quad in ox.parse(path=path, base_iri=path.as_uri(), rename_blank_nodes=True):
            found.append(ox.Quad(quad.subject, quad.predicate, quad.object, graph))
    return found


def _canonical(quads: list[ox.Quad]) -> set[str]:
    dataset = ox.Dataset(map(stored_quad, quads))
    dataset.canonicalize(ox.CanonicalizationAlgorithm.UNSTABLE)
    return set(map(str, dataset))


def test_every_update_case_gives_the_expected_dataset(
    conformance_dir: Path, subtests: pytest.Subtests
) -> None:
    manifests = _manifests(conformance_dir)
    cases = list(manifests.query(_CASES))  # type: ignore[arg-type]
    assert len(cases) == 94
    for row in cases:
        path = Path(row["request"].value.removeprefix("file://"))
        with (
            subtests.test(case=row["case"].value.rpartition("/")[2]),
            rtask.open(":memory:", plain=True) as kb,
        ):
            with kb.transaction() as tx:
                tx.add_quads(_quads(manifests, row["action"]))
            kb.update(path.read_text("utf-8"), base=path.as_uri())
            expected = _quads(manifests, row["result"])
            assert _canonical(kb.match()) == _canonical(expected)


def test_every_syntax_case_is_taken_or_refused(
    conformance_dir: Path, subtests: pytest.Subtests
) -> None:
    cases = list(_manifests(conformance_dir).query(_SYNTAX))  # type: ignore[arg-type]
    assert len(cases) == 55
    for row in cases:
        path = Path(row["file"].value.removeprefix("file://"))
        with subtests.test(case=row["case"].value.rpartition("/")[2]):
            taken = True
            try:
                check_update(read_update(path.read_text("utf-8")), path.as_uri())
            except QuerySyntaxError:
                taken = False
            assert taken == (row["good"].value == "true")
