"""Value spaces of the OWL 2 RL datatypes: identity, membership and order of literals.

Two literals are the same value iff their keys are equal (OWL 2 Syntax 4; XSD 1.1 part 2).
"""

from __future__ import annotations

import base64
import binascii
import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from reasoner.terms.vocabulary import DATATYPE_NAMES, RDF, XSD

BITS = {XSD + name: 1 << bit for bit, name in enumerate(DATATYPE_NAMES)}
Key = tuple[object, ...]
Order = bool | int | float | Fraction | str


@dataclass(frozen=True, slots=True)
class Value:
    """Value denoted by a literal.

    Attributes
    ----------
    key : tuple
        Equal iff the values are identical.
    mask : int
        One bit per supported datatype whose value space holds the value.
    order : bool, int, Fraction, float, str or None
        What `<` compares within a family; None where there is no order.
    family : str
        Values of different families are not comparable.
    well_typed : bool
        False if the lexical form does not belong to the datatype.
    is_recognized : bool
        False if the datatype is neither of XSD nor of RDF (RDF 1.1 Semantics 7): what the literal
        denotes is not known then, and may lie in any datatype and be any other literal's value.
    """

    key: Key
    mask: int
    order: Order | None
    family: str
    well_typed: bool = True
    is_recognized: bool = True


_WIDTHS = {"long": 64, "int": 32, "short": 16, "byte": 8}
_RANGES: dict[str, tuple[int | None, int | None]] = {
    "integer": (None, None),
    "nonNegativeInteger": (0, None),
    "nonPositiveInteger": (None, 0),
    "positiveInteger": (1, None),
    "negativeInteger": (None, -1),
    **{name: (-(1 << (w - 1)), (1 << (w - 1)) - 1) for name, w in _WIDTHS.items()},
    **{f"unsigned{name.title()}": (0, (1 << w) - 1) for name, w in _WIDTHS.items()},
}
"""Inclusive bounds of the integer datatypes; None is unbounded."""

_NAME_START = (
    r"A-Za-z_:\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u2070-\ufffd"
)
_NAME = rf"[{_NAME_START}\-.0-9\u00b7\u0300-\u036f]"
_STRINGS = {
    "normalizedString": re.compile(r"[^\t\n\r]*"),
    "token": re.compile(r"(?:[^\s]+(?: [^\s]+)*)?"),
    "language": re.compile(r"[a-zA-Z]{1,8}(?:-[a-zA-Z0-9]{1,8})*"),
    "NMTOKEN": re.compile(rf"{_NAME}+"),
    "Name": re.compile(rf"[{_NAME_START}]{_NAME}*"),
    "NCName": re.compile(rf"(?!.*:)[{_NAME_START}]{_NAME}*"),
}
_INTEGER = re.compile(r"[+-]?\d+")
_DECIMAL = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)")
_FLOAT = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[+-]?INF|NaN")
_DATE_TIME = re.compile(
    r"(-?\d{4,})-(\d\d)-(\d\d)T(\d\d):(\d\d):(\d\d(?:\.\d+)?)(Z|[+-]\d\d:\d\d)?"
)


@lru_cache(maxsize=65_536)
def value_of(lexical: str, datatype: str, language: str | None = None) -> Value:
    """Return the value of a literal; unknown datatypes are opaque, each pair a value of its own.

    >>> one = value_of("1", XSD + "integer")
    >>> one.key == value_of("1.0", XSD + "decimal").key == value_of("+01", XSD + "byte").key
    True
    >>> one.key == value_of("1", XSD + "double").key
    False
    >>> value_of("abc", XSD + "integer").well_typed
    False
    >>> value_of("0 0 1", "urn:lab:vector").is_recognized
    False
    """
    if language is not None:
        # Tags are compared without regard to case (RDF 1.1 Concepts 3.3).
        return Value(("tagged", lexical, language.lower()), 0, None, "tagged")
    if datatype == XSD + "string":
        return _string(lexical)
    if not datatype.startswith(XSD) and datatype != RDF + "PlainLiteral":
        # The value spaces of RDF's own types, such as XMLLiteral, are disjoint from those of XSD.
        is_recognized = datatype.startswith(RDF)
        return Value(("opaque", lexical, datatype), 0, None, datatype, is_recognized=is_recognized)
    name = datatype[len(XSD) :]
    value = _read(lexical, name)
    if value is None:
        is_supported = datatype in BITS
        return Value(("opaque", lexical, datatype), 0, None, datatype, well_typed=not is_supported)
    if datatype in BITS and not value.mask & BITS[datatype]:
        return Value(("opaque", lexical, datatype), 0, None, datatype, well_typed=False)
    return value


def _read(lexical: str, name: str) -> Value | None:
    """Return the value of a lexical form in a built-in datatype, None if it has none."""
    if name in _STRINGS:
        return _string(lexical)
    lexical = lexical.strip(" \t\n\r")
    if name == "decimal" or name in _RANGES:
        pattern = _DECIMAL if name == "decimal" else _INTEGER
        return _number(Fraction(lexical)) if pattern.fullmatch(lexical) else None
    if name in ("double", "float"):
        return _floating(lexical, name)
    if name == "boolean":
        truth = {"true": True, "1": True, "false": False, "0": False}.get(lexical)
        if truth is None:
            return None
        return Value(("boolean", truth), BITS[XSD + name], truth, "boolean")
    if name in ("dateTime", "dateTimeStamp"):
        return _date_time(lexical)
    if name in ("hexBinary", "base64Binary"):
        return _binary(lexical, name)
    if name == "anyURI":
        return Value(("uri", lexical), BITS[XSD + name], lexical, "uri")
    return None


