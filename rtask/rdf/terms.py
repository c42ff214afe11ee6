"""RDF terms: the store's types, conversion from and to Python values, and the stored form.

The knowledge base uses pyoxigraph's terms. The store normalises literals when they are added
(``"01"^^xsd:integer`` becomes ``1``, derived integer types become ``xsd:integer``), so deltas,
the journal and the closure must use the stored form too: :func:`stored`.
"""

from __future__ import annotations

import datetime as dt
import decimal
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import TypeAlias

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad, Store, Triple

from rtask.errors import DataError, UsageError

__all__ = [
    "BlankNode",
    "DefaultGraph",
    "Literal",
    "NamedNode",
    "Quad",
    "Triple",
    "iri",
    "is_ground",
    "literal",
    "moment",
    "object_term",
    "prologue",
    "python_value",
    "stored",
    "stored_quad",
    "subject_term",
    "written",
]

Term: TypeAlias = NamedNode | BlankNode | Literal | Triple
Subject: TypeAlias = NamedNode | BlankNode | Triple
GraphName: TypeAlias = NamedNode | BlankNode | DefaultGraph
Value: TypeAlias = Term | str | bool | int | float | decimal.Decimal | dt.datetime | dt.date
TripleKey: TypeAlias = tuple[Subject, NamedNode, Term]

XSD = "http://www.w3.org/2001/XMLSchema#"
RDF_TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
DEFAULT = DefaultGraph()
LONG_AGO = dt.datetime(1, 1, 1, tzinfo=dt.UTC)

_PLAIN = {XSD + "string", "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString"}
_INTEGERS = (
    "integer int long short byte nonNegativeInteger positiveInteger nonPositiveInteger "
    "negativeInteger unsignedLong unsignedInt unsignedShort unsignedByte"
)
_INTEGER_TYPES = {XSD + name for name in _INTEGERS.split()}
_CANONICAL = {
    XSD + "integer": re.compile(r"0|-?[1-9][0-9]{0,17}"),
    XSD + "dateTime": re.compile(
        r"[1-9][0-9]{3}-[01][0-9]-[0-3][0-9]T(?:[01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9]"
        r"(?:\.[0-9]{0,8}[1-9])?Z"
    ),
}
"""Spellings that the store keeps as they are, whether they have a value or not."""


def iri(value: NamedNode | str) -> NamedNode:
    """Return an IRI term.

    >>> iri("urn:mug")
    <NamedNode value=urn:mug>

    Raises
    ------
    DataError
        If the text is not an absolute IRI.
    """
    if isinstance(value, NamedNode):
        return value
    if not isinstance(value, str):
        raise UsageError(_no_iri(value))
    try:
        return NamedNode(value)
    except ValueError as error:
        raise DataError(f"not an absolute IRI: {value!r} ({error})") from error


def _no_iri(value: object) -> str:
    hint = "; pass its .iri" if hasattr(value, "iri") else ""
    return f"expected an IRI, got {type(value).__name__}: {value!r}{hint}"


def literal(value: object) -> Literal:
    """Return the literal of a Python value.

    >>> str(literal(0.08)), str(literal(True))
    ('"0.08"^^<http://www.w3.org/2001/XMLSchema#double>', '"true"^^<http://www.w3.org/2001/XMLSchema#boolean>')

    Raises
    ------
    DataError
        If a text holds half of a surrogate pair, or a number is too large to be stored.
    UsageError
        If the value is of another type.
    """
    if isinstance(value, Literal):
        return value
    if isinstance(value, str | bool | int | float):
        try:
            return Literal(value)
        except (ValueError, OverflowError):
            raise DataError(f"cannot be stored as a literal: {str(value)[:100]!r}") from None
    if isinstance(value, decimal.Decimal):
        return _typed(format(value, "f"), "decimal")
    if isinstance(value, dt.datetime):
        return _typed(value.isoformat().replace("+00:00", "Z"), "dateTime")
    if isinstance(value, dt.date):
        return _typed(value.isoformat(), "date")
    raise UsageError(f"a {type(value).__name__} cannot be converted to a literal: {value!r}")


def _typed(text: str, datatype: str) -> Literal:
    return Literal(text, datatype=NamedNode(XSD + datatype))


def subject_term(value: Subject | str) -> Subject:
    """Return a subject; text is taken as an IRI."""
    return value if isinstance(value, BlankNode | Triple) else iri(value)


def object_term(value: Value) -> Term:
    """Return an object: a term as it is, any other Python value as a literal."""
    if isinstance(value, NamedNode | BlankNode | Literal | Triple):
        return value
    return literal(value)


