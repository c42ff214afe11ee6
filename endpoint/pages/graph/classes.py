"""Classes page: the tree of classes, and what is stated of one of them."""

from __future__ import annotations

import re
import threading
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

import ontology
from endpoint.http.messages import RefusedError
from endpoint.pages.choosing import read_resource
from endpoint.pages.graph.naming import names_of
from endpoint.pages.graph.resource import expand
from endpoint.pages.render import (
    Model,
    blueprint,
    embedded_graph,
    knowledge_base,
    page,
    select,
    select_first,
    short,
)
from rtask.ontology_docs.axioms import ABOVE, read_axioms
from rtask.rdf.namespaces import RDFS
from rtask.rdf.terms import BlankNode, NamedNode, TripleKey, iri, python_value

_ADDRESS = "/classes"
OPEN_LEVELS = 2
MAX_SCHEMA = 2_000
MAX_NEIGHBOURS, MAX_MEMBERS = 60, 12
_OWL = ontology.PREFIXES["owl"]
_STATED = {
    ontology.PREFIXES["rdfs"] + "subClassOf": "is a",
    _OWL + "equivalentClass": "is the same as",
    _OWL + "disjointWith": "is never",
    _OWL + "disjointUnionOf": "is exactly one of",
    ABOVE: "includes everything that is",
}
_NAME = re.compile(r"([a-z]\w*:[A-Za-z]\w*)")
_DEFINITIONS = (
    "http://www.w3.org/2004/02/skos/core#definition",
    ontology.PREFIXES["rdfs"] + "comment",
)


@dataclass(frozen=True)
class ClassTree:
    """The named classes of one state of the graph.

    Parameters
    ----------
    children, parents
        By the IRI of a class; an empty IRI stands above all.
    labels
        Label of each class.
    counts
        Numbers of members: stated, and with all that follows.
    """

    children: Mapping[str, list[str]] = field(default_factory=dict)
    parents: Mapping[str, list[str]] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    counts: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def path(self, name: str) -> list[str]:
        """Return the superclasses of a class, from the top, along the first parents.

        Examples
        --------
        >>> ClassTree(parents={"urn:mug": ["urn:cup"], "urn:cup": []}).path("urn:mug")
        ['urn:cup']
        """
        classes: list[str] = []
        above = self.parents.get(name)
        while above and above[0] not in classes and above[0] != name:
            classes.append(above[0])
            above = self.parents.get(above[0])
        return classes[::-1]


