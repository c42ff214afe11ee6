"""Axioms as text that does not depend on blank nodes: class expressions in Manchester syntax.

This makes versions of an ontology comparable and axioms readable (OWL 2 Manchester Syntax, 2.4;
shapes and anything else without such a form are written in brackets).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import ontology
from rtask.ontology_docs.source import prefixed
from rtask.rdf.terms import XSD, BlankNode, Literal, NamedNode, Subject, Term, TripleKey

__all__ = ["ABOVE", "Axiom", "literal_text", "read_axioms"]

_OWL, _RDF, _RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
_TYPE, _FIRST, _REST, _NIL = (_RDF + name for name in ("type", "first", "rest", "nil"))
_LISTS = {
    _OWL + "AllDisjointClasses": _OWL + "members",
    _OWL + "AllDisjointProperties": _OWL + "members",
    _OWL + "AllDifferent": _OWL + "distinctMembers",
}
_JOINED = {"intersectionOf": " and ", "unionOf": " or "}
_QUANTIFIED = {"someValuesFrom": "some", "allValuesFrom": "only", "hasValue": "value"}
_COUNTED = {"min": "min", "max": "max", "": "exactly"}
_FACETS = {"minInclusive": ">=", "maxInclusive": "<=", "minExclusive": ">", "maxExclusive": "<"}
_PLAIN_NUMBERS = {XSD + "integer", XSD + "double", XSD + "decimal", XSD + "boolean"}

ABOVE = "superclassOf"
"""Pseudo-property of a sufficient condition: ``[expression] rdfs:subClassOf Name``."""


@dataclass(frozen=True, order=True)
class Axiom:
    """One statement about a term, or about several at once.

    Attributes
    ----------
    subject
        The term; empty for an axiom about a list of terms.
    predicate
        IRI of the property, the type of an axiom about a list, or :data:`ABOVE`.
    text
        The value, without blank nodes.
    mentions
        The IRIs in the value.
    literal
        Whether the value is text rather than a term or an expression.
    """

    subject: str
    predicate: str
    text: str
    mentions: tuple[str, ...] = ()
    literal: bool = False

    def __str__(self) -> str:
        about = prefixed(self.subject) if self.subject else ""
        predicate = self.predicate if self.predicate == ABOVE else prefixed(self.predicate)
        return f"{about} {predicate} {self.text}".strip()


def read_axioms(triples: Iterable[TripleKey]) -> list[Axiom]:
    """Return the axioms of an ontology, sorted.

    Examples
    --------
    >>> import pyoxigraph as ox
    >>> text = "@prefix o: <http://www.w3.org/2002/07/owl#> . <urn:A> a [ o:unionOf (<urn:B>) ] ."
    >>> quads = ox.parse(text, format=ox.RdfFormat.TURTLE)
    >>> [str(axiom) for axiom in read_axioms((q.subject, q.predicate, q.object) for q in quads)]
    ['<urn:A> rdf:type (<urn:B>)']
    """
    return sorted(set(_Reader(triples).axioms()))


class _Reader:
    def __init__(self, triples: Iterable[TripleKey]) -> None:
        self._of: dict[Subject, dict[str, list[Term]]] = defaultdict(lambda: defaultdict(list))
        self._inner: set[Term] = set()
        for s, p, o in triples:
            self._of[s][p.value].append(o)
            self._inner.add(o)

    def axioms(self) -> Iterator[Axiom]:
        for subject, values in list(self._of.items()):
            if isinstance(subject, NamedNode):
                for predicate, terms in values.items():
                    for term in terms:
                        yield self._axiom(subject.value, predicate, term)
            elif isinstance(subject, BlankNode) and subject not in self._inner:
                yield from self._unnamed(subject, values)

    def _axiom(self, subject: str, predicate: str, term: Term) -> Axiom:
        mentions: set[str] = set()
        text = self._text(term, mentions, ())
        return Axiom(subject, predicate, text, tuple(sorted(mentions)), isinstance(term, Literal))

    def _unnamed(self, subject: BlankNode, values: dict[str, list[Term]]) -> Iterator[Axiom]:
        kinds = [kind.value for kind in values.get(_TYPE, ()) if isinstance(kind, NamedNode)]
        above = [o for o in values.get(_RDFS + "subClassOf", ()) if isinstance(o, NamedNode)]
        listing = next((kind for kind in kinds if kind in _LISTS), None)
        if listing is not None:
            mentions: set[str] = set()
            heads = values.get(_LISTS[listing], [])
            members = sorted(self._text(m, mentions, ()) for h in heads for m in self._members(h))
            yield Axiom("", listing, f"({', '.join(members)})", tuple(sorted(mentions)))
        elif above:
            for name in above:
                yield self._axiom(name.value, ABOVE, subject)
        else:
            yield self._axiom("", _TYPE, subject)

    def _members(self, head: Term) -> list[Term]:
        members, seen = list[Term](), set[Term]()
        while isinstance(head, BlankNode) and head not in seen:
            seen.add(head)
            members += self._of[head][_FIRST][:1]
            head = next(iter(self._of[head][_REST]), NamedNode(_NIL))
        return members

    def _text(self, term: Term, mentions: set[str], above: tuple[Term, ...]) -> str:
        """Return a term as text, and note the IRIs in it; ``above`` guards against cycles."""
        if isinstance(term, NamedNode):
            mentions.add(term.value)
            return prefixed(term.value)
        if isinstance(term, Literal):
            return literal_text(term)
        if not isinstance(term, BlankNode) or term in above:
            return "..." if term in above else str(term)
        return self._expression(term, mentions, (*above, term))

    def _expression(self, node: BlankNode, mentions: set[str], above: tuple[Term, ...]) -> str:
        values = self._of[node]

        def first(name: str) -> str | None:
            values_here = values.get(_OWL + name)
            return self._text(values_here[0], mentions, above) if values_here else None

        def items(head: Term) -> list[str]:
            return [self._text(member, mentions, above) for member in self._members(head)]

        if _FIRST in values:
            return f"({', '.join(items(node))})"
        for name, word in _JOINED.items():
            if _OWL + name in values:
                return f"({word.join(sorted(items(values[_OWL + name][0])))})"
        if _OWL + "oneOf" in values:
            return f"{{{', '.join(sorted(items(values[_OWL + 'oneOf'][0])))}}}"
        if _OWL + "onProperty" in values:
            return self._restriction(values, first)
        if inner := first("complementOf"):
            return f"not {inner}"
        if inner := first("inverseOf"):
            return f"inverse {inner}"
        if datatype := first("onDatatype"):
            return f"{datatype}[{', '.join(self._facets(values))}]"
        return self._brackets(values, mentions, above)

    @staticmethod
    def _restriction(values: dict[str, list[Term]], first: object) -> str:
        assert callable(first)
        where = first("onProperty")
        for name, word in _QUANTIFIED.items():
            if filler := first(name):
                return f"({where} {word} {filler})"
        for name, word in _COUNTED.items():
            for suffix in ("qualifiedCardinality", "cardinality"):
                full = name + suffix[0].upper() + suffix[1:] if name else suffix
                if number := first(full):
                    kind = first("onClass") or first("onDataRange") or ""
                    return f"({f'{where} {word} {number} {kind}'.strip()})"
        return f"({where} Self)" if first("hasSelf") else f"({where} ?)"

    def _facets(self, values: dict[str, list[Term]]) -> list[str]:
        facets = []
        for restriction in self._members(values[_OWL + "withRestrictions"][0]):
            if isinstance(restriction, BlankNode):
                for name, limits in self._of[restriction].items():
                    sign = _FACETS.get(name.removeprefix(XSD), name.removeprefix(XSD))
                    facets += [
                        f"{sign} {literal_text(x)}" for x in limits if isinstance(x, Literal)
                    ]
        return sorted(facets)

    def _brackets(
        self, values: dict[str, list[Term]], mentions: set[str], above: tuple[Term, ...]
    ) -> str:
        pairs = sorted(
            f"{prefixed(predicate)} {self._text(term, mentions, above)}"
            for predicate, terms in values.items()
            for term in terms
        )
        return f"[ {' ; '.join(pairs)} ]"


def literal_text(term: Literal) -> str:
    """Return a literal in Turtle syntax, numbers and booleans in their short form."""
    if term.language:
        return f'"{term.value}"@{term.language}'
    datatype = term.datatype.value
    if datatype in _PLAIN_NUMBERS:
        return term.value
    return f'"{term.value}"' + ("" if datatype == XSD + "string" else f"^^{prefixed(datatype)}")