def python_value(term: Term | None) -> object:
    """Return a JSON-able Python value: IRIs and blank nodes as text, others natively.

    >>> python_value(literal(3)), python_value(iri("urn:mug")), python_value(None)
    (3, 'urn:mug', None)
    """
    if term is None:
        return None
    if isinstance(term, Literal):
        return _literal_value(term.value, term.datatype.value)
    if isinstance(term, NamedNode):
        return term.value
    return str(term)


def _literal_value(text: str, datatype: str) -> object:
    try:
        if datatype in _INTEGER_TYPES:
            return int(text)
        if datatype in (XSD + "double", XSD + "float", XSD + "decimal"):
            return float(text)
    except ValueError:  # an ill-typed literal stays as written
        return text
    if datatype == XSD + "boolean" and text in ("true", "false", "1", "0"):
        return text in ("true", "1")
    return text


def is_ground(term: object) -> bool:
    """Whether a term contains no blank node, also inside triple terms."""
    if isinstance(term, BlankNode):
        return False
    if isinstance(term, Triple):
        return is_ground(term.subject) and is_ground(term.object)
    return True


def written(term: Term) -> str:
    """Return a term in SPARQL 1.2 syntax; the store's own text of a triple term lacks brackets.

    >>> written(Triple(iri("urn:a"), iri("urn:p"), literal("b")))
    '<<( <urn:a> <urn:p> "b" )>>'
    """
    if isinstance(term, Triple):
        return f"<<( {written(term.subject)} {term.predicate} {written(term.object)} )>>"
    return str(term)


@lru_cache(maxsize=65_536)
def _stored_literal(value: Literal) -> Literal:
    scratch = Store()
    scratch.add(Quad(RDF_TYPE, RDF_TYPE, value))
    literal_stored = next(iter(scratch)).object
    assert isinstance(literal_stored, Literal)
    return literal_stored


def stored(term: Term) -> Term:
    """Return a term in the form in which the store keeps it.

    >>> str(stored(Literal("01", datatype=NamedNode(XSD + "int"))))
    '"1"^^<http://www.w3.org/2001/XMLSchema#integer>'
    """
    if isinstance(term, Literal):
        datatype = term.datatype.value
        if term.language is not None or datatype in _PLAIN:
            return term
        canonical = _CANONICAL.get(datatype)
        if canonical is not None and canonical.fullmatch(term.value):
            return term
        return _stored_literal(term)
    if isinstance(term, Triple):
        subject, obj = stored(term.subject), stored(term.object)
        assert isinstance(subject, NamedNode | BlankNode | Triple)
        return Triple(subject, term.predicate, obj)
    return term


def stored_quad(quad: Quad) -> Quad:
    """Return a quad in the form in which the store keeps it."""
    subject, obj = quad.subject, quad.object
    if isinstance(obj, NamedNode | BlankNode) and not isinstance(subject, Triple):
        return quad
    exact_subject, exact_object = stored(subject), stored(obj)
    if exact_object is obj and exact_subject is subject:
        return quad
    assert isinstance(exact_subject, NamedNode | BlankNode | Triple)
    return Quad(exact_subject, quad.predicate, exact_object, quad.graph_name)


def triple_key(quad: Quad) -> TripleKey:
    """Return the statement of a quad without its graph."""
    return (quad.subject, quad.predicate, quad.object)


def prologue(prefixes: Mapping[str, str] | Iterable[tuple[str, str]]) -> str:
    """Return SPARQL ``PREFIX`` lines.

    >>> prologue({"rt": "urn:rt#"})
    'PREFIX rt: <urn:rt#>\\n'
    """
    pairs = prefixes.items() if isinstance(prefixes, Mapping) else prefixes
    return "".join(f"PREFIX {name}: <{namespace}>\n" for name, namespace in pairs)


def moment(value: dt.datetime | str | float | None) -> dt.datetime:
    """Convert ISO 8601 text or seconds since 1970 to a time in UTC; ``None`` gives ``LONG_AGO``.

    >>> moment("2026-01-02T03:04:05Z").isoformat()
    '2026-01-02T03:04:05+00:00'

    Raises
    ------
    UsageError
        If the value is not a time.
    """
    if value is None or value == "":
        return LONG_AGO
    try:
        if isinstance(value, int | float):
            return dt.datetime.fromtimestamp(value, dt.UTC)
        moment_given = dt.datetime.fromisoformat(value) if isinstance(value, str) else value
        return (
            moment_given.astimezone(dt.UTC)
            if moment_given.tzinfo
            else moment_given.replace(tzinfo=dt.UTC)
        )
    except (ValueError, OverflowError, OSError) as error:  # OSError: seconds out of range
        raise UsageError(f"{value!r} is not a time; expected e.g. 2026-01-02T03:04:05Z") from error
