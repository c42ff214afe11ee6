"""Turtle in, triples out, with the prefixes that these tests use."""

from __future__ import annotations

import pyoxigraph as ox

PREFIXES = """
@prefix : <urn:t:> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""


def triples(text: str) -> list:
    """Parse Turtle; blank nodes keep their labels."""
    quads = ox.parse(PREFIXES + text, format=ox.RdfFormat.TURTLE)
    return [(q.subject, q.predicate, q.object) for q in quads]


def triple(text: str) -> tuple:
    """Parse one triple."""
    (found,) = triples(text + " .")
    return found
