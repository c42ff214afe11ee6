"""Terms of ontologies: their kinds, the statements about them, and their uses."""

from __future__ import annotations

import difflib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import pyoxigraph as ox

import ontology
from rtask.errors import UnknownTermError
from rtask.ontology_docs.axioms import Axiom, literal_text, read_axioms
from rtask.ontology_docs.source import Module, prefixed

__all__ = ["KINDS", "Term", "Vocabulary", "local_name"]

_OWL, _RDF, _RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_SH, _RT = ontology.PREFIXES["sh"], ontology.NS
_TYPE = _RDF + "type"

KINDS = {
    _OWL + "Class": "class",
    _RDFS + "Class": "class",
    _OWL + "ObjectProperty": "object property",
    _OWL + "DatatypeProperty": "data property",
    _OWL + "AnnotationProperty": "annotation property",
    _OWL + "NamedIndividual": "individual",
    _SH + "NodeShape": "shape",
    _SH + "PropertyShape": "shape",
}
"""Kinds of terms, by the class of their declaration."""

_ANNOTATIONS = {_RDFS + name for name in ("label", "comment", "isDefinedBy")} | {_RT + "unit"}


@dataclass
class Term:
    """A class, property, individual or shape.

    Attributes
    ----------
    kinds
        Values of :data:`KINDS`; several for punning.
    module
        Name of the module that declares it.
    unit
        QUDT unit of a number, such as ``unit:M``.
    axioms
        Statements about it, except label, comment, module and unit.
    """

    iri: str
    kinds: tuple[str, ...]
    module: str
    label: str = ""
    comment: str = ""
    unit: str = ""
    deprecated: bool = False
    axioms: list[Axiom] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The short form of the IRI."""
        return prefixed(self.iri)

    def values(self, predicate: str) -> list[str]:
        """Return the values of a property of the term, as text."""
        return [axiom.text for axiom in self.axioms if axiom.predicate == predicate]

    def named(self, predicate: str) -> list[str]:
        """Return the values of a property that are plain IRIs."""
        return [
            axiom.mentions[0]
            for axiom in self.axioms
            if axiom.predicate == predicate and axiom.text == prefixed((*axiom.mentions, "")[0])
        ]


def local_name(iri: str) -> str:
    """Return the last part of an IRI.

    >>> local_name("urn:mug"), local_name("http://example.org/a#B")
    ('mug', 'B')
    """
    return iri.rstrip("/#").replace("#", "/").replace(":", "/").rsplit("/", 1)[-1]


class Vocabulary:
    """The terms of some modules.

    Parameters
    ----------
    modules
        Ontologies; a term declared by several belongs to the first.
    """

    def __init__(self, modules: Iterable[Module]) -> None:
        self.modules = list(modules)
        self.axioms = {module.name: read_axioms(module.triples) for module in self.modules}
        self.terms: dict[str, Term] = {}
        for module in self.modules:
            self._declare(module)
        for axioms in self.axioms.values():
            for axiom in axioms:
                self._attach(axiom)

    def _declare(self, module: Module) -> None:
        kinds: dict[str, list[str]] = defaultdict(list)
        for axiom in self.axioms[module.name]:
            if axiom.predicate == _TYPE and axiom.subject:
                kinds[axiom.subject] += [KINDS[m] for m in axiom.mentions if m in KINDS]
        for iri, kinds_of_term in kinds.items():
            if kinds_of_term and iri not in self.terms:
                ordered = sorted(set(kinds_of_term), key=[*KINDS.values()].index)
                self.terms[iri] = Term(iri, tuple(ordered), module.name)

    def _attach(self, axiom: Axiom) -> None:
        term = self.terms.get(axiom.subject)
        if axiom.subject == "":
            for iri in axiom.mentions:
                if iri in self.terms:
                    self.terms[iri].axioms.append(axiom)
        elif term is not None and axiom.predicate in _ANNOTATIONS:
            name = axiom.predicate.removeprefix(_RDFS).removeprefix(_RT)
            if name == "unit":
                term.unit = axiom.text
            elif name != "isDefinedBy" and _is_readable(axiom.text):
                setattr(term, name, _words(axiom.text))
        elif term is not None:
            term.deprecated |= axiom.predicate == _OWL + "deprecated" and axiom.text == "true"
            term.axioms.append(axiom)

    # Looking up

    def find(self, name: str) -> Term:
        """Return the term of an IRI, a prefixed name, or a local name.

        Raises
        ------
        UnknownTermError
            With a suggestion.
        """
        iri = name.strip("<>")
        prefix, _, local = name.partition(":")
        if iri not in self.terms and prefix in ontology.PREFIXES:
            iri = ontology.PREFIXES[prefix] + local
        if iri in self.terms:
            return self.terms[iri]
        same = [term for term in self.terms.values() if local_name(term.iri) == name]
        if same:
            return min(same, key=lambda term: (not term.iri.startswith(_RT), term.iri))
        names = {local_name(term_iri): term_iri for term_iri in self.terms}
        names |= {prefixed(term_iri): term_iri for term_iri in self.terms}
        near = difflib.get_close_matches(name, [*names, *(m.name for m in self.modules)], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise UnknownTermError(f"no term or module {name!r}{hint}", did_you_mean=near)

    def module(self, name: str) -> Module | None:
        """Return a module by its name, the last part of it, or its IRI."""
        for module in self.modules:
            if name in (module.name, module.iri, module.name.rsplit("/", 1)[-1]):
                return module
        return None

    def members(self, module: Module) -> list[Term]:
        """Return the terms that a module declares, by IRI."""
        own = [term for term in self.terms.values() if term.module == module.name]
        return sorted(own, key=lambda term: term.iri)

    def used_by(self, iri: str) -> list[Axiom]:
        """Return the axioms of other terms that mention a term."""
        return self._mentions.get(iri, [])

    @cached_property
    def _mentions(self) -> dict[str, list[Axiom]]:
        by_term: dict[str, list[Axiom]] = defaultdict(list)
        for axioms in self.axioms.values():
            for axiom in axioms:
                for iri in axiom.mentions if axiom.subject else ():
                    if iri != axiom.subject and axiom.predicate != _RDFS + "isDefinedBy":
                        by_term[iri].append(axiom)
        return by_term

    def below(self, iri: str) -> list[str]:
        """Return the direct subclasses or sub-properties of a term."""
        above = (_RDFS + "subClassOf", _RDFS + "subPropertyOf")
        return sorted(
            axiom.subject
            for axiom in self.used_by(iri)
            if axiom.predicate in above and axiom.text == prefixed(iri)
        )

    def examples(self, iri: str, number: int = 2) -> list[str]:
        """Return statements of the bundled sample that use a term, in Turtle."""
        return self._sample.get(iri, [])[:number]

    @cached_property
    def _sample(self) -> dict[str, list[str]]:
        base = ontology.BASE + "sample/"

        def short(term: object) -> str:
            if isinstance(term, ox.Literal):
                return literal_text(term)
            iri = str(getattr(term, "value", term))
            return f":{iri.removeprefix(base)}" if iri.startswith(base) else prefixed(iri)

        samples: dict[str, list[str]] = defaultdict(list)
        for quad in ox.parse(path=str(ontology.path("examples/sample.trig"))):
            about = "a" if quad.predicate.value == _TYPE else short(quad.predicate)
            line = f"{short(quad.subject)} {about} {short(quad.object)} ."
            is_type = quad.predicate.value == _TYPE
            samples[quad.object.value if is_type else quad.predicate.value].append(line)
            if isinstance(quad.object, ox.NamedNode) and not is_type:
                samples[quad.object.value].append(line)
        return samples

    def __len__(self) -> int:
        return len(self.terms)


def _is_readable(text: str) -> bool:
    """Whether a text is English or has no language tag."""
    return text.endswith(('"', '"@en', '"@en-us', '"@en-gb'))


def _words(text: str) -> str:
    return text.rpartition('"')[0].removeprefix('"')
