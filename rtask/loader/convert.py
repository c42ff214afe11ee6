"""OWL/XML, functional and Manchester syntax, by way of RDF/XML (py-horned-owl)."""

from __future__ import annotations

import re
from typing import Literal

from rtask.errors import ParseError

__all__ = ["to_rdf_xml"]

_LINE_AND_COLUMN = re.compile(r"line_col: Pos\(\((\d+), (\d+)\)\)")
_BYTES = re.compile(r"BytePosition\((\d+)\)")
_LINE_TEXT = re.compile(r'line: "((?:[^"\\]|\\.)*)"')
_QUOTED = re.compile(r'"((?:[^"\\]|\\.)*)"')


def to_rdf_xml(text: str, syntax: Literal["owx", "ofn", "omn"], name: str) -> bytes:
    """Return an ontology as RDF/XML.

    Parameters
    ----------
    syntax
        ``owx`` (OWL/XML), ``ofn`` (functional) or ``omn`` (Manchester).

    Raises
    ------
    ParseError
        With line and column where the parser knows them.
    """
    import pyhornedowl

    try:
        ontology = pyhornedowl.open_ontology_from_string(text, serialization=syntax)
        written: str = ontology.save_to_string("owl")
    except ValueError as error:
        raise _explain(str(error), text, name) from error
    return written.encode()


def _explain(message: str, text: str, name: str) -> ParseError:
    found = _LINE_AND_COLUMN.search(message)
    if found:
        line, column = int(found[1]), int(found[2])
        near = _LINE_TEXT.search(message)
        reason = f"cannot read {near[1].strip()[:60]!r}" if near else "cannot read this"
    else:
        at = _BYTES.search(message)
        before = text.encode()[: int(at[1])] if at else b""
        line = before.count(b"\n") + 1
        column = len(before) - before.rfind(b"\n")
        quoted = _QUOTED.search(message)
        reason = quoted[1] if quoted else message[:200]
    return ParseError(f"{name}:{line}:{column}: {reason}", line=line, column=column)
