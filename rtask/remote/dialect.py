"""Dialects of SPARQL servers: how each keeps terms and graphs, and how they are written for it.

Blank nodes cannot be named to a server, so they travel as IRIs below ``<base>.well-known/genid/_/``
(RDF 1.1 Concepts, 3.5) and become blank nodes again here. Literals of datatypes that a server does
not return as they were given travel as strings that begin with ``urn:rtask:as:<datatype>``, and so
does a string that begins like that by itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from pyoxigraph import (
    BlankNode,
    DefaultGraph,
    Literal,
    NamedNode,
    Quad,
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
    Triple,
    parse,
    parse_query_results,
    serialize,
)

from rtask.errors import RemoteUnavailableError, UnsupportedError
from rtask.rdf.terms import XSD, GraphName, Term, stored, written

__all__ = ["Abilities", "Dialect", "RemoteTriples"]

_AS = "urn:rtask:as:"
_DOUBLE = XSD + "double"
_DECIMAL = XSD + "decimal"
_STRING = XSD + "string"
_DIGITS = 15


@dataclass(frozen=True)
class Abilities:
    """Facts about a server, found out by :func:`rtask.remote.probe.probe`.

    Parameters
    ----------
    default_graph
        Whether the default graph is a graph of its own that can be written. Otherwise it shows
        the named graphs, some of their triples twice, and the union is kept as a named graph.
    triple_terms
        Whether statements about statements can be stored (RDF 1.2).
    encoded
        Datatypes whose literals the server changes; they travel encoded.
    canonical
        Whether literals come back in the very form in which they were given.
    exact_numbers
        Whether doubles and decimals come back as they were given. Otherwise doubles are rounded to
        15 significant digits, and decimals that are whole or longer than that travel encoded.
    statements
        Number of statements that one request may hold.
    """

    default_graph: bool = True
    triple_terms: bool = True
    encoded: frozenset[str] = frozenset()
    canonical: bool = True
    exact_numbers: bool = True
    statements: int = 5_000


@dataclass(frozen=True)
class RemoteTriples:
    """Answer of a CONSTRUCT or DESCRIBE, used like ``pyoxigraph.QueryTriples``."""

    triples: tuple[Triple, ...]

    def __iter__(self) -> Any:
        return iter(self.triples)

    def serialize(self, format: RdfFormat) -> bytes:
        """Return the triples as a document."""
        text = serialize(self.triples, format=format)
        assert text is not None
        return text


@dataclass(frozen=True)
class Dialect:
    """Writes terms for one server, and reads its answers.

    Parameters
    ----------
    base
        IRI that starts every instance and graph of the knowledge base.
    """

    base: str
    abilities: Abilities = field(default_factory=Abilities)

    @property
    def genid(self) -> str:
        """IRI that starts the names of blank nodes."""
        return f"{self.base}.well-known/genid/_/"

    @property
    def union(self) -> NamedNode | None:
        """Named graph with the union of all others; ``None`` if the default graph is that."""
        return None if self.abilities.default_graph else NamedNode(f"{self.base}graph/union")

    # Writing

    def term(self, term: Term) -> str:
        """Return a term as SPARQL text.

        Raises
        ------
        UnsupportedError
            A triple term for a server that stores none.
        """
        if isinstance(term, BlankNode):
            return f"<{self.genid}{term.value}>"
        if isinstance(term, Triple):
            if not self.abilities.triple_terms:
                raise UnsupportedError(
                    "this server stores no triple terms (RDF 1.2), so single statements cannot "
                    "have a confidence, a validity or a source"
                )
            parts = map(self.term, (term.subject, term.predicate, term.object))
            return f"<<( {' '.join(parts)} )>>"
        if not isinstance(term, Literal):
            return written(term)
        canonical: Literal = self.canonical(term)
        if self._is_encoded(canonical):
            return str(Literal(f"{_AS}{canonical.datatype.value} {canonical.value}"))
        return written(canonical)

    def _is_encoded(self, term: Literal) -> bool:
        datatype = term.datatype.value
        if datatype == _STRING:
            return term.value.startswith(_AS)
        if datatype == _DECIMAL and not self.abilities.exact_numbers:
            return "." not in term.value or len(term.value.strip("-0.")) > _DIGITS
        return datatype in self.abilities.encoded

    def canonical(self, term: Any) -> Any:
        """Return a term as the server will return it; only doubles may differ."""
        if self.abilities.exact_numbers or not isinstance(term, Literal):
            return term
        if term.datatype.value != _DOUBLE:
            return term
        try:
            rounded = float(f"{float(term.value):.{_DIGITS}g}")
        except ValueError:
            return term
        return stored(Literal(repr(rounded), datatype=term.datatype))

    def canonical_quad(self, quad: Quad) -> Quad:
        """Return a quad as the server will return it."""
        value = self.canonical(quad.object)
        if value is quad.object:
            return quad
        return Quad(quad.subject, quad.predicate, value, quad.graph_name)

    @property
    def exactly(self) -> str:
        """Pattern that binds ``?t`` to the full text of ``?o`` where results show less of it."""
        return "" if self.abilities.exact_numbers else "BIND(STR(?o) AS ?t)"

    def graph(self, graph: GraphName) -> str:
        """Return the name of a graph; empty for the server's own default graph."""
        if isinstance(graph, DefaultGraph):
            return "" if self.union is None else str(self.union)
        return self.term(graph)

    def block(self, quads: Iterable[Quad]) -> str:
        """Return quads as the body of a template or of ``INSERT DATA``."""
        by_graph: dict[GraphName, list[str]] = {}
        for quad in quads:
            parts = map(self.term, (quad.subject, quad.predicate, quad.object))
            by_graph.setdefault(quad.graph_name, []).append(" ".join(parts) + " .")
        blocks = []
        for graph, lines in by_graph.items():
            name, body = self.graph(graph), "\n".join(lines)
            blocks.append(f"GRAPH {name} {{ {body} }}" if name else body)
        return "\n".join(blocks)

    # Reading

    def answer(self, data: bytes, rows: bool) -> QuerySolutions | QueryBoolean | RemoteTriples:
        """Read the answer of a query: rows or a truth value in JSON, or N-Triples.

        Raises
        ------
        RemoteUnavailableError
            The answer is incomplete.
        """
        try:
            if rows:
                return parse_query_results(self._restored(data), format=QueryResultsFormat.JSON)
            return RemoteTriples(
                tuple(
                    Triple(*(self._read(t) for t in (q.subject, q.predicate, q.object)))
                    for q in parse(data, format=RdfFormat.N_TRIPLES)
                )
            )
        except (SyntaxError, ValueError) as error:
            raise RemoteUnavailableError(f"the answer broke off: {error}") from error

    def _restored(self, data: bytes) -> bytes:
        """Return results in JSON with blank nodes and datatypes as they were given."""
        if (
            self.abilities.canonical
            and self.genid.encode() not in data.replace(b"\\/", b"/")
            and _AS.encode() not in data
        ):
            return data
        document = json.loads(data)
        for binding in document.get("results", {}).get("bindings", ()):
            for value in binding.values():
                self._restore(value)
        return json.dumps(document).encode()

    def _restore(self, value: dict[str, Any]) -> None:
        if value["type"] == "triple":
            for part in value["value"].values():
                self._restore(part)
        elif value["type"] == "uri":
            node = self._blank_node(value["value"])
            if node is not None:
                value["type"], value["value"] = "bnode", node.value
        elif _is_encoding(value["value"], value.get("datatype", _STRING), value.get("xml:lang")):
            value["datatype"], _, value["value"] = value["value"][len(_AS) :].partition(" ")
        elif "datatype" in value and not self.abilities.canonical:
            canonical = stored(Literal(value["value"], datatype=NamedNode(value["datatype"])))
            assert isinstance(canonical, Literal)
            value["value"], value["datatype"] = canonical.value, canonical.datatype.value

    def _read(self, term: Any) -> Any:
        if isinstance(term, NamedNode):
            return self._blank_node(term.value) or term
        if isinstance(term, Literal) and _is_encoding(
            term.value, term.datatype.value, term.language
        ):
            datatype, _, value = term.value[len(_AS) :].partition(" ")
            return Literal(value, datatype=NamedNode(datatype))
        return term if self.abilities.canonical else stored(term)

    def _blank_node(self, name: str) -> BlankNode | None:
        """Return the blank node that an IRI stands for; ``None`` for any other IRI."""
        if not name.startswith(self.genid):
            return None
        try:
            return BlankNode(name[len(self.genid) :])
        except ValueError:  # an IRI that somebody else made
            return None

    def exact_object(self, value: Any, text: Any) -> Any:
        """Return the object of a row that :attr:`exactly` has completed."""
        if text is None or not isinstance(value, Literal) or value.datatype.value != _DOUBLE:
            return value
        return stored(Literal(text.value, datatype=value.datatype))

    def rows(self, data: bytes) -> list[tuple[Any, ...]]:
        """Read the rows of a SELECT, with terms as the embedded store would keep them."""
        answer = self.answer(data, rows=True)
        assert isinstance(answer, QuerySolutions)
        try:
            return [tuple(None if t is None else stored(t) for t in row) for row in answer]
        except SyntaxError as error:
            raise RemoteUnavailableError(f"the answer broke off: {error}") from error


def _is_encoding(text: str, datatype: str, language: str | None) -> bool:
    """Whether a literal is one that travels encoded."""
    return datatype == _STRING and language is None and text.startswith(_AS)
