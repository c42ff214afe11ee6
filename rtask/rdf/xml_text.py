"""XML that every parser can read, whatever the literals of an answer hold.

The store writes the characters of literals into XML as they are: a carriage return, which parsers
turn into a line feed (XML 1.0, 2.11), and control characters, which no document may hold (2.2).
Carriage returns are written as references here; characters without any representation are
replaced by U+FFFD, and a comment at the end of the document gives their number.

Readers of the knowledge base import this file; it needs only the standard library and pyoxigraph.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import IO, Any

import pyoxigraph as ox

__all__ = ["XmlWriter", "is_xml", "serialize", "writable"]

_TO_CHANGE = re.compile(rb"\r|[\x00-\x08\x0b\x0c\x0e-\x1f]|\xef\xbf[\xbe\xbf]")
_REPLACEMENT = "\ufffd".encode()
_NAME_START = (
    "A-Z_a-z\u00c0-\u00d6\u00d8-\u00f6\u00f8-\u02ff\u0370-\u037d\u037f-\u1fff\u200c-\u200d"
    "\u2070-\u218f\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\ufffd\U00010000-\U000effff"
)
_LOCAL_NAME = re.compile(f"[{_NAME_START}][{_NAME_START}\\-.0-9\u00b7\u0300-\u036f\u203f-\u2040]*$")


class XmlWriter:
    r"""File-like writer that passes on well-formed XML.

    Parameters
    ----------
    sink
        Where the document goes.

    Examples
    --------
    >>> import io
    >>> out = io.BytesIO()
    >>> xml = XmlWriter(out)
    >>> xml.write(b"<p>a\r\nb\x07</p>")
    12
    >>> xml.finish()
    >>> out.getvalue().partition(b"<!--")[0].decode()
    '<p>a&#13;\nb\ufffd</p>\n'
    """

    replaced = 0
    _held = b""

    def __init__(self, sink: Any) -> None:
        self._sink = sink

    def write(self, data: bytes) -> int:
        """Pass on a piece; the beginning of a character at its end waits for the next one."""
        size = len(data)
        data = self._held + data if self._held else data
        cut = len(data)
        if data.endswith(b"\xef\xbf"):
            cut -= 2
        elif data.endswith(b"\xef"):
            cut -= 1
        self._held = data[cut:]
        self._sink.write(_TO_CHANGE.sub(self._changed, data[:cut]))
        return size

    def flush(self) -> None:
        """Do nothing: the sink decides when to send."""

    def finish(self) -> None:
        """Say at the end of the document how many characters were replaced, if any."""
        if self.replaced:
            some = "1 character was" if self.replaced == 1 else f"{self.replaced} characters were"
            self._sink.write(
                f"\n<!-- {some} replaced by U+FFFD, because XML 1.0 cannot represent control "
                "characters; ask for another format -->".encode()
            )

    def _changed(self, match: re.Match[bytes]) -> bytes:
        if match[0] == b"\r":
            return b"&#13;"
        self.replaced += 1
        return _REPLACEMENT


def is_xml(form: ox.RdfFormat | ox.QueryResultsFormat) -> bool:
    """Whether a format is one of XML."""
    return form in (ox.RdfFormat.RDF_XML, ox.QueryResultsFormat.XML)


def serialize(result: Any, sink: IO[bytes] | Any, form: Any) -> None:
    """Write the result of a query in a format; XML so that it can be read.

    Parameters
    ----------
    result
        Solutions, a truth value or triples of pyoxigraph.

    Raises
    ------
    ValueError
        A property cannot be the name of an element of RDF/XML.
    """
    if not is_xml(form):
        result.serialize(sink, form)
        return
    xml = XmlWriter(sink)
    target: Any = xml
    if form == ox.RdfFormat.RDF_XML:
        ox.serialize(writable(result), target, form)
    else:
        result.serialize(target, form)
    xml.finish()


def writable(triples: Iterable[ox.Triple]) -> Iterator[ox.Triple]:
    """Yield triples that RDF/XML can express.

    Raises
    ------
    ValueError
        A property ends in no letter-led name, and so cannot be the name of an element (RDF 1.1
        XML Syntax, 5.1): the store would write an element without a name.
    """
    for triple in triples:
        if not _is_nameable(triple.predicate.value):
            raise ValueError(
                f"RDF/XML cannot write the property <{triple.predicate.value}>: the part of an "
                "XML name after the namespace must begin with a letter; ask for Turtle"
            )
        yield triple


@lru_cache(maxsize=10_000)
def _is_nameable(iri: str) -> bool:
    r"""Whether an IRI has an ending that can be the local name of an element.

    >>> [_is_nameable(iri) for iri in ("urn:x#grasp-of", "urn:x#12", "urn:x#a%41")]
    [True, False, False]
    """
    return _LOCAL_NAME.search(iri) is not None
