"""Tools that look things up: by words, and by term."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain, islice

from pydantic import Field
from pyoxigraph import DefaultGraph, Quad

import ontology
from rtask.asking.cards import card_of
from rtask.asking.tools.declaration import Asked, Paged, PagedAnswer, rest, tool
from rtask.asking.tools.values import Fact, Value
from rtask.errors import UnknownTermError
from rtask.rdf.terms import RDF_TYPE, Literal, NamedNode, TripleKey, triple_key
from rtask.wire.message import Answer
from rtask.wire.types import Text

__all__ = ["describe", "search"]

MAX_HITS = 100
MAX_FACTS = 100
MAX_OWN = 10_000
_RDFS = ontology.PREFIXES["rdfs"]
_OWL = ontology.PREFIXES["owl"]
_CLASSES = {NamedNode(_OWL + "Class"), NamedNode(_RDFS + "Class")}
_PROPERTIES = {
    NamedNode(_OWL + name) for name in ("ObjectProperty", "DatatypeProperty", "AnnotationProperty")
}


class Search(Paged):
    """Words to look for."""

    words: Text
    """all must occur; cup* matches any ending"""
    kind: Text | None = None
    """class, such as rt:Mug"""


class Hit(Answer):
    """Something with a text that has the words."""

    iri: str
    text: Value


class Hits(PagedAnswer):
    """What was found, best first."""

    hits: list[Hit]


class Describe(Paged):
    """A term to describe."""

    term: Text
    """IRI or name: kb:object/7, rt:Mug, red mug"""


class Description(PagedAnswer):
    """What the graph states about a term, and about others by it."""

    term: str
    kind: str
    """class, property, graph, thing or unknown"""
    count: int
    """instances of a class, uses of a property"""
    example: str = ""
    """a query with a class or property"""
    facts: list[Fact] = Field(default_factory=list)


@tool(
    "Find things, classes and properties by words in names, labels, comments and print.",
    {"words": "red mug"},
    {"words": "grasp*", "kind": "owl:Class"},
    entries=("hits",),
)
def search(asked: Asked, request: Search) -> Hits:
    """Return what has all words in a text."""
    kb, terms = asked.kb, asked.terms
    kind = None if request.kind is None else asked.resource(request.kind)
    commit = kb.seq
    end = request.offset + MAX_HITS
    matches = kb.search(request.words, cls=kind, limit=end + 1)
    hits = []
    for hit in matches[request.offset : end]:
        text = Literal(hit.text, language=hit.language)
        quads = kb.match(hit.bearer, hit.predicate, text)
        by = terms.authors(quad.graph_name for quad in quads)
        value = terms.value(text, by)
        hits.append(Hit(iri=terms.short(hit.subject), text=value))
    return Hits(commit=commit, hits=hits, **rest(end, len(matches) - end))


@tool(
    "Describe a thing, class or property: all statements about it, with authors and proofs.",
    {"term": "kb:object/7"},
    {"term": "rt:hasGrasp"},
    entries=("facts",),
)
def describe(asked: Asked, request: Describe) -> Description:
    """Return the statements about a term, then those that have it as their object."""
    kb, term = asked.kb, asked.resource(request.term)
    commit = kb.seq
    end = request.offset + MAX_FACTS
    triples = list(islice(_statements(asked, term, end + 1), end + 1))
    kind = _kind(asked, term, bool(triples))
    return Description(
        commit=commit,
        term=asked.terms.short(term),
        kind=kind,
        count=_count(asked, term, kind),
        example=_example(asked, term, kind),
        facts=[asked.terms.fact(triple, about=term) for triple in triples[request.offset : end]],
        **rest(end, len(triples) - end),
    )


def _statements(asked: Asked, term: NamedNode, most: int) -> Iterator[TripleKey]:
    """Yield each statement once: what was asserted about a term, what follows, what names it.

    Of what is stated about it, at least ``most`` are read, which are sorted by their property.
    """
    kb = asked.kb
    quads = kb.store.quads_for_pattern
    own = sorted(
        islice(quads(term, None, None, None), max(MAX_OWN, most)),
        key=lambda quad: (quad.graph_name == kb.graphs.inferred, str(quad.predicate)),
    )
    around = quads(None, None, term, None)
    seen: set[TripleKey] = set()
    for quad in _readable(asked, chain(own, around)):
        triple = triple_key(quad)
        if triple not in seen:
            seen.add(triple)
            yield triple


def _readable(asked: Asked, quads: Iterable[Quad]) -> Iterator[Quad]:
    """Yield statements of named graphs, without the records of commits and those in quarantine."""
    graphs = asked.kb.graphs
    left_out = {graphs.meta, graphs.provenance, graphs.quarantine}
    for quad in quads:
        graph = quad.graph_name
        if (not isinstance(graph, DefaultGraph) or asked.kb.plain) and graph not in left_out:
            yield quad


def _kind(asked: Asked, term: NamedNode, is_mentioned: bool) -> str:
    quads = asked.kb.store.quads_for_pattern
    types = {quad.object for quad in asked.kb.match(term, RDF_TYPE)}
    if types & _CLASSES:
        return "class"
    # A predicate that nothing declares is a property, too, and not unknown.
    if types & _PROPERTIES or any(_readable(asked, quads(None, term, None, None))):
        return "property"
    if term in asked.kb.store.named_graphs():
        return "graph"
    return "thing" if is_mentioned else "unknown"


def _example(asked: Asked, term: NamedNode, kind: str) -> str:
    """Return a query with a class or property; empty for a predicate that nothing declares."""
    if kind not in ("class", "property"):
        return ""
    try:
        return card_of(asked.kb.select, term).example
    except UnknownTermError:
        return ""


def _count(asked: Asked, term: NamedNode, kind: str) -> int:
    if kind not in ("class", "property"):
        return 0
    pattern = f"?s a {term}" if kind == "class" else f"?s {term} ?o"
    row = asked.kb.select(f"SELECT (COUNT(DISTINCT ?s) AS ?n) {{ {pattern} }}")[0]
    return int(str(row.value("n")))
