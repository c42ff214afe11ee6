"""Checks of documents before they reach the store's parsers.

The parsers recurse on JSON-LD, on triple terms and on syntaxes of OWL, expand XML entities without
bound, and silently drop the JSON-LD statements about an invalid IRI.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any
from xml.parsers import expat

from rtask.errors import ParseError, TooLargeError
from rtask.rdf.bounds import MAX_NESTING

__all__ = [
    "check_json_depth",
    "check_json_iris",
    "check_nesting",
    "check_xml",
    "undefined_json_terms",
]

_JSON = re.compile(rb'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]', re.S)
_STRING = rb'"((?:[^"\\]|\\.)*)"'
_ALIAS = re.compile(_STRING + rb'\s*:\s*"@id"')
_COERCED = re.compile(_STRING + rb'\s*:\s*\{[^{}]*"@type"\s*:\s*"@id"[^{}]*\}')
_NO_IRI = re.compile(r'[\x00-\x20<>"{}|\\^`]')
_OPAQUE = re.compile(
    rb'"""[^"\\]*(?:(?:\\.|"(?!""))[^"\\]*)*"""|"[^"\\\n]*(?:\\.[^"\\\n]*)*"'
    rb"|'''[^'\\]*(?:(?:\\.|'(?!''))[^'\\]*)*'''|'[^'\\\n]*(?:\\.[^'\\\n]*)*'"
    rb"|<(?!=)[^<>\s]*>|\#[^\n]*|\\.",
    re.S,
)
"""Strings, IRIs, comments and escaped signs; N3 has an arrow ``<=``."""
_NO_BRACKETS = bytes(set(range(256)) - set(b"()[]{}"))
_CHUNK = 1 << 20


def check_json_depth(data: bytes, name: str) -> None:
    """Refuse JSON nested deeper than :data:`MAX_NESTING`.

    Raises
    ------
    TooLargeError
        The document is nested more deeply; the error gives the limit.
    """
    if data.count(b"{") + data.count(b"[") > MAX_NESTING:
        _check_depth((m[0] for m in _JSON.finditer(data)), b"{[", b"}]", name)


def check_json_iris(data: bytes, name: str) -> None:
    """Refuse JSON-LD identifiers with characters that no IRI may contain (RFC 3987).

    The check covers values of ``@id``, of its aliases and of terms declared ``"@type": "@id"``.

    Raises
    ------
    ParseError
        An identifier is invalid; gives line, column and text.
    """
    keys = {b"@id", *(m[1] for pattern in (_ALIAS, _COERCED) for m in pattern.finditer(data))}
    keys.discard(b"@type")
    named = b"|".join(re.escape(key) for key in sorted(keys))
    for matched in re.finditer(rb'"(?:' + named + rb')"\s*:\s*' + _STRING, data):
        try:
            text = json.loads(b'"' + matched[1] + b'"')
        except ValueError:
            continue  # the parser reports the error
        if bad := _NO_IRI.search(text):
            line = data.count(b"\n", 0, matched.start(1)) + 1
            column = matched.start(1) - data.rfind(b"\n", 0, matched.start(1))
            raise ParseError(
                f"{name}:{line}:{column}: {text!r} is not an IRI: write {bad[0]!r} as "
                f"%{ord(bad[0]):02X}",
                line=line,
                column=column,
            )


def undefined_json_terms(data: bytes) -> list[str]:
    """Return the keys of JSON-LD that no context defines, which a processor leaves out, sorted.

    JSON-LD 1.1 API, 5.1.2 (expansion), step 13.4. The list is empty where only a full processor
    could decide: remote contexts, term-scoped contexts and documents that are not JSON.
    """
    undefined: set[str] = set()
    try:
        _find_undefined(json.loads(data), _Context(), undefined)
    except (ValueError, _CannotTell):
        return []
    return sorted(undefined)


class _CannotTell(Exception):
    """Only a full JSON-LD processor could interpret the document."""


@dataclass(frozen=True)
class _Context:
    terms: frozenset[str] = frozenset()
    maps: frozenset[str] = frozenset()
    opaque: frozenset[str] = frozenset()
    has_vocabulary: bool = False

    def joined(self, local: Any) -> _Context:
        if isinstance(local, list):
            joined = self
            for context in local:
                joined = joined.joined(context)
            return joined
        if local is None:
            return _Context()
        if not isinstance(local, dict) or "@import" in local:
            raise _CannotTell
        terms, maps, opaque = set(self.terms), set(self.maps), set(self.opaque)
        for term, meaning in local.items():
            if isinstance(meaning, dict) and "@context" in meaning:
                raise _CannotTell
            if not term.startswith("@"):
                terms.add(term)
                if isinstance(meaning, dict):
                    if meaning.get("@container", "@set") not in ("@set", "@list"):
                        maps.add(term)
                    if meaning.get("@type") == "@json":
                        opaque.add(term)
        vocabulary = local.get("@vocab", self.has_vocabulary)
        has_vocabulary = vocabulary is not None and vocabulary is not False
        return _Context(frozenset(terms), frozenset(maps), frozenset(opaque), has_vocabulary)


def _find_undefined(value: Any, context: _Context, undefined: set[str]) -> None:
    if isinstance(value, list):
        for item in value:
            _find_undefined(item, context, undefined)
    if not isinstance(value, dict):
        return
    if "@context" in value:
        context = context.joined(value["@context"])
    for key, inner in value.items():
        if key == "@context" or key in context.opaque:
            continue
        defined = key.startswith("@") or ":" in key or key in context.terms
        if not defined and not context.has_vocabulary:
            undefined.add(key)
        elif key in context.maps and isinstance(inner, dict):
            _find_undefined(list(inner.values()), context, undefined)
        else:
            _find_undefined(inner, context, undefined)


def check_nesting(data: bytes, name: str) -> None:
    """Refuse Turtle, TriG, N3 or a syntax of OWL nested deeper than :data:`MAX_NESTING`.

    Counts lists, blank nodes, graphs, formulas and triple terms, outside of strings, IRIs and
    comments.

    Raises
    ------
    TooLargeError
        The document is nested more deeply; the error gives the limit.
    """
    if sum(map(data.count, (b"[", b"(", b"{", b"<<"))) <= MAX_NESTING:
        return
    import numpy as np

    steps = np.zeros(256, np.int8)
    steps[list(b"[({")], steps[list(b"])}")] = 1, -1
    text = _OPAQUE.sub(b"", data)
    for mark, bracket in ((b"<<(", b"{"), (b")>>", b"}"), (b"<<", b"{"), (b">>", b"}")):
        text = text.replace(mark, bracket)
    brackets = text.translate(None, _NO_BRACKETS)
    depth = 0
    for start in range(0, len(brackets), _CHUNK):
        signs = np.frombuffer(brackets, np.uint8, min(_CHUNK, len(brackets) - start), start)
        depths = np.cumsum(steps[signs], dtype=np.int32) + depth
        if depths.max() > MAX_NESTING:
            raise TooLargeError(f"{name}: nested deeper than {MAX_NESTING}", limit="nesting")
        depth = int(depths[-1])


def _check_depth(tokens: Iterator[bytes], openers: bytes, closers: bytes, name: str) -> None:
    depth = 0
    for token in tokens:
        if token[0] in openers:
            depth += 1
        elif token[0] in closers:
            depth -= 1
        if depth > MAX_NESTING:
            raise TooLargeError(f"{name}: nested deeper than {MAX_NESTING}", limit="nesting")


def check_xml(stream: IO[bytes], name: str) -> None:
    """Check that XML is well-formed, not too deep and without dangerous entities.

    Raises
    ------
    ParseError
        The document is malformed or in an encoding that cannot be read, or an entity refers to
        another entity or to an external file.
    TooLargeError
        Nested deeper than :data:`MAX_NESTING`.
    """
    parser = expat.ParserCreate()
    depth = 0

    def fail(message: str) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        raise ParseError(f"{name}:{line}:{column}: {message}", line=line, column=column)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_NESTING:
            raise TooLargeError(f"{name}: nested deeper than {MAX_NESTING}", limit="nesting")

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1

    def entity(
        entity_name: str, is_parameter: bool, value: str | None, base: str | None, *outside: object
    ) -> None:
        if value is None:
            fail(f"entity {entity_name} is external; write its text into the document")
        elif "&" in value or "%" in value:
            fail(f"entity {entity_name} refers to another entity; write its text out")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = entity
    try:
        parser.ParseFile(stream)
    except expat.ExpatError as error:
        message = expat.ErrorString(error.code)
        line, column = error.lineno, error.offset + 1
        raise ParseError(f"{name}:{line}:{column}: {message}", line=line, column=column) from error
    except (LookupError, ValueError) as error:  # of its encoding
        raise ParseError(f"{name}:1:1: {error}; write the document in UTF-8", line=1) from error
