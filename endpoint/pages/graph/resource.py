"""Page about one IRI: stated, derived and incoming statements."""

from __future__ import annotations

from typing import Any

import flask

import ontology
from endpoint.http.messages import RefusedError
from endpoint.pages.choosing import read_resource
from endpoint.pages.graph.naming import names_of
from endpoint.pages.render import (
    Model,
    embedded_graph,
    filled_query,
    knowledge_base,
    page,
    solutions,
)
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import Literal, NamedNode, iri

MAX_OUTGOING, MAX_INCOMING = 500, 50
_PAGES = {
    RT.ManipulableObject.value: "/object",
    ontology.PREFIXES["cora"] + "Robot": "/robot",
    RT.GraspAttempt.value: "/why",
    RT.TaskPlan.value: "/why",
    ontology.PREFIXES["owl"] + "Class": "/classes",
}
"""Where things of a class have a page for people."""
# Terms of standards are linked to from many pages, whether or not the graph describes them.
_VOCABULARIES = tuple(
    start for start in ontology.PREFIXES.values() if start not in (ontology.NS, ontology.BASE)
)


@page("/resource", "resource.html")
def resource() -> Model:
    """Return the statements about an IRI and those that refer to it; two queries."""
    asked = flask.request.args.get("iri", "").strip()
    if not asked:
        raise RefusedError(400, "usage", "which one? /resource?iri=<IRI>, or a prefixed name")
    name = read_resource(asked).value
    outgoing = solutions("resource_outgoing", limit=MAX_OUTGOING + 1, resource=iri(name))
    incoming = solutions("resource_incoming", limit=MAX_INCOMING + 1, resource=iri(name))
    if not outgoing and not incoming and not name.startswith(_VOCABULARIES):
        raise RefusedError(404, "not-found", f"the graph says nothing about {name}")
    inferred = embedded_graph().graphs.inferred.value
    statements: list[Model] = [
        {"p": _term(row["p"]), "o": _term(row["o"]), "graph": _term(row["g"])["text"]}
        for row in outgoing[:MAX_OUTGOING]
    ]
    referring: list[Model] = [
        {"s": _term(row["s"]), "p": _term(row["p"]), "graph": _term(row["g"])["text"]}
        for row in incoming[:MAX_INCOMING]
    ]
    shown = [*(row["o"] for row in statements), *(row["s"] for row in referring)]
    named = [term["text"] for term in shown if term["kind"] == "iri"]
    return {
        "iri": name,
        "names": names_of(embedded_graph(), [name, *named]),
        "page": _page_of(statements),
        "elsewhere": _is_elsewhere(name),
        "stated": [s for s in statements if s["graph"] != inferred],
        "derived": [s for s in statements if s["graph"] == inferred],
        "incoming": referring,
        "all": {
            side: filled_query(f"resource_{side}", resource=iri(name)) if len(rows) > most else ""
            for side, rows, most in (
                ("outgoing", outgoing, MAX_OUTGOING),
                ("incoming", incoming, MAX_INCOMING),
            )
        },
    }


def _page_of(statements: list[Model]) -> str:
    """Return the address of the page for people about the subject of statements; empty for none."""
    kinds = {row["o"]["text"] for row in statements if row["p"]["text"] == RDF.type.value}
    return next((address for kind, address in _PAGES.items() if kind in kinds), "")


def _is_elsewhere(name: str) -> bool:
    """Tell whether an IRI is a link to another site; our own vocabulary's IRIs are not."""
    house = (ontology.NS, ontology.BASE, ontology.ONTOLOGY, knowledge_base().base)
    return name.startswith(("http://", "https://")) and not name.startswith(house)


def expand(name: str) -> str:
    """Return the IRI of a prefixed name; other text unchanged.

    Examples
    --------
    >>> expand("rt:Mug") == ontology.NS + "Mug", expand("http://example.org/")
    (True, 'http://example.org/')
    """
    prefix, colon, local = name.partition(":")
    if colon and prefix in ontology.PREFIXES:
        return ontology.PREFIXES[prefix] + local
    return name


def _term(term: Any) -> dict[str, str]:
    """Return the kind and text of a term, and the language or datatype of a literal."""
    if isinstance(term, NamedNode):
        return {"kind": "iri", "text": term.value}
    if isinstance(term, Literal):
        shown = {"kind": "literal", "text": term.value}
        if term.language:
            return {**shown, "language": term.language}
        return {**shown, "datatype": term.datatype.value}
    return {"kind": "other", "text": str(term)}
