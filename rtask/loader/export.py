"""Export of graphs in RDF formats, and of the documents that they were loaded from."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, serialize

import ontology
from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.formats import find_format
from rtask.rdf.terms import XSD, DefaultGraph, GraphName, iri
from rtask.rdf.xml_text import XmlWriter, writable

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["dump", "original"]

_OWL = "http://www.w3.org/2002/07/owl#"
_CARDINALITIES = frozenset(
    NamedNode(_OWL + prefix + "ardinality")
    for prefix in ("c", "minC", "maxC", "qualifiedC", "minQualifiedC", "maxQualifiedC")
)
_NON_NEGATIVE = NamedNode(XSD + "nonNegativeInteger")


def dump(
    kb: GraphCore,
    target: Path | str | IO[bytes],
    format: RdfFormat | str | None = None,
    graphs: Iterable[NamedNode | str] | None = None,
    inferred: bool = False,
) -> int:
    """Write graphs; return the number of statements.

    Parameters
    ----------
    target
        File to create or replace, or an open file.
    format
        Name, extension or media type; taken from the file's extension if not given. Formats
        without graph names write one graph, or several merged.
    graphs
        Graphs to write; all asserted graphs if not given.
    inferred
        Whether to write derived statements, too.
    """
    rdf = _format(target, format)
    names = _chosen(kb, graphs, inferred)
    quads = _statements(kb, names, rdf.supports_datasets)
    if not isinstance(target, str | Path):
        return _write(quads, target, rdf)
    path = Path(target)
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("wb") as out:
            count = _write(quads, out, rdf)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return count


def _format(target: Path | str | IO[bytes], format: RdfFormat | str | None) -> RdfFormat:
    if format is None:
        if not isinstance(target, str | Path):
            raise UsageError("the format is required when writing to a stream; pass format=")
        format = Path(target).suffix.lstrip(".") or "trig"
    rdf_format = find_format(format).rdf
    if rdf_format is None:
        raise UsageError(f"{format} can be read but not written; use turtle or rdfxml")
    return rdf_format


def _chosen(
    kb: GraphCore, graphs: Iterable[NamedNode | str] | None, inferred: bool
) -> list[GraphName]:
    all_graphs = [*kb.store.named_graphs(), *([DefaultGraph()] if kb.plain else [])]
    if graphs is None:
        return [g for g in all_graphs if inferred or g != kb.graphs.inferred]
    chosen: list[GraphName] = []
    for graph in map(iri, graphs):
        if graph not in all_graphs:
            raise UnknownTermError(f"there is no graph {graph}; `rtask stats` lists all graphs")
        chosen.append(graph)
    return chosen


def _statements(kb: GraphCore, graphs: list[GraphName], with_names: bool) -> Iterator[Quad]:
    for graph in graphs:
        for quad in kb.store.quads_for_pattern(None, None, None, graph):
            quad = _with_owl_types(quad)
            yield quad if with_names else Quad(quad.subject, quad.predicate, quad.object)


def _with_owl_types(quad: Quad) -> Quad:
    """Restore the datatype that OWL requires for cardinalities; the store keeps plain integers."""
    if quad.predicate not in _CARDINALITIES or not isinstance(quad.object, Literal):
        return quad
    value = Literal(quad.object.value, datatype=_NON_NEGATIVE)
    return Quad(quad.subject, quad.predicate, value, quad.graph_name)


def _write(quads: Iterable[Quad], out: IO[bytes], rdf: RdfFormat) -> int:
    count = 0

    def counted() -> Iterator[Any]:
        nonlocal count
        for quad in quads:
            count += 1
            yield quad if rdf.supports_datasets else quad.triple

    if rdf == RdfFormat.RDF_XML:
        xml: Any = XmlWriter(out)
        try:
            serialize(writable(counted()), xml, format=rdf, prefixes=ontology.PREFIXES)
        except ValueError as error:
            raise UsageError(str(error)) from error
        xml.finish()
        return count

    prefixes = ontology.PREFIXES if rdf not in (RdfFormat.N_TRIPLES, RdfFormat.N_QUADS) else None
    serialize(counted(), out, format=rdf, prefixes=prefixes)
    return count


def original(kb: GraphCore, graph: NamedNode | str, target: Path | str) -> int:
    """Write the original document of a graph; return its length in bytes.

    Raises
    ------
    UnknownTermError
        If the graph was not loaded from a document, or the document was too large to be kept.
    """
    source = kb.catalogue.source(iri(graph))
    if source is None:
        raise UnknownTermError(f"{graph} has no original document; export it without --original")
    with kb.blobs.open(source) as stream, Path(target).open("wb") as out:
        shutil.copyfileobj(stream, out)
        return out.tell()
