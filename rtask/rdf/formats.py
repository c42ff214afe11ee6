"""Serialisation formats: detect the format of a document and read its statements."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal

from pyoxigraph import Quad, RdfFormat, parse

from rtask.errors import ParseError, TooLargeError, UsageError
from rtask.rdf.documents import Document
from rtask.rdf.guards import (
    check_json_depth,
    check_json_iris,
    check_nesting,
    check_xml,
)

__all__ = ["Format", "detect", "find_format", "read_document", "statements"]


@dataclass(frozen=True)
class Format:
    """A serialisation that can be loaded.

    Parameters
    ----------
    name
        Name of the format, as passed to ``--format``.
    extensions
        File name extensions, without dot.
    rdf
        The store's parser; ``None`` for syntaxes of OWL.
    owl
        py-horned-owl's name of the syntax; ``None`` for formats of RDF.
    """

    name: str
    extensions: tuple[str, ...]
    rdf: RdfFormat | None = None
    owl: Literal["owx", "ofn", "omn"] | None = None


FORMATS = (
    Format("turtle", ("ttl", "turtle"), RdfFormat.TURTLE),
    Format("trig", ("trig",), RdfFormat.TRIG),
    Format("ntriples", ("nt",), RdfFormat.N_TRIPLES),
    Format("nquads", ("nq",), RdfFormat.N_QUADS),
    Format("rdfxml", ("rdf", "rdfs"), RdfFormat.RDF_XML),
    Format("jsonld", ("jsonld", "json-ld", "json"), RdfFormat.JSON_LD),
    Format("n3", ("n3",), RdfFormat.N3),
    Format("owlxml", ("owx",), owl="owx"),
    Format("functional", ("ofn", "fss", "owf"), owl="ofn"),
    Format("manchester", ("omn", "man"), owl="omn"),
)
_BY_NAME = {form.name: form for form in FORMATS} | {
    extension: form for form in FORMATS for extension in form.extensions
}
_SCANNED_BYTES = 64 << 20
_LINES = (RdfFormat.N_TRIPLES, RdfFormat.N_QUADS)
"""Nothing in them nests but triple terms, which few large files have."""
_QUOTED = re.compile(r"'(?P<text>[^']+)'|prefix (?P<prefix>\S+:)")
_OWL_LINE_AND_COLUMN = re.compile(r"line_col: Pos\(\((\d+), (\d+)\)\)")
_OWL_BYTES = re.compile(r"BytePosition\((\d+)\)")
_OWL_LINE_TEXT = re.compile(r'line: "((?:[^"\\]|\\.)*)"')
_OWL_QUOTED = re.compile(r'"((?:[^"\\]|\\.)*)"')
_SPACE = re.compile(
    rb"(?:\s|#[^\n]*\n|<!--.*?-->|<\?.*?\?>|<!DOCTYPE[^\[>]*(?:\[.*?\]\s*)?>)*", re.S
)
_SNIFFS = (
    (re.compile(rb"<(?:\w+:)?RDF[\s>]"), "rdfxml"),
    (re.compile(rb"<(?:\w+:)?Ontology[\s>]"), "owlxml"),
    (re.compile(rb"(?:Prefix|Ontology)\s*\("), "functional"),
    (re.compile(rb"(?:Prefix|Ontology)\s*:"), "manchester"),
    (re.compile(rb"[{\[]\s*[\"{\[}\]]"), "jsonld"),
    (re.compile(rb"@(?:prefix|base|version)\b|(?:PREFIX|BASE|VERSION)\s", re.I), "turtle"),
    (re.compile(rb"<[^<>\s]*>\s+<[^<>\s]*>\s+[^\n]*\.\s"), "ntriples"),
)


def find_format(name: str | RdfFormat) -> Format:
    """Return a format by its name, extension or media type.

    >>> find_format("text/turtle").name, find_format("owx").name
    ('turtle', 'owlxml')

    Raises
    ------
    UsageError
        The format is unknown; the error lists the names.
    """
    rdf = name if isinstance(name, RdfFormat) else None
    if rdf is None:
        format_ = _BY_NAME.get(str(name).lower().lstrip("."))
        if format_ is not None:
            return format_
        rdf = RdfFormat.from_media_type(str(name).partition(";")[0].strip())
    for form in FORMATS:
        if form.rdf is not None and form.rdf == rdf:
            return form
    names = ", ".join(form.name for form in FORMATS)
    raise UsageError(f"unknown format {str(name)!r}; one of {names}")


def sniff(head: bytes) -> Format | None:
    """Guess the format from the first bytes.

    >>> sniff(b"# mugs\\nPrefix: e: <urn:e#>").name
    'manchester'
    """
    space = _SPACE.match(head)
    start = head[space.end() if space else 0 :]
    for pattern, name in _SNIFFS:
        if pattern.match(start):
            return _BY_NAME[name]
    return None


def detect(document: Document) -> Format:
    """Return the format of a document: by extension, else by its first bytes.

    Raises
    ------
    UsageError
        If neither identifies the format.
    """
    format_ = _BY_NAME.get(document.extension)
    if format_ is not None:
        return format_
    guessed = sniff(document.head())
    if guessed is None:
        raise UsageError(
            f"{document.name}: cannot tell the format; name it with --format "
            f"({', '.join(form.name for form in FORMATS)})"
        )
    return guessed


def statements(document: Document, form: Format, base: str | None = None) -> Iterator[Quad]:
    """Yield the statements of a document; its blank nodes get new labels.

    Raises
    ------
    ParseError
        ``FILE:LINE:COLUMN: reason``.
    """
    try:
        with _readable(document, form) as stream:
            rdf = form.rdf or RdfFormat.RDF_XML
            yield from parse(stream, format=rdf, base_iri=base, rename_blank_nodes=True)
    except (SyntaxError, UnicodeDecodeError) as error:
        raise explain(error, document, form) from error
    except ValueError as error:
        raise ParseError(f"{document.name}: {error}") from error
    except MemoryError as error:  # the parser's own bound, not that of the machine
        raise TooLargeError(
            f"{document.name}: a comment, literal or name without an end within 16 MiB ({error})",
            limit="token",
        ) from error


def _readable(document: Document, form: Format) -> IO[bytes]:
    """Return the document in a form that is safe for the store's parser."""
    if form.owl:
        with document.open() as stream:
            if form.owl == "owx":
                check_xml(stream, document.name)
            else:
                check_nesting(stream.read(), document.name)
        return io.BytesIO(_owl_to_rdf_xml(document.text(), form.owl, document.name))
    if form.rdf == RdfFormat.RDF_XML:
        with document.open() as stream:
            check_xml(stream, document.name)
        return document.open()
    if form.rdf == RdfFormat.JSON_LD:
        with document.open() as stream:
            data = stream.read()
        check_json_depth(data, document.name)
        check_json_iris(data, document.name)
        return io.BytesIO(data)
    if form.rdf in _LINES and document.size >= _SCANNED_BYTES:
        return document.open()
    with document.open() as stream:
        data = stream.read()
    check_nesting(data, document.name)
    return io.BytesIO(data)


