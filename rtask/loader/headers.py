"""Ontology headers of documents: IRI, version and imports."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Quad

from rtask.errors import RtaskError
from rtask.rdf.documents import Document
from rtask.rdf.formats import detect, statements
from rtask.rdf.terms import RDF_TYPE

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Header", "Terms", "header_of", "peek", "version_of"]

_OWL = "http://www.w3.org/2002/07/owl#"
_ONTOLOGY = NamedNode(_OWL + "Ontology")
_IMPORTS = NamedNode(_OWL + "imports")
_VERSION_IRI = NamedNode(_OWL + "versionIRI")
_VERSION_INFO = NamedNode(_OWL + "versionInfo")
_PEEKED = 5_000
_STANDARDS = (
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "http://www.w3.org/2000/01/rdf-schema#",
    _OWL,
    "http://www.w3.org/2001/XMLSchema#",
)


@dataclass(frozen=True)
class Header:
    """Header of the ontology in a document.

    Parameters
    ----------
    iri
        IRI of the ontology; ``None`` if the document contains data.
    version_iri
        IRI of the version; ``None`` if not stated.
    imports
        IRIs of imported ontologies, in the order of the document.
    patches
        Names of the patches that were applied to the document.
    """

    iri: NamedNode | None = None
    version_iri: NamedNode | None = None
    imports: tuple[NamedNode, ...] = ()
    patches: tuple[str, ...] = ()


@dataclass
class Terms:
    """Terms that documents use and terms that they describe."""

    used: set[NamedNode] = field(default_factory=set)
    described: set[object] = field(default_factory=set)

    def read(self, quads: Iterable[Quad]) -> None:
        """Collect the terms of statements."""
        for quad in quads:
            self.used.add(quad.predicate)
            self.described.add(quad.subject)
            if quad.predicate == RDF_TYPE and isinstance(quad.object, NamedNode):
                self.used.add(quad.object)

    def undeclared(self, kb: GraphCore) -> list[str]:
        """Return terms that are used but not described, sorted, except those of W3C standards."""
        return sorted(
            term.value
            for term in self.used - self.described
            if not term.value.startswith(_STANDARDS) and not kb.match(term)
        )


def header_of(quads: Iterable[Quad]) -> Header:
    """Return the ontology header among statements.

    Of several ontologies, the one with imports or a version is chosen, or else the first.
    """
    names: list[NamedNode] = []
    imports: dict[NamedNode, list[NamedNode]] = {}
    versions: dict[NamedNode, NamedNode] = {}
    for quad in quads:
        subject, value = quad.subject, quad.object
        if not isinstance(subject, NamedNode) or not isinstance(value, NamedNode):
            continue
        if quad.predicate == RDF_TYPE and value == _ONTOLOGY:
            names.append(subject)
        elif quad.predicate == _IMPORTS:
            imports.setdefault(subject, []).append(value)
        elif quad.predicate == _VERSION_IRI:
            versions[subject] = value
    if not names:
        return Header()
    name = next((n for n in names if n in imports or n in versions), names[0])
    return Header(name, versions.get(name), tuple(dict.fromkeys(imports.get(name, ()))))


def version_of(quads: Iterable[Quad], name: NamedNode) -> str:
    """Return the version that an ontology states of itself, in words."""
    stated = {
        quad.predicate: getattr(quad.object, "value", "")
        for quad in quads
        if quad.subject == name and quad.predicate in (_VERSION_INFO, _VERSION_IRI)
    }
    version = stated.get(_VERSION_INFO) or stated.get(_VERSION_IRI)
    return f"version {version}" if version else "a version without number"


def peek(document: Document) -> Header:
    """Return the header of a document from its first statements; no header if it is unreadable."""
    try:
        return header_of(islice(statements(document, detect(document)), _PEEKED))
    except RtaskError:
        return Header()
