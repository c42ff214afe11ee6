"""Conversion between Python values and literals, by datatype."""

from __future__ import annotations

import datetime as dt
import decimal
import math
from collections.abc import Callable

import ontology
from rtask.rdf.terms import XSD, Literal, NamedNode, Term, literal

__all__ = ["LangString", "decode", "encode", "python_type"]

RDF_TYPE = ontology.PREFIXES["rdf"] + "type"
THING = ontology.PREFIXES["owl"] + "Thing"
RDF_LANG_STRING = "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString"
RDFS_LITERAL = "http://www.w3.org/2000/01/rdf-schema#Literal"

_BITS = {"byte": 7, "short": 15, "int": 31, "long": 63}
_INTEGERS: dict[str, tuple[float, float]] = {
    "integer": (-math.inf, math.inf),
    "positiveInteger": (1, math.inf),
    "nonNegativeInteger": (0, math.inf),
    "negativeInteger": (-math.inf, -1),
    "nonPositiveInteger": (-math.inf, 0),
    **{name: (-(2**bits), 2**bits - 1) for name, bits in _BITS.items()},
    **{f"unsigned{name.title()}": (0, 2 ** (bits + 1) - 1) for name, bits in _BITS.items()},
}
_TYPES: dict[str, type] = {
    **dict.fromkeys((XSD + name for name in _INTEGERS), int),
    **dict.fromkeys((XSD + "double", XSD + "float"), float),
    **dict.fromkeys((XSD + "dateTime", XSD + "dateTimeStamp"), dt.datetime),
    XSD + "boolean": bool,
    XSD + "decimal": decimal.Decimal,
    XSD + "date": dt.date,
    XSD + "string": str,
    XSD + "anyURI": str,
    RDF_LANG_STRING: str,
}


class LangString(str):
    """Text in a language.

    Examples
    --------
    >>> label = LangString("Tasse", "de")
    >>> label == "Tasse", label.language
    (True, 'de')
    """

    language: str
    __slots__ = ("language",)

    def __new__(cls, text: str, language: str) -> LangString:
        made = super().__new__(cls, text)
        made.language = language
        return made


def python_type(datatype: str) -> type:
    """Return the Python type of a datatype; ``object`` if any literal is accepted."""
    return _TYPES.get(datatype, object)


def encode(value: object, datatype: str) -> Literal:
    """Return the literal of a value.

    Parameters
    ----------
    datatype
        IRI of the datatype of the field; if it is unknown, the value determines the datatype.

    Raises
    ------
    ValueError
        With the expected kind of value as its message.

    Examples
    --------
    >>> print(encode(1, XSD + "double"))
    "1.0"^^<http://www.w3.org/2001/XMLSchema#double>
    >>> print(encode(3, XSD + "positiveInteger"))
    "3"^^<http://www.w3.org/2001/XMLSchema#positiveInteger>
    """
    if isinstance(value, Literal):
        if python_type(datatype) is object or value.datatype.value == datatype:
            return value
        value = decode(value)
    if isinstance(value, LangString) and datatype in (
        XSD + "string",
        RDF_LANG_STRING,
        RDFS_LITERAL,
    ):
        return Literal(str(value), language=value.language)
    expected = python_type(datatype)
    if expected is object and isinstance(value, LangString):
        return Literal(str(value), language=value.language)
    if expected is object:
        return literal(value)
    return _ENCODERS[expected](value, datatype)


def _integer(value: object, datatype: str) -> Literal:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("a whole number")
    low, high = _INTEGERS[datatype.removeprefix(XSD)]
    if not low <= value <= high:
        raise ValueError(f"a whole number {_range(low, high)}")
    return Literal(str(value), datatype=NamedNode(datatype))


def _range(low: float, high: float) -> str:
    if high == math.inf:
        return f"of {low} or more"
    return f"of {high} or less" if low == -math.inf else f"from {low} to {high}"


def _double(value: object, datatype: str) -> Literal:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("a number")
    try:
        number = float(value) + 0.0  # 0.0 and -0.0 are two values of a functional property
    except OverflowError:
        raise ValueError("a number within the range of a double") from None
    return Literal(repr(number), datatype=NamedNode(datatype))


def _boolean(value: object, datatype: str) -> Literal:
    if not isinstance(value, bool):
        raise ValueError("True or False")
    return Literal(value)


def _text(value: object, datatype: str) -> Literal:
    if not isinstance(value, str):
        raise ValueError("text")
    if datatype in (XSD + "string", RDF_LANG_STRING):
        return Literal(str(value))
    return Literal(value, datatype=NamedNode(datatype))


def _decimal(value: object, datatype: str) -> Literal:
    if isinstance(value, bool) or not isinstance(value, int | decimal.Decimal):
        raise ValueError("a Decimal")
    number = decimal.Decimal(value)
    if not number.is_finite():
        raise ValueError("a finite Decimal")
    return Literal(format(number, "f"), datatype=NamedNode(datatype))


def _datetime(value: object, datatype: str) -> Literal:
    if not isinstance(value, dt.datetime):
        raise ValueError("a datetime")
    if value.tzinfo is None:
        raise ValueError("a datetime with its time zone")
    text = value.isoformat().replace("+00:00", "Z")
    return Literal(text, datatype=NamedNode(datatype))


def _date(value: object, datatype: str) -> Literal:
    if isinstance(value, dt.datetime) or not isinstance(value, dt.date):
        raise ValueError("a date")
    return Literal(value.isoformat(), datatype=NamedNode(datatype))


_ENCODERS: dict[type, Callable[[object, str], Literal]] = {
    int: _integer,
    float: _double,
    bool: _boolean,
    str: _text,
    decimal.Decimal: _decimal,
    dt.datetime: _datetime,
    dt.date: _date,
}


def decode(term: Term) -> object:
    """Return the Python value of a literal; return other and ill-typed terms unchanged.

    Examples
    --------
    >>> decode(Literal(0.5)), decode(Literal("Tasse", language="de")), decode(Literal(True))
    (0.5, 'Tasse', True)
    """
    if not isinstance(term, Literal):
        return term
    if term.language is not None:
        return LangString(term.value, term.language)
    expected = python_type(term.datatype.value)
    try:
        if expected is bool:
            return {"true": True, "1": True, "false": False, "0": False}[term.value]
        if expected is dt.datetime:
            return dt.datetime.fromisoformat(term.value)
        if expected is dt.date:
            return dt.date.fromisoformat(term.value)
        return term if expected is object else expected(term.value)
    except (ValueError, KeyError, decimal.InvalidOperation):
        return term