def _owl_to_rdf_xml(text: str, syntax: Literal["owx", "ofn", "omn"], name: str) -> bytes:
    """Convert OWL/XML, functional or Manchester syntax to RDF/XML with py-horned-owl.

    Parameters
    ----------
    syntax
        ``owx`` (OWL/XML), ``ofn`` (functional) or ``omn`` (Manchester).

    Raises
    ------
    ParseError
        The text does not parse; gives line and column if the parser reports them.
    """
    import pyhornedowl

    try:
        ontology = pyhornedowl.open_ontology_from_string(text, serialization=syntax)
        written: str = ontology.save_to_string("owl")
    except ValueError as error:
        raise _owl_error(str(error), text, name) from error
    return written.encode()


def _owl_error(message: str, text: str, name: str) -> ParseError:
    matched = _OWL_LINE_AND_COLUMN.search(message)
    if matched:
        line, column = int(matched[1]), int(matched[2])
        near = _OWL_LINE_TEXT.search(message)
        reason = f"cannot read {near[1].strip()[:60]!r}" if near else "cannot read this"
    else:
        at = _OWL_BYTES.search(message)
        before = text.encode()[: int(at[1])] if at else b""
        line = before.count(b"\n") + 1
        column = len(before) - before.rfind(b"\n")
        quoted = _OWL_QUOTED.search(message)
        reason = quoted[1] if quoted else message[:200]
    return ParseError(f"{name}:{line}:{column}: {reason}", line=line, column=column)


def explain(error: Exception, document: Document, form: Format) -> ParseError:
    """Convert a parser's error to one that gives file, line and column."""
    line = getattr(error, "lineno", None)
    column = getattr(error, "offset", None)
    if line is None:
        line, column = _locate(str(error), document)
    where = f"{document.name}:{line}:{column}" if line else document.name
    looks = sniff(document.head())
    hint = ""
    if looks is not None and looks.name != form.name:
        hint = f" (read as {form.name}; it looks like {looks.name})"
    message = getattr(error, "msg", None) or str(error)
    return ParseError(f"{where}: {message}{hint}", line=line, column=column)


def _locate(message: str, document: Document) -> tuple[int, int] | tuple[None, None]:
    """Locate the text that an error quotes, for parsers that report no position.

    The first place; RDF/XML (and a prefix or IRI that is wrong is mostly wrong at once).
    """
    matched = _QUOTED.search(message)
    if matched is None:
        return None, None
    term = (matched["text"] or matched["prefix"]).encode()
    with document.open() as stream:
        for number, line in enumerate(stream, 1):
            at = line.find(term)
            if at >= 0:
                return number, len(line[:at].decode("utf-8", "replace")) + 1
    return None, None


def read_document(
    data: bytes | str | Path, format: RdfFormat | str | None = None, base: str | None = None
) -> list[Quad]:
    """Return all statements of a document.

    Parameters
    ----------
    data
        A path, or the content.
    format
        Name, extension or media type; detected if not given.
    """
    source = data.encode() if isinstance(data, str) else data
    document = Document.of(source)
    form = detect(document) if format is None else find_format(format)
    return list(statements(document, form, base))
