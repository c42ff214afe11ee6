"""The Berlin SPARQL Benchmark's explore mix: the knowledge base answers as the bare store does."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any

import pyoxigraph as ox
import pytest

import rtask
from tests.benchmarks.kb.bsbm import Shop
from tests.benchmarks.kb.bsbm_queries import MIX, QUERIES, Question, mixes

PRODUCTS, MIXES = 30, 3


@pytest.fixture(scope="module")
def shop() -> Shop:
    return Shop(PRODUCTS)


@pytest.fixture(scope="module")
def text(shop: Shop) -> str:
    return "".join(shop.lines())


@pytest.fixture(scope="module")
def questions(shop: Shop, text: str) -> list[Question]:
    return [question for mix in itertools.islice(mixes(shop), MIXES) for question in mix]


@pytest.fixture(scope="module")
def kb(text: str) -> Iterator[rtask.KnowledgeBase]:
    with rtask.open(":memory:") as kb:
        kb.load(text.encode(), format="nt", graph="urn:bsbm")
        yield kb


@pytest.mark.slow
def test_the_ontology_and_reasoning_change_no_answer(kb, text, questions):
    bare = ox.Store()
    bare.bulk_load(text.encode(), format=ox.RdfFormat.N_TRIPLES)
    answered = set()
    for question in questions:
        expected = _answer(bare.query(question.text))
        assert _answer(kb.query(question.text)) == expected, question.text
        if expected:
            answered.add(question.number)
    assert answered >= {1, 2, 7, 8, 9, 10, 11, 12}  # 3 to 5 need more products to match any


def test_the_draw_is_the_same_every_time(text):
    assert text == "".join(Shop(PRODUCTS).lines())
    assert text != "".join(Shop(PRODUCTS, seed=1).lines())


def test_a_mix_has_the_published_queries(questions):
    assert [question.number for question in questions] == list(MIX) * MIXES
    assert set(MIX) == set(QUERIES)


def test_products_have_types_and_features_of_one_branch(shop, text):
    graph = ox.Store()
    graph.bulk_load(text.encode(), format=ox.RdfFormat.N_TRIPLES)
    kinds = {kind.iri: kind for kind in shop.types}
    for product in shop.products:
        types = _objects(graph, product, "http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
        leaf = max((kinds[iri] for iri in types & kinds.keys()), key=lambda kind: kind.depth)
        assert types >= {kind.iri for kind in leaf.lineage()}
        features = _objects(
            graph,
            product,
            "http://www4.wiwiss.fu-berlin.de/bizer/bsbm/v01/vocabulary/productFeature",
        )
        assert features <= set(leaf.all_features())


def _answer(found: Iterable[Any]) -> list[list[str]]:
    """Return rows or statements, sorted."""
    return sorted([str(term) for term in row] for row in found)


def _objects(graph: ox.Store, subject: str, predicate: str) -> set[str]:
    pattern = graph.quads_for_pattern(ox.NamedNode(subject), ox.NamedNode(predicate), None)
    return {quad.object.value for quad in pattern}
