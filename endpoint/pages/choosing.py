"""Patterns that select the objects of a list, built from checked terms."""

from __future__ import annotations

from collections.abc import Iterable

from endpoint.pages.render import embedded_graph, knowledge_base
from rtask.asking.terms import Reader, reader_of
from rtask.engine.terms import folded
from rtask.errors import DataError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import NamedNode, iri, literal

__all__ = ["by_iri", "by_words", "read_resource", "unnamed", "without"]

MAX_WORDS = 8
_NAMED = "{ ?object rt:name ?said } UNION { ?object a/(rdfs:label|skos:altLabel) ?said }"


def read_resource(text: str) -> NamedNode:
    """Return what a text in an address names, in any form that a page or a command prints.

    Of a graph that is stored elsewhere, names in quotes are not known.

    Raises
    ------
    DataError, UnknownTermError
        It is no term, or nothing has that name.
    """
    kb = knowledge_base()
    reader = reader_of(kb) if isinstance(kb, KnowledgeBase) else Reader(kb.base)
    try:
        return reader.resource(text)
    except UsageError as error:
        raise DataError(str(error)) from error


def by_iri(names: Iterable[str]) -> str:
    """Return the pattern that selects objects by IRI.

    Examples
    --------
    >>> by_iri(["urn:a", "urn:b"])
    'VALUES ?object { <urn:a> <urn:b> }'
    """
    return f"VALUES ?object {{ {' '.join(str(iri(name)) for name in names)} }}"


def by_words(text: str) -> str:
    """Return the pattern that selects objects whose name or kind contains all words.

    Examples
    --------
    >>> by_words("Blue  mug").count("CONTAINS"), by_words("")
    (2, '')
    """
    words = folded(text).split()[:MAX_WORDS]
    return " ".join(
        f"FILTER EXISTS {{ {_NAMED} FILTER(CONTAINS(LCASE(STR(?said)), {literal(word)})) }}"
        for word in words
    )


def without(name: str) -> str:
    """Return the pattern that excludes one object.

    Examples
    --------
    >>> without("urn:a")
    'FILTER(?object != <urn:a>)'
    """
    return f"FILTER(?object != {iri(name)})"


def unnamed() -> str:
    """Return the pattern that selects objects whose kind nobody has stated; guesses do not count.

    Inferred kinds do not count either, since they follow from the guess.
    """
    return f"""FILTER EXISTS {{ ?object rt:objectId ?id }}
FILTER NOT EXISTS {{
  GRAPH ?where {{ ?object a ?kind }}
  ?kind rdfs:subClassOf rt:ManipulableObject
  FILTER(?where != {embedded_graph().graphs.inferred} && ?kind != rt:ManipulableObject)
  FILTER NOT EXISTS {{ ?guess rdf:reifies <<( ?object a ?kind )>> ; rt:confidence ?sure }}
}}"""
