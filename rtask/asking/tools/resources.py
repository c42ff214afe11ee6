"""Resources of agents: the ontology in few bytes, and its questions with their queries.

The ontology is read from graphs that hold one: what robots state about terms is not part of it.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any
from urllib.parse import parse_qs, urlsplit

import ontology
from rtask.asking.tools.declaration import Asked
from rtask.asking.tools.proofs import Explain, explain
from rtask.asking.tools.questions import queries
from rtask.errors import UnknownTermError
from rtask.kb.core import GraphCore
from rtask.kb.store.naming import prefixed
from rtask.rdf.terms import RDF_TYPE, NamedNode

__all__ = ["MAX_ONTOLOGY", "listed", "outline", "read", "templates"]

MAX_ONTOLOGY = 6_000
ONTOLOGY, QUESTION, PROOF = "rtask:/ontology", "rtask:/questions/", "/explain?"
_RDFS, _OWL = ontology.PREFIXES["rdfs"], ontology.PREFIXES["owl"]
_HEAD = """# Each class < its superclass: its properties and the kinds of their values.
# A name without a prefix is rt:. More: search, describe.
"""


def listed() -> list[dict[str, Any]]:
    """Return the resources as lists of resources show them."""
    entries = [{
        "uri": ONTOLOGY, "name": "ontology", "mimeType": "text/plain",
        "description": "Classes and properties of the graph in 6 kB",
    }]  # fmt: skip
    for key, (text, _) in queries().items():
        kind = "application/sparql-query"
        entries.append({"uri": QUESTION + key, "name": key, "description": text, "mimeType": kind})
    return entries


def templates() -> list[dict[str, Any]]:
    """Return the template of the addresses of proofs."""
    return [{
        "uriTemplate": "rtask:/explain{?s,p,o}", "name": "proof", "mimeType": "application/json",
        "description": "Why a statement holds, or what it lacks",
    }]  # fmt: skip


def read(asked: Asked, uri: str) -> dict[str, Any]:
    """Return the contents of a resource.

    Raises
    ------
    UnknownTermError
        There is no such resource.
    """
    if uri == ONTOLOGY:
        return {"uri": uri, "mimeType": "text/plain", "text": outline(asked.kb)}
    key = uri.removeprefix(QUESTION)
    if uri.startswith(QUESTION) and key in queries():
        words, sparql = queries()[key]
        text = f"# {words}\n{sparql}"
        return {"uri": uri, "mimeType": "application/sparql-query", "text": text}
    if PROOF in uri and uri.startswith(("rtask:", asked.site)):
        fields = parse_qs(urlsplit(uri).query)
        if set(fields) == {"s", "p", "o"}:
            s, p, o = (fields[name][-1] for name in "spo")
            text = explain.handler(asked, Explain(s=s, p=p, o=o)).to_json().decode()
            return {"uri": uri, "mimeType": "application/json", "text": text}
    raise UnknownTermError("there is no such resource; see resources/list")


def outline(kb: GraphCore) -> str:
    """Return the classes and properties of the ontology in at most :data:`MAX_ONTOLOGY` bytes."""
    schema = _Schema(kb)
    lines = list(schema.lines())
    text, left = _HEAD, len(lines)
    for line in lines:
        if len(f"{text}{line}\n".encode()) > MAX_ONTOLOGY - 40:
            break
        text, left = f"{text}{line}\n", left - 1
    return text + (f"# and {left} more classes\n" if left else "")


class _Schema:
    """What the graphs of ontologies state of classes and properties with names."""

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._classes = self._of_kind("Class")
        self._properties = self._of_kind("ObjectProperty") | self._of_kind("DatatypeProperty")
        self._above = self._pairs(NamedNode(_RDFS + "subClassOf"))
        domains = self._pairs(NamedNode(_RDFS + "domain"))
        self._ranges = self._pairs(NamedNode(_RDFS + "range"))
        self._own: dict[NamedNode, list[NamedNode]] = defaultdict(list)
        for term in sorted(self._properties, key=str):
            for domain in domains.get(term, [])[:1]:
                self._own[domain].append(term)

    def lines(self) -> list[str]:
        """Return one line for each class, those with many properties first."""
        own = {term for term in self._classes if term.value.startswith(ontology.NS)}
        named = own | set(self._own)
        order = sorted(named, key=lambda term: (-len(self._own[term]), term.value))
        return [self._line(term) for term in order]

    def _line(self, term: NamedNode) -> str:
        above = [self._short(other) for other in self._above.get(term, [])][:1]
        properties = " ".join(self._property(other) for other in self._own[term])
        head = self._short(term) + (f" < {above[0]}" if above else "")
        return f"{head}: {properties}" if properties else head

    def _property(self, term: NamedNode) -> str:
        ranges = [self._short(other).removeprefix("xsd:") for other in self._ranges.get(term, [])]
        return self._short(term) + (f">{ranges[0]}" if ranges else "")

    def _short(self, term: NamedNode) -> str:
        return prefixed(term).removeprefix("rt:")

    def _of_kind(self, kind: str) -> set[NamedNode]:
        quads = self._kb.match(None, RDF_TYPE, NamedNode(_OWL + kind))
        return {
            quad.subject
            for quad in quads
            if isinstance(quad.subject, NamedNode)
            and self._kb.catalogue.is_ontology(quad.graph_name)
        }

    def _pairs(self, predicate: NamedNode) -> dict[NamedNode, list[NamedNode]]:
        pairs: dict[NamedNode, list[NamedNode]] = defaultdict(list)
        for quad in self._kb.match(None, predicate):
            subject, value = quad.subject, quad.object
            if (
                isinstance(subject, NamedNode)
                and isinstance(value, NamedNode)
                and self._kb.catalogue.is_ontology(quad.graph_name)
            ):
                pairs[subject].append(value)
        return {term: sorted(others, key=str) for term, others in pairs.items()}
