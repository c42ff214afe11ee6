"""SHACL validation of the nodes that a commit touches, or of all data.

The validator receives only the shapes that target the touched nodes, and only the statements
that those shapes examine, so the cost depends on the size of the change and not of the store.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from pyoxigraph import BlankNode, NamedNode, Quad, parse

import ontology
from rtask.errors import UsageError, ValidationError
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import Derived
from rtask.rdf.terms import DEFAULT, RDF_TYPE, GraphName, Subject, Term, TripleKey, triple_key

__all__ = ["Validator", "Violation", "policy"]

_SH = "http://www.w3.org/ns/shacl#"
_RDFS = "http://www.w3.org/2000/01/rdf-schema#"
_SUBCLASS = NamedNode(_RDFS + "subClassOf")
_TARGETS = {
    NamedNode(_SH + name): name
    for name in ("targetNode", "targetClass", "targetSubjectsOf", "targetObjectsOf")
}
_NAME = re.compile(r"\b(\w+):(\w+)")
_DEPTH = 2
_MAX_NODES = 5_000
_BATCH = 200
"""Nodes validated at once: pySHACL compares each focus node with all others."""

_POLICIES = ("off", "warn", "refuse")


@dataclass(frozen=True)
class Violation:
    """One result of a validation (SHACL 3.6); terms are written as in N-Triples.

    Parameters
    ----------
    path, value
        ``None`` for a constraint on the node itself.
    severity
        ``Violation``, ``Warning`` or ``Info``.
    graph
        IRI of the graph that was validated by itself; ``None`` if all were validated together.
    """

    focus: str
    path: str | None
    value: str | None
    message: str
    shape: str
    severity: str
    graph: str | None = None

    def __str__(self) -> str:
        path = f" {self.path}" if self.path else ""
        value = f" {self.value}" if self.value else ""
        return f"{self.focus}{path}{value}: {self.message}"


def policy(validate: bool | str) -> str:
    """Return how violations are handled: ``off``, ``warn`` or ``refuse``.

    >>> policy(True), policy("warn")
    ('refuse', 'warn')
    """
    name = validate if isinstance(validate, str) else "refuse" if validate else "off"
    if name not in _POLICIES:
        raise UsageError(f"validate={validate!r}; one of False, True, {', '.join(_POLICIES)}")
    return name


@dataclass(frozen=True)
class Shape:
    """A node shape: its targets, and all statements that define it."""

    targets: frozenset[tuple[str, Term]]
    definition: tuple[TripleKey, ...]


@dataclass(frozen=True)
class Shapes:
    """Node shapes, indexed by their targets.

    Parameters
    ----------
    links
        Predicates that the shapes follow; along these, a change affects nodes that point at it.
    objects_of
        Predicates whose objects are targets.
    """

    shapes: tuple[Shape, ...]
    links: frozenset[NamedNode]
    objects_of: frozenset[NamedNode]

    def of(self, roles: set[tuple[str, Term]]) -> list[TripleKey]:
        """Return the definitions of the shapes that target nodes in these roles."""
        chosen = (shape for shape in self.shapes if not shape.targets.isdisjoint(roles))
        return list(dict.fromkeys(line for shape in chosen for line in shape.definition))

    def everything(self) -> list[TripleKey]:
        """Return all definitions."""
        return list(dict.fromkeys(line for shape in self.shapes for line in shape.definition))


@lru_cache(maxsize=8)
def read_shapes(files: tuple[Path, ...]) -> Shapes:
    """Read shapes from files and index them by target."""
    about: dict[Term, list[TripleKey]] = {}
    for path in files:
        for quad in parse(path=path, rename_blank_nodes=True):
            about.setdefault(quad.subject, []).append(triple_key(quad))
    shapes = []
    for node, lines in about.items():
        targets = {(_TARGETS[p], value) for _, p, value in lines if p in _TARGETS}
        if targets:
            shapes.append(Shape(frozenset(targets), tuple(_definition(node, about))))
    objects_of = {
        value
        for shape in shapes
        for kind, value in shape.targets
        if kind == "targetObjectsOf" and isinstance(value, NamedNode)
    }
    return Shapes(tuple(shapes), frozenset(_links(about)), frozenset(objects_of))


def _definition(node: Term, about: dict[Term, list[TripleKey]]) -> Iterator[TripleKey]:
    """Yield the statements about a shape and about everything it refers to."""
    waiting, seen = [node], {node}
    while waiting:
        for line in about.get(waiting.pop(), ()):
            yield line
            if line[2] in about and line[2] not in seen:
                seen.add(line[2])
                waiting.append(line[2])


def _links(about: dict[Term, list[TripleKey]]) -> Iterator[NamedNode]:
    for lines in about.values():
        for _, predicate, value in lines:
            if predicate.value == _SH + "select":
                for prefix, name in _NAME.findall(getattr(value, "value", "")):
                    if prefix in ontology.PREFIXES:
                        yield NamedNode(ontology.PREFIXES[prefix] + name)
            elif isinstance(value, NamedNode) and predicate.value in (
                _SH + "path",
                "http://www.w3.org/1999/02/22-rdf-syntax-ns#first",
            ):
                yield value


class Validator:
    """Checks changes of one knowledge base against the shapes that come with the ontology.

    Parameters
    ----------
    refuse
        Whether a violation rejects the commit; otherwise the commit reports it as a warning.
    """

    def __init__(self, store: GraphStore, graphs: Graphs, refuse: bool) -> None:
        self._store = store
        self._graphs = graphs
        self._refuse = refuse

    def check(self, change: Overlay, derived: Derived) -> tuple[Violation, ...]:
        """Validate the nodes that a pending change touches, in their state after it.

        Raises
        ------
        ValidationError
            If a node violates a shape; ``results`` lists the violations and nothing is stored.
        """
        whole = Overlay(self._store)
        for part in (change, derived):
            whole.removed.update(dict.fromkeys(part.removed))
            whole.added.update(dict.fromkeys(part.added))
        found = [*self._check(_View(whole, None), read_shapes(tuple(ontology.shapes())))]
        for graph in sorted(change.touched_graphs(), key=str):
            if self._graphs.owner(graph) is not None:
                shapes = read_shapes(tuple(ontology.graph_shapes()))
                found += self._check(_View(whole, graph), shapes)
        if self._refuse:
            refuse(found)
        return tuple(found)

    def _check(self, view: _View, shapes: Shapes) -> list[Violation]:
        roles = {node: view.roles(node, shapes.objects_of) for node in view.touched(shapes.links)}
        definitions = shapes.of({role for found in roles.values() for role in found})
        if not definitions:
            return []
        wanted = {value for _, p, value in definitions if p in _TARGETS}
        focus = [node for node, found in roles.items() if any(v in wanted for _, v in found)]
        found: list[Violation] = []
        for start in range(0, len(focus), _BATCH):
            part = focus[start : start + _BATCH]
            around = view.around(part, shapes.objects_of)
            found += run(around, definitions, list(part), view.graph)
        return sorted(found, key=str)


def refuse(found: Iterable[Violation]) -> None:
    """Raise if any result has severity Violation."""
    bad = [one for one in found if one.severity == "Violation"]
    if not bad:
        return
    more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
    raise ValidationError(
        f"the data violate a SHACL shape: {bad[0]}{more}; nothing was stored",
        results=[asdict(one) for one in bad],
    )


def everything(store: GraphStore, graphs: Graphs) -> list[Violation]:
    """Validate a whole knowledge base."""
    whole = Overlay(store)
    shapes = read_shapes(tuple(ontology.shapes())).everything()
    found = run(_View(whole, None).triples(), shapes, None, None)
    for graph in sorted(store.named_graphs(), key=str):
        if graphs.owner(graph) is not None:
            shapes = read_shapes(tuple(ontology.graph_shapes())).everything()
            found += run(_View(whole, graph).triples(), shapes, None, graph)
    return found


def run(
    data: Iterable[TripleKey],
    shapes: Iterable[TripleKey],
    focus: list[Subject] | None,
    graph: GraphName | None,
) -> list[Violation]:
    """Validate statements, those of one graph only if one is given."""
    from reasoner import validate

    # triple terms are left out: the validator's signature does not include them
    given: Any = (key for key in data if not hasattr(key[2], "subject"))
    report = validate(given, list(shapes), focus)  # type: ignore[arg-type]
    return [
        Violation(
            str(one.focus),
            one.path,
            None if one.value is None else str(one.value),
            one.message,
            str(one.shape),
            one.severity,
            getattr(graph, "value", None),
        )
        for one in report.findings
    ]


class _View:
    """View of the statements after a pending change, in all graphs or in one."""

    def __init__(self, change: Overlay, graph: GraphName | None) -> None:
        self._change = change
        self.graph = graph
        self._by_subject: dict[Term, set[TripleKey]] = {}
        self._by_object: dict[Term, set[TripleKey]] = {}
        self._superclasses: dict[Term, set[Term]] = {}
        for quad in change.added:
            if self._counts(quad):
                self._by_subject.setdefault(quad.subject, set()).add(triple_key(quad))
                self._by_object.setdefault(quad.object, set()).add(triple_key(quad))

    def _counts(self, quad: Quad) -> bool:
        return self.graph is None or quad.graph_name == self.graph

    def _stored(self, subject: Any, predicate: Any, value: Any) -> Iterator[TripleKey]:
        found = self._change.store.quads_for_pattern(subject, predicate, value, self.graph)
        return (
            triple_key(quad)
            for quad in found
            if quad.graph_name != DEFAULT and quad not in self._change.removed
        )

    def triples(self) -> set[TripleKey]:
        """Return all triples."""
        return {*self._stored(None, None, None)}.union(*self._by_subject.values())

    def about(self, node: Term) -> set[TripleKey]:
        """Return the statements with a subject."""
        return {*self._stored(node, None, None), *self._by_subject.get(node, ())}

    def pointing_at(self, node: Term, links: Iterable[NamedNode]) -> Iterator[TripleKey]:
        """Yield the statements with an object and one of some predicates."""
        for link in links:
            yield from self._stored(None, link, node)
        yield from (key for key in self._by_object.get(node, ()) if key[1] in links)

    def touched(self, links: frozenset[NamedNode]) -> list[Subject]:
        """Return the nodes that the change may make invalid, up to a bound."""
        changed = [*self._change.added, *self._change.removed]
        nodes: dict[Any, None] = {}
        for quad in changed:
            if self._counts(quad):
                nodes[quad.subject] = None
                if isinstance(quad.object, NamedNode | BlankNode) and quad.predicate != RDF_TYPE:
                    nodes[quad.object] = None
        edge = [*nodes]
        most = len(nodes) + _MAX_NODES
        for _ in range(_DEPTH):
            edge = [
                key[0]
                for node in edge
                for key in self.pointing_at(node, links)
                if key[0] not in nodes
            ]
            nodes.update(dict.fromkeys(edge))
            if len(nodes) > most:
                break
        return list(nodes)

    def roles(self, node: Subject, objects_of: Iterable[NamedNode]) -> set[tuple[str, Term]]:
        """Return the shape targets that a node matches."""
        roles: set[tuple[str, Term]] = {("targetNode", node)}
        for _, predicate, value in self.about(node):
            roles.add(("targetSubjectsOf", predicate))
            if predicate == RDF_TYPE:
                roles |= {("targetClass", kind) for kind in self._with_superclasses(value)}
        roles |= {
            ("targetObjectsOf", link)
            for link in objects_of
            if any(True for _ in self.pointing_at(node, (link,)))
        }
        return roles

    def _with_superclasses(self, kind: Term) -> set[Term]:
        known = self._superclasses.get(kind)
        if known is not None:
            return known
        found, waiting = {kind}, [kind]
        while waiting:
            for _, _, above in self._stored(waiting.pop(), _SUBCLASS, None):
                if above not in found:
                    found.add(above)
                    waiting.append(above)
        self._superclasses[kind] = found
        return found

    def around(self, focus: Iterable[Subject], objects_of: Iterable[NamedNode]) -> set[TripleKey]:
        """Return the statements that shapes of these nodes examine, with the classes of values."""
        kept = {key for node in focus for key in self.pointing_at(node, objects_of)}
        edge: set[Any] = set(focus)
        done: set[Any] = set()
        for _ in range(_DEPTH + 1):
            done |= edge
            found = {key for node in edge for key in self.about(node)}
            kept |= found
            edge = {
                key[2]
                for key in found
                if isinstance(key[2], NamedNode | BlankNode) and key[1] != RDF_TYPE
            } - done
        kinds = {key[2] for key in kept if key[1] == RDF_TYPE}
        for kind in kinds:
            for sub in self._with_superclasses(kind):
                kept.update(self._stored(sub, _SUBCLASS, None))
        return kept