def _string(text: str) -> Value:
    mask = BITS[XSD + "string"]
    for name, pattern in _STRINGS.items():
        if pattern.fullmatch(text):
            mask |= BITS[XSD + name]
    return Value(("string", text), mask, text, "string")


def _number(number: Fraction) -> Value:
    mask = BITS[XSD + "decimal"]
    if number.denominator != 1:
        return Value(("number", number), mask, number, "number")
    whole = number.numerator
    for name, (low, high) in _RANGES.items():
        if (low is None or whole >= low) and (high is None or whole <= high):
            mask |= BITS[XSD + name]
    return Value(("number", whole), mask, whole, "number")


def _floating(lexical: str, name: str) -> Value | None:
    """Identity is by bits, so +0 and -0 differ and NaN equals itself (OWL 2 Syntax 4.2)."""
    if not _FLOAT.fullmatch(lexical):
        return None
    number = float(lexical.replace("INF", "inf"))
    if name == "double":
        key: Key = (name, struct.pack(">d", number))
    else:
        try:
            packed = struct.pack(">f", number)
        except OverflowError:
            # XSD rounds to infinity what `struct` refuses to round.
            packed = struct.pack(">f", float("inf") if number > 0 else float("-inf"))
        number = struct.unpack(">f", packed)[0]
        key = (name, packed)
    return Value(key, BITS[XSD + name], number, "number")


def _binary(lexical: str, name: str) -> Value | None:
    try:
        if name == "hexBinary":
            content = binascii.unhexlify(lexical)
        else:
            content = base64.b64decode("".join(lexical.split()), validate=True)
    except (binascii.Error, ValueError):
        return None
    return Value((name, content), BITS[XSD + name], None, name)


def _date_time(lexical: str) -> Value | None:
    match = _DATE_TIME.fullmatch(lexical)
    if not match:
        return None
    year, month, day, hour, minute = (int(part) for part in match.groups()[:5])
    second = Fraction(match[6]) if "." in match[6] else int(match[6])
    if not (1 <= month <= 12 and 1 <= day <= _days_of(year, month) and minute < 60 and second < 60):
        return None
    # 24:00:00 is the midnight that ends a day (XSD 1.1 part 2, 3.3.7).
    if hour > 24 or (hour == 24 and (minute or second)):
        return None
    zone = match[7]
    offset = 0
    if zone and zone != "Z":
        offset = (int(zone[1:3]) * 60 + int(zone[4:])) * (-1 if zone[0] == "-" else 1)
    local = ((_day_number(year, month, day) * 24 + hour) * 60 + minute - offset) * 60 + second
    mask = BITS[XSD + "dateTime"] | (BITS[XSD + "dateTimeStamp"] if zone else 0)
    family = "instant" if zone else "local time"
    # One instant in two zones is equal but not identical (XSD 1.1 part 2, 2.2), and keys are of
    # identity: hence the offset.
    return Value((family, local, offset), mask, local, family)


def _days_of(year: int, month: int) -> int:
    if month == 2:
        return 29 if year % 4 == 0 and (year % 100 != 0 or year % 400 == 0) else 28
    return 30 if month in (4, 6, 9, 11) else 31


def _day_number(year: int, month: int, day: int) -> int:
    """Days in the proleptic Gregorian calendar, for any year (XSD 1.1 part 2, E.3.3)."""
    year -= month <= 2
    era, of_era = divmod(year, 400)
    of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146_097 + of_era * 365 + of_era // 4 - of_era // 100 + of_year


def compare(left: Value, right: Value) -> int | None:
    """Order two values as SPARQL does: negative, zero, positive, or None if not comparable.

    >>> compare(value_of("2", XSD + "integer"), value_of("1.5e0", XSD + "double"))
    1
    """
    if left.family != right.family or left.order is None or right.order is None:
        return None
    a, b = left.order, right.order
    if isinstance(a, float) or isinstance(b, float):
        a, b = float(a), float(b)
        if a != a or b != b:
            return None
    return (a > b) - (a < b)  # type: ignore[operator]


_WIDER = {
    "normalizedString": "string", "token": "normalizedString", "language": "token",
    "NMTOKEN": "token", "Name": "token", "NCName": "Name", "dateTimeStamp": "dateTime",
    "integer": "decimal",
}  # fmt: skip


def is_within(ranges: Iterable[str], datatype: str) -> bool:
    """Tell whether every literal that lies in all of some datatypes lies in another one.

    >>> is_within([XSD + "short", XSD + "unsignedInt"], XSD + "unsignedShort")
    True
    >>> is_within([XSD + "short"], XSD + "unsignedByte")
    False
    """
    numeric = [r for r in ranges if r in BITS]
    names = {name for r in numeric for name in _chain(r.removeprefix(XSD))}
    target = datatype.removeprefix(XSD)
    if target in names:
        return True
    bounds = [_RANGES[name] for name in names if name in _RANGES]
    if target not in _RANGES or not bounds:
        return False
    low = max((a for a, _ in bounds if a is not None), default=None)
    high = min((b for _, b in bounds if b is not None), default=None)
    if low is not None and high is not None and low > high:
        return True
    floor, ceiling = _RANGES[target]
    return (floor is None or (low is not None and low >= floor)) and (
        ceiling is None or (high is not None and high <= ceiling)
    )


def _chain(name: str) -> Iterator[str]:
    """Yield a datatype's name and those of the datatypes it is derived from."""
    yield name
    if name in _RANGES and name != "integer":
        name = "integer"
        yield name
    while name in _WIDER:
        name = _WIDER[name]
        yield name
