"""What the store's parsers cannot be trusted with is refused before they see it.

They recurse on JSON-LD and on triple terms, expand XML entities without bound, and leave out,
without a word, what a JSON-LD document says about an IRI that is none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import IO
from xml.parsers import expat

from rtask.errors import ParseError, TooLargeError

__all__ = ["check_json_depth", "check_json_iris", "check_triple_term_depth", "check_xml"]

MAX_DEPTH = 256
_JSON = re.compile(rb'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]', re.S)
_STRING = rb'"((?:[^"\\]|\\.)*)"'
_ALIAS = re.compile(_STRING + rb'\s*:\s*"@id"')
_COERCED = re.compile(_STRING + rb'\s*:\s*\{[^{}]*"@type"\s*:\s*"@id"[^{}]*\}')
_NO_IRI = re.compile(r'[\x00-\x20<>"{}|\\^`]')
_TURTLE = re.compile(
    rb'"""(?:[^"\\]|\\.|"(?!""))*"""|"(?:[^"\\\n]|\\.)*"|<[^<>\s]*>|\#[^\n]*|<<\(?|\)?>>', re.S
)


def check_json_depth(data: bytes, name: str) -> None:
    """Refuse JSON nested deeper than 256.

    Raises
    ------
    TooLargeError
        Naming the depth allowed.
    """
    if data.count(b"{") + data.count(b"[") > MAX_DEPTH:
        _check_depth((m[0] for m in _JSON.finditer(data)), b"{[", b"}]", name)


def check_json_iris(data: bytes, name: str) -> None:
    """Refuse JSON-LD that names something by a text with characters no IRI may have (RFC 3987).

    Looked at are values of ``@id``, of its aliases and of terms declared ``"@type": "@id"``.

    Raises
    ------
    ParseError
        With the line, the column and the text.
    """
    keys = {b"@id", *(m[1] for pattern in (_ALIAS, _COERCED) for m in pattern.finditer(data))}
    keys.discard(b"@type")
    named = b"|".join(re.escape(key) for key in sorted(keys))
    for found in re.finditer(rb'"(?:' + named + rb')"\s*:\s*' + _STRING, data):
        try:
            text = json.loads(b'"' + found[1] + b'"')
        except ValueError:
            continue  # the parser says what is wrong with it
        if bad := _NO_IRI.search(text):
            line = data.count(b"\n", 0, found.start(1)) + 1
            column = found.start(1) - data.rfind(b"\n", 0, found.start(1))
            raise ParseError(
                f"{name}:{line}:{column}: {text!r} is no IRI: {bad[0]!r} must be written as "
                f"%{ord(bad[0]):02X}",
                line=line,
                column=column,
            )


def check_triple_term_depth(data: bytes, name: str) -> None:
    """Refuse triple terms nested deeper than 256."""
    if data.count(b"<<") > MAX_DEPTH:
        found = (m[0] for m in _TURTLE.finditer(data))
        _check_depth((t for t in found if b"<<" in t[:2] or b">>" in t[-2:]), b"<", b">)", name)


def _check_depth(tokens: Iterator[bytes], openers: bytes, closers: bytes, name: str) -> None:
    depth = 0
    for token in tokens:
        if token[0] in openers:
            depth += 1
        elif token[0] in closers:
            depth -= 1
        if depth > MAX_DEPTH:
            raise TooLargeError(f"{name}: nested deeper than {MAX_DEPTH}", limit="nesting")


def check_xml(stream: IO[bytes], name: str) -> None:
    """Read XML once for its form: line and column of errors, depth, entities.

    Raises
    ------
    ParseError
        Malformed, or an entity whose value names another or lies outside the document.
    TooLargeError
        Nested deeper than 256.
    """
    parser = expat.ParserCreate()
    depth = 0

    def fail(message: str) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        raise ParseError(f"{name}:{line}:{column}: {message}", line=line, column=column)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise TooLargeError(f"{name}: nested deeper than {MAX_DEPTH}", limit="nesting")

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1

    def entity(
        entity_name: str, is_parameter: bool, value: str | None, base: str | None, *outside: object
    ) -> None:
        if value is None:
            fail(f"entity {entity_name} lies outside the document")
        elif "&" in value or "%" in value:
            fail(f"entity {entity_name} names another entity")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = entity
    try:
        parser.ParseFile(stream)
    except expat.ExpatError as error:
        message = expat.ErrorString(error.code)
        line, column = error.lineno, error.offset + 1
        raise ParseError(f"{name}:{line}:{column}: {message}", line=line, column=column) from error
