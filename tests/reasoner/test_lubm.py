"""LUBM: the answers that follow from the numbers drawn, and those of another engine."""

from __future__ import annotations

import pyoxigraph as ox
import pytest

from reasoner import Closure
from tests.benchmarks.reasoner import rivals
from tests.benchmarks.reasoner.lubm import QUERIES, Generator, query, schema


def rows(triples) -> dict[int, frozenset[tuple[str, ...]]]:
    store = ox.Store()
    store.extend(ox.Quad(*triple) for triple in triples)
    return {
        n: frozenset(tuple(str(x) for x in row) for row in store.query(query(n))) for n in QUERIES
    }


@pytest.fixture(scope="module")
def department():
    generator = Generator()
    data = list(generator.university(0, departments=1))
    return generator, [*schema(), *data]


def test_answers_are_those_that_were_drawn(department):
    generator, triples = department
    closure = Closure.build(triples, [])
    found = rows([*triples, *closure.inferred()])
    assert {n: len(found[n]) for n in generator.counts.answers} == generator.counts.answers
    assert all(found[n] for n in QUERIES if n not in (2, 13))


@pytest.mark.deep
@pytest.mark.slow
def test_answers_are_those_of_another_engine(department):
    pytest.importorskip("owlrl", reason="owlrl is not installed")
    _, triples = department
    closure = Closure.build(triples, [])
    peer = rivals.closed(rivals.owlrl, triples, 240)
    assert not peer.failure
    assert rows(peer.triples) == rows([*triples, *closure.inferred()])


def test_the_generator_draws_the_same_every_time():
    first, second = (list(Generator(7).university(0, departments=1)) for _ in range(2))
    assert first == second
    assert first != list(Generator(8).university(0, departments=1))
