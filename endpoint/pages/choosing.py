"""Which objects a list shows: patterns for the query about objects, made of checked terms."""

from __future__ import annotations

from collections.abc import Iterable

from endpoint.pages.render import knowledge_base
from rtask.engine.terms import folded
from rtask.rdf.terms import iri, literal

__all__ = ["by_iri", "by_words", "unnamed", "without"]

_MOST_WORDS = 8
_NAMED = "{ ?object rt:name ?said } UNION { ?object a/(rdfs:label|skos:altLabel) ?said }"


def by_iri(names: Iterable[str]) -> str:
    """Return the pattern of some objects.

    Examples
    --------
    >>> by_iri(["urn:a", "urn:b"])
    'VALUES ?object { <urn:a> <urn:b> }'
    """
    return f"VALUES ?object {{ {' '.join(str(iri(name)) for name in names)} }}"


def by_words(text: str) -> str:
    """Return the pattern of objects in whose names or kinds all words occur.

    Examples
    --------
    >>> by_words("Blue  mug").count("CONTAINS"), by_words("")
    (2, '')
    """
    words = folded(text).split()[:_MOST_WORDS]
    return " ".join(
        f"FILTER EXISTS {{ {_NAMED} FILTER(CONTAINS(LCASE(STR(?said)), {literal(word)})) }}"
        for word in words
    )


def without(name: str) -> str:
    """Return the pattern that leaves one object out.

    Examples
    --------
    >>> without("urn:a")
    'FILTER(?object != <urn:a>)'
    """
    return f"FILTER(?object != {iri(name)})"


def unnamed() -> str:
    """Return the pattern of objects of which nobody said what kind they are; a guess says nothing.

    Only what is stated counts: what the reasoner concludes follows from the guess.
    """
    return f"""FILTER EXISTS {{ ?object rt:objectId ?id }}
FILTER NOT EXISTS {{
  GRAPH ?where {{ ?object a ?kind }}
  ?kind rdfs:subClassOf rt:ManipulableObject
  FILTER(?where != {knowledge_base().graphs.inferred} && ?kind != rt:ManipulableObject)
  FILTER NOT EXISTS {{ ?guess rdf:reifies <<( ?object a ?kind )>> ; rt:confidence ?sure }}
}}"""