class _Cache:
    """The tree of one state of the graph."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.version: tuple[str, int] | None = None
        self.tree = ClassTree()


def class_tree() -> ClassTree:
    """Return the tree of classes; it is read again after a commit."""
    kb = knowledge_base()
    version = (kb.epoch, kb.seq)
    cache: _Cache = flask.current_app.extensions.setdefault("rtask.classes", _Cache())
    with cache.lock:
        if cache.version != version:
            cache.tree, cache.version = _read_tree(), version
        return cache.tree


def _read_tree() -> ClassTree:
    inferred = embedded_graph().graphs.inferred
    parents: dict[str, list[str]] = {}
    for row in select("class_edges", inferred=inferred):
        above = parents.setdefault(str(row["class"]), [])
        if row["parent"]:
            above.append(str(row["parent"]))
    children: dict[str, list[str]] = defaultdict(list)
    for name, above in parents.items():
        parents_of = [parent for parent in above if parent in parents]
        for parent in parents_of or [""]:
            children[parent].append(name)
    labels = {str(row["iri"]): str(row["label"] or short(str(row["iri"]))) for row in _terms()}
    for name in parents:
        labels.setdefault(name, short(name))
    often = Counter(labels[name] for name in parents)
    for name in parents:  # two ontologies may each have an agent
        prefix, colon, _ = short(name).partition(":")
        if colon and often[labels[name]] > 1:
            labels[name] += f" ({prefix})"
    for below in children.values():
        below.sort(key=lambda name: labels[name].casefold())
    for above in parents.values():
        above.sort()
    counts = {
        str(row["class"]): (int(row["direct"]), int(row["all"]))
        for row in select("class_counts", inferred=inferred)
    }
    return ClassTree(dict(children), parents, labels, counts)


def _terms() -> list[Model]:
    return select("terms")


@page(_ADDRESS, "classes.html")
def classes() -> Model:
    """Return the tree, open at the class that the address names, and what is stated of that."""
    tree = class_tree()
    given = flask.request.args.get("iri", "").strip()
    asked = read_resource(given).value if given else ""
    if not asked:
        return {"tree": _branches(tree, "", ()), "chosen": None, "total": len(tree.parents)}
    if asked not in tree.parents:
        raise RefusedError(404, "not-found", f"no class {asked}; see {_ADDRESS}")
    path = (*tree.path(asked), asked)
    return {
        "tree": _branches(tree, "", path),
        "chosen": _about(tree, asked, path[:-1]),
        "total": len(tree.parents),
    }


def _branches(tree: ClassTree, name: str, path: tuple[str, ...], level: int = 1) -> list[Model]:
    """Return the classes below one; those that are closed keep only their number."""
    branches = []
    for child in tree.children.get(name, ()):
        below = tree.children.get(child, [])
        is_open = bool(path) and path[0] == child
        direct, members = tree.counts.get(child, (0, 0))
        shown = level < OPEN_LEVELS or is_open
        branches.append(
            {
                "iri": child,
                "label": tree.labels[child],
                "direct": direct,
                "all": members,
                "open": is_open,
                "here": is_open and len(path) == 1,
                "below": len(below),
                "children": _branches(tree, child, path[1:] if is_open else (), level + 1)
                if shown and level < 40
                else [],
            }
        )
    return branches


def _about(tree: ClassTree, name: str, path: Iterable[str]) -> Model:
    """Return what is stated of a class; four queries."""
    term = iri(name)
    direct, members_of_all = tree.counts.get(name, (0, 0))
    neighbours, more_neighbours = select_first(
        "class_neighbours", MAX_NEIGHBOURS, **{"class": term}
    )
    members, more_members = select_first("class_members", MAX_MEMBERS, **{"class": term})
    axioms = [
        {"how": _STATED[axiom.predicate], "text": axiom.text, "parts": _parts_of(axiom.text)}
        for axiom in read_axioms(_schema_of(term))
        if axiom.subject == name and axiom.predicate in _STATED
    ]
    kb = knowledge_base()
    definitions = [quad.object for p in _DEFINITIONS for quad in kb.match(term, iri(p))]
    return {
        "iri": name,
        "label": tree.labels[name],
        "definition": str(python_value(definitions[0])) if definitions else "",
        "direct": direct,
        "all": members_of_all,
        "path": [{"iri": ancestor, "label": tree.labels[ancestor]} for ancestor in path],
        "parents": [
            {"iri": ancestor, "label": tree.labels.get(ancestor, short(ancestor))}
            for ancestor in tree.parents[name]
        ],
        "axioms": axioms,
        "neighbours": neighbours,
        "members": members,
        "more": {"neighbours": more_neighbours, "members": more_members},
    }


def _parts_of(text: str) -> list[dict[str, str]]:
    """Return the pieces of an expression in Manchester syntax: names with their label and IRI."""
    pieces = _NAME.split(text)
    terms = {piece: expand(piece) for piece in pieces[1::2]}
    names = names_of(embedded_graph(), terms.values())
    return [
        {"text": names.get(terms[piece], piece), "iri": terms[piece]}
        if number % 2 and terms[piece] != piece
        else {"text": piece, "iri": ""}
        for number, piece in enumerate(pieces)
        if piece
    ]


def _schema_of(term: NamedNode) -> list[TripleKey]:
    """Return the stated triples about a class, with those about its anonymous parts."""
    kb = embedded_graph()
    triples: list[TripleKey] = []
    below = [quad.subject for quad in kb.match(None, RDFS.subClassOf, term)]
    waiting: list[NamedNode | BlankNode] = [
        term, *(superclass for superclass in below if isinstance(superclass, BlankNode))
    ]  # fmt: skip
    seen = set(waiting)
    while waiting and len(triples) < MAX_SCHEMA:
        for quad in kb.match(waiting.pop(), None, None):
            if quad.graph_name == kb.graphs.inferred:
                continue
            triples.append((quad.subject, quad.predicate, quad.object))
            if isinstance(quad.object, BlankNode) and quad.object not in seen:
                seen.add(quad.object)
                waiting.append(quad.object)
    return triples


@blueprint.route("/terms.json", methods=["GET"])
def completions() -> WerkzeugResponse:
    """Return label, kind and comment of all classes and properties, for completion."""
    kb = knowledge_base()
    etag = f"{kb.epoch}-{kb.seq}"
    if flask.request.if_none_match.contains(etag):
        response = flask.Response(status=304)
    else:
        response = flask.jsonify({"prefixes": ontology.PREFIXES, "terms": _terms()})
    response.set_etag(etag)
    response.headers["Cache-Control"] = "private, no-cache"
    return response
