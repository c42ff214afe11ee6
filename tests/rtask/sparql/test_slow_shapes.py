"""Memory of queries that were slow."""

from __future__ import annotations

from rtask.sparql.slow_shapes import FORGOTTEN_AFTER_S, SlowShapes


def test_queries_of_one_shape_are_remembered_for_a_while() -> None:
    now = [0.0]
    slow = SlowShapes(clock=lambda: now[0])
    slow.note("ASK { <urn:a> <urn:p>+ ?o }")
    assert "ASK { <urn:b> <urn:q>+ ?o }" in slow
    assert "ASK { <urn:b> <urn:q>* ?o }" not in slow
    now[0] = FORGOTTEN_AFTER_S
    assert "ASK { <urn:a> <urn:p>+ ?o }" not in slow
