"""Serialisations: which one a document is written in, and its statements.

Errors carry file, line and column where the parser knows them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pyoxigraph import Quad, RdfFormat, parse

from rtask.errors import ParseError, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["read_document"]

_RDF: Mapping[str, RdfFormat] = {
    "ttl": RdfFormat.TURTLE,
    "turtle": RdfFormat.TURTLE,
    "trig": RdfFormat.TRIG,
    "nt": RdfFormat.N_TRIPLES,
    "ntriples": RdfFormat.N_TRIPLES,
    "nq": RdfFormat.N_QUADS,
    "nquads": RdfFormat.N_QUADS,
    "rdf": RdfFormat.RDF_XML,
    "xml": RdfFormat.RDF_XML,
    "rdfxml": RdfFormat.RDF_XML,
    "jsonld": RdfFormat.JSON_LD,
    "json": RdfFormat.JSON_LD,
    "n3": RdfFormat.N3,
}


def read_document(
    data: bytes | str | Path, format: RdfFormat | str | None = None, base: str | None = None
) -> list[Quad]:
    """Return the statements of a document; its blank nodes get new labels."""
    if isinstance(data, Path):
        source, name = data.read_bytes(), str(data)
        format = format or data.suffix.lstrip(".")
    else:
        source, name = (data.encode() if isinstance(data, str) else data), "<bytes>"
    if not isinstance(format, RdfFormat):
        known = _RDF.get((format or "").lower()) or RdfFormat.from_media_type(format or "")
        if known is None:
            raise UsageError(f"unknown format {format!r}")
        format = known
    try:
        return list(parse(source, format=format, base_iri=base, rename_blank_nodes=True))
    except SyntaxError as error:
        line, column = error.lineno or 0, error.offset or 0
        raise ParseError(
            f"{name}:{line}:{column}: {error.msg}", line=line, column=column
        ) from error
