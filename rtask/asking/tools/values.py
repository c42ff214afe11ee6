"""Terms as agents get them: typed, in the forms that every tool takes back, with their authors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import islice
from typing import Any
from urllib.parse import quote

from pydantic import Field

import ontology
from rtask.kb.core import GraphCore
from rtask.kb.store.naming import prefixed
from rtask.rdf.terms import (
    XSD,
    BlankNode,
    DefaultGraph,
    GraphName,
    Literal,
    NamedNode,
    Term,
    Triple,
    TripleKey,
    python_value,
)
from rtask.wire.message import Answer

__all__ = ["Fact", "Terms", "Value"]

MAX_TEXT = 300
"""Characters of a text or an IRI; the rest is left out, and how much that is."""
MAX_AUTHORS = 3
_LOOKED_AT = 50
_TIMES = {XSD + name for name in ("dateTime", "date", "time", "duration", "dayTimeDuration")}
_TEXTS = {XSD + "string", ontology.PREFIXES["rdf"] + "langString"}


class Value(Answer):
    """One term: what was stored as a text is quoted, and names who wrote it."""

    type: str
    """iri, text, number, boolean, time, literal, statement or anonymous"""
    value: Any
    by: list[str] = Field(default_factory=list)
    lang: str = ""
    datatype: str = ""
    cut: int = 0
    """characters left out"""
    why: str = ""
    """page of what a number rests on"""


class Fact(Answer):
    """A statement with its authors and the address of its proof."""

    p: str
    o: Value
    by: list[str]
    proof: str
    s: Value | None = None
    """left out where it is what the answer is about"""


class Terms:
    """Writes terms of one graph for agents.

    Parameters
    ----------
    kb
        The graph.
    site
        Beginning of the addresses of proofs.
    """

    def __init__(self, kb: GraphCore, site: str) -> None:
        self._kb = kb
        self._site = site

    def short(self, term: Term) -> str:
        """Return a term in the form that commands print and read."""
        return prefixed(term, self._kb.base)

    def value(self, term: Term, by: Iterable[str] | None = None) -> Value:
        """Return a term; of a text whose authors are not given, the graphs tell them."""
        if isinstance(term, NamedNode):
            return _cut("iri", self.short(term))
        if isinstance(term, BlankNode):
            return Value(type="anonymous", value=str(term))
        if isinstance(term, Triple):
            return _cut("statement", self.short(term))
        kind = term.datatype.value
        if kind in _TEXTS:
            authors = self.authors_of(term) if by is None else list(by)
            return self.text(term.value, authors, term.language or "")
        plain = python_value(term)
        if isinstance(plain, bool):
            return Value(type="boolean", value=plain)
        if isinstance(plain, int | float) and math.isfinite(plain):
            return Value(type="number", value=plain)
        if kind in _TIMES:
            return _cut("time", term.value)
        return _cut("literal", term.value, datatype=self.short(term.datatype))

    def text(self, text: str, by: Iterable[str], lang: str = "") -> Value:
        """Return a text that somebody wrote."""
        return _cut("text", text, by=_listed(list(by)), **({"lang": lang} if lang else {}))

    def authors_of(self, text: Literal) -> list[str]:
        """Return who stored a text, wherever it stands; nobody, if a query made it."""
        quads = self._kb.store.quads_for_pattern(None, None, text, None)
        authors = self.authors(quad.graph_name for quad in islice(quads, _LOOKED_AT))
        # Whether those of further statements are the same is not known.
        return [*authors, "perhaps others"] if next(iter(quads), None) is not None else authors

    def authors(self, graphs: Iterable[GraphName]) -> list[str]:
        """Return who wrote graphs, each once."""
        named = (graph for graph in graphs if not isinstance(graph, DefaultGraph))
        return sorted({self.author(graph) for graph in named})

    def author(self, graph: GraphName) -> str:
        """Return who wrote a graph: an agent, the ontology, the reasoner, or the graph itself."""
        owner = self._kb.graphs.owner(graph)
        if owner is not None:
            return owner
        if graph == self._kb.graphs.inferred:
            return "the reasoner"
        if self._kb.catalogue.is_ontology(graph):
            return "the ontology"
        if not isinstance(graph, NamedNode):
            return "nobody"
        return self.short(graph).removeprefix("kb:graph/")

    def fact(
        self, triple: TripleKey, graph: GraphName | None = None, about: Term | None = None
    ) -> Fact:
        """Return a statement, with who asserts it and where its proof is.

        Parameters
        ----------
        graph
            The only graph to look at.
        about
            What the answer is about.
        """
        subject, predicate, value = triple
        graphs = [quad.graph_name for quad in self._kb.match(*triple)] if graph is None else [graph]
        by = self.authors(graphs)
        subject_member = {} if subject == about else {"s": self.value(subject)}
        return Fact(
            p=self.short(predicate),
            o=self.value(value, by),
            by=_listed(by),
            proof=self.proof(triple),
            **subject_member,
        )

    def proof(self, triple: TripleKey) -> str:
        """Return the address of the proof of a statement; empty for one with anonymous parts."""
        texts = [self.short(part) for part in triple]
        if any(isinstance(part, BlankNode) or len(text) > 2 * MAX_TEXT
               for part, text in zip(triple, texts, strict=True)):  # fmt: skip
            return ""
        fields = (
            f"{name}={quote(text, safe=':/')}" for name, text in zip("spo", texts, strict=True)
        )
        return f"{self._site}/explain?{'&'.join(fields)}"


def _listed(authors: list[str]) -> list[str]:
    """Return the first authors, and how many more there are."""
    if len(authors) <= MAX_AUTHORS:
        return authors
    return [*authors[:MAX_AUTHORS], f"and {len(authors) - MAX_AUTHORS} more"]


def _cut(kind: str, text: str, **members: Any) -> Value:
    """Return a value whose text is not too long."""
    if len(text) > MAX_TEXT:
        members["cut"] = len(text) - MAX_TEXT
    return Value(type=kind, value=text[:MAX_TEXT], **members)
