"""Shapes that fit the integers of the store.

The store keeps ``"1"^^xsd:int`` and the other derived integer types as ``xsd:integer``, so a shape
that demands a derived type would fail on every value. It demands an integer in the type's range
instead (XML Schema 1.1 Part 2, 3.4).
"""

from __future__ import annotations

from pyoxigraph import BlankNode, Literal, NamedNode

from rtask.rdf.terms import XSD, Term, TripleKey, stored

__all__ = ["with_plain_integers"]

_SH = "http://www.w3.org/ns/shacl#"
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_DATATYPE = NamedNode(_SH + "datatype")
_AND = NamedNode(_SH + "and")
_FIRST, _REST, _NIL = (NamedNode(_RDF + name) for name in ("first", "rest", "nil"))
_INTEGER = NamedNode(XSD + "integer")
_RANGES: dict[str, tuple[int | None, int | None]] = {
    "long": (-(2**63), 2**63 - 1),
    "int": (-(2**31), 2**31 - 1),
    "short": (-(2**15), 2**15 - 1),
    "byte": (-128, 127),
    "nonNegativeInteger": (0, None),
    "positiveInteger": (1, None),
    "nonPositiveInteger": (None, 0),
    "negativeInteger": (None, -1),
    "unsignedLong": (0, 2**64 - 1),
    "unsignedInt": (0, 2**32 - 1),
    "unsignedShort": (0, 2**16 - 1),
    "unsignedByte": (0, 255),
}

About = dict[Term, dict[TripleKey, str]]


def with_plain_integers(about: About) -> About:
    """Return statements of shapes, by subject, that demand integers as the store has them."""
    changed: About = {}
    for node, lines in about.items():
        for (subject, predicate, value), source in lines.items():
            value = stored(value)
            bounds = None
            if predicate == _DATATYPE and isinstance(value, NamedNode):
                bounds = _RANGES.get(value.value.removeprefix(XSD))
            if bounds is not None:
                value = _INTEGER
                for line in _bounds(subject, bounds):
                    changed.setdefault(line[0], {})[line] = source
            changed.setdefault(node, {})[subject, predicate, value] = source
    return changed


def _bounds(shape: Term, bounds: tuple[int | None, int | None]) -> list[TripleKey]:
    """Return ``shape sh:and ( [ sh:minInclusive least ; sh:maxInclusive most ] )``."""
    cell, part = BlankNode(), BlankNode()
    lines: list[TripleKey] = [
        (shape, _AND, cell),  # type: ignore[list-item]
        (cell, _FIRST, part),
        (cell, _REST, _NIL),
    ]
    for name, bound in zip(("minInclusive", "maxInclusive"), bounds, strict=True):
        if bound is not None:
            limit = Literal(str(bound), datatype=_INTEGER)
            lines.append((part, NamedNode(_SH + name), limit))
    return lines
