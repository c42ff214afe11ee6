"""Objects of the graph as people write them on the command line: by name or by IRI."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import ontology
from rtask.errors import UnknownTermError, UsageError, nearest

if TYPE_CHECKING:
    from rtask.asking.terms import Reader
    from rtask.graph import Graph
    from rtask.rdf.terms import NamedNode

__all__ = ["Select", "find_object", "name_or_iri", "no_object", "reader_at", "resolve_object"]

_PREFIXES = {*ontology.PREFIXES, "kb"}
Select = Callable[[str], Sequence[Mapping[str, Any]]]
"""Answers a SPARQL query, as the clients and graphs do."""


def find_object(select: Select, name: str) -> str | None:
    """Return the IRI of the object that has a name, or whose IRI the name is.

    None stands for no such object.

    Raises
    ------
    UsageError
        When several objects have the name.
    """
    from rtask.rdf.terms import literal

    text = literal(name)
    rows = _objects(select, f"FILTER(?name = {text} || STR(?object) = {text})")
    matches = sorted({str(row["object"]) for row in rows})
    if len(matches) > 1:
        raise UsageError(
            f"{len(matches)} objects are called {name!r}; give the IRI: {', '.join(matches)}"
        )
    return matches[0] if matches else None


def resolve_object(select: Select, name: str) -> str:
    """Return the IRI of the object that a command is about.

    Parameters
    ----------
    name
        Its name, also in quotes, or an IRI, also in brackets or with a prefix; one that is not in
        the graph is returned as it is, for it may have been the object's before a merge.

    Raises
    ------
    UnknownTermError
        When no object has the name; it suggests the nearest one.
    UsageError
        When several objects have it.
    """
    object_iri = find_object(select, name)
    if object_iri is not None:
        return object_iri
    if name[:1] in "<\"'" or name.partition(":")[0] in _PREFIXES:
        return _reader(select, name).resource(name).value
    if ":" in name and not any(c.isspace() for c in name):
        return name
    names = sorted({str(row["name"]) for row in _objects(select, "FILTER(BOUND(?name))")})
    hint = nearest(name, names) or "; `rtask objects list` shows what there is"
    raise UnknownTermError(f"no object is called {name!r}{hint}")


def no_object(select: Select, term: NamedNode) -> str:
    """Return the words for an IRI that stands for no object: nothing, or something else."""
    from rtask.rdf.namespaces import PREFIXES

    kinds = select(f"""{PREFIXES}
SELECT DISTINCT ?kind WHERE {{ {term} a ?type FILTER(isIRI(?type))
  OPTIONAL {{ ?type rdfs:label ?label FILTER(LANG(?label) = "en" || LANG(?label) = "") }}
  BIND(COALESCE(STR(?label), REPLACE(STR(?type), "^.*[#/]", "")) AS ?kind)
  FILTER NOT EXISTS {{ {term} a ?lower . ?lower rdfs:subClassOf ?type FILTER(?lower != ?type) }}
}} ORDER BY ?kind LIMIT 3""")
    if not kinds:
        return f"no object {term.value} in the graph; `rtask objects list` shows what there is"
    what = ", ".join(str(row["kind"]) for row in kinds)
    return (
        f"{term.value} is in the graph, but no object: its kind is {what}; `rtask history` and "
        "`rtask query` take it"
    )


def name_or_iri(text: str, data: Path, server: str | None = None) -> str:
    """Return the IRI that a text stands for, in any form that a command prints, or else the name.

    This is for what looks a name up by itself, and takes no other form of IRI than the full one.

    Parameters
    ----------
    text
        ``<IRI>``, a prefixed name, a full IRI, or a name, which may be in quotes.
    data, server
        Where ``kb:`` has its meaning.
    """
    from rtask.asking.terms import Reader

    prefix, colon, local = text.partition(":")
    if len(text) > 1 and text[0] in "\"'" and text[-1] == text[0]:
        return text[1:-1]
    is_prefixed = colon and prefix in _PREFIXES and not local[:1].isspace()
    if not (text.startswith("<") or is_prefixed):
        return text
    return Reader(_base_at(data, server) if prefix == "kb" else "").resource(text).value


def _base_at(data: Path, server: str | None) -> str:
    """Return what ``kb:`` stands for in a folder or on a server."""
    from rtask.cli.connection import base_of, open_graph
    from rtask.kb.durability.settings import Settings

    if not server:
        return Settings.load(data).base
    with open_graph(data, server) as graph:
        return base_of(graph)


def reader_at(graph: Graph) -> Reader:
    """Return what reads terms against a graph, which may be the SPARQL endpoint of a server."""
    from rtask.asking.terms import Reader, reader_of
    from rtask.cli.connection import base_of
    from rtask.knowledge_base import KnowledgeBase
    from rtask.rdf.terms import literal

    if isinstance(graph, KnowledgeBase):
        return reader_of(graph)

    def named(name: str) -> list[str]:
        rows = graph.select(f"""{_prologue()}
SELECT DISTINCT ?thing {{
  ?thing rt:name|rdfs:label ?name FILTER(STR(?name) = {literal(name)}) }}""")
        return sorted(str(row["thing"]) for row in rows.to_dicts())

    def is_used(term: NamedNode) -> bool:
        rows = graph.select(
            f"SELECT * {{ {{ {term} ?p ?o }} UNION {{ ?s {term} ?o }} UNION {{ ?s ?p {term} }} "
            f"UNION {{ GRAPH {term} {{ ?s ?p ?o }} }} }} LIMIT 1"
        )
        return bool(rows.to_dicts())

    return Reader(base_of(graph), named, is_used=is_used)


def _reader(select: Select, name: str) -> Reader:
    """Return what reads the forms of names that need to know the graph."""
    from rtask.asking.terms import Reader

    def named(called: str) -> list[str]:
        object_iri = find_object(select, called)
        return [] if object_iri is None else [object_iri]

    return Reader(_base(select) if name.startswith("kb:") else "", named)


def _base(select: Select) -> str:
    """Return what ``kb:`` stands for: objects are numbered below it."""
    rows = select(f"""{_prologue()}
SELECT ?object {{ ?object rt:objectId ?id FILTER(CONTAINS(STR(?object), "/object/")) }} LIMIT 1""")
    return "".join(str(row["object"]).rpartition("object/")[0] for row in rows)


def _prologue() -> str:
    from rtask.rdf.namespaces import PREFIXES

    return PREFIXES


def _objects(select: Select, condition: str) -> Sequence[Mapping[str, Any]]:
    return select(f"""{_prologue()}
SELECT DISTINCT ?object ?name WHERE {{
  ?object rt:objectId ?id . OPTIONAL {{ ?object rt:name ?name }} {condition} }}""")
