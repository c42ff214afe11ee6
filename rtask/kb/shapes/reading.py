"""Shapes of files and of loaded graphs, indexed by the nodes that they target (SHACL 2017, 2.1).

A shapes graph is read from its shapes outward: along the properties by which shapes refer to parts
of their definition, never along targets, classes and paths, which lead into the data.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from pyoxigraph import BlankNode, NamedNode, parse

import ontology
from rtask.kb.shapes.integers import with_plain_integers
from rtask.kb.shapes.trial import components_of, faults_of
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import DEFAULT, RDF_TYPE, GraphName, Term, TripleKey, triple_key

__all__ = [
    "MAX_DEPTH",
    "TARGETS",
    "Shape",
    "Shapes",
    "is_of_shapes",
    "of_graphs",
    "part_of_shape",
    "read_shapes",
    "unprivileged_graphs",
    "without_targets",
]

SH = "http://www.w3.org/ns/shacl#"
_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
TARGETS = {
    NamedNode(SH + name): name
    for name in ("targetNode", "targetClass", "targetSubjectsOf", "targetObjectsOf")
}
MAX_DEPTH = 64
"""Steps from a focus node along paths of unbounded length."""

_CLASSES = (
    NamedNode("http://www.w3.org/2000/01/rdf-schema#Class"),
    NamedNode("http://www.w3.org/2002/07/owl#Class"),
)
_KINDS = tuple(
    NamedNode(SH + name)
    for name in (
        "NodeShape",
        "PropertyShape",
        "ConstraintComponent",
        "SPARQLFunction",
        "SPARQLTargetType",
    )
)
_NODE_SHAPE = _KINDS[0]
_INTO_DATA = frozenset(
    (RDF_TYPE.value, *(SH + name for name in (*TARGETS.values(), "class", "hasValue", "equals",
     "disjoint", "lessThan", "lessThanOrEquals", "datatype", "nodeKind", "severity",
     "targetClass", "shapesGraph", "entailment")))
)  # fmt: skip
_NESTING = frozenset(
    SH + name for name in ("property", "node", "and", "or", "xone", "not", "qualifiedValueShape")
)
_REPEATED = frozenset(SH + name for name in ("zeroOrMorePath", "oneOrMorePath"))
_WHOLE = frozenset(SH + name for name in ("sparql", "target", "rule", "js"))
_NAME = re.compile(r"\b(\w+):(\w+)")
_GENID = "/.well-known/genid/"
_BUNDLED_DEPTH = 2


@dataclass(frozen=True)
class Shape:
    """A node shape: its targets, and all statements that define it.

    Parameters
    ----------
    source
        The file, or the IRI of the graph.
    depth
        Steps from a focus node to the farthest statement that the shape examines.
    is_local
        Whether the shape examines statements up to that depth only; SPARQL may look anywhere.
    """

    node: Term
    targets: frozenset[tuple[str, Term]]
    definition: tuple[TripleKey, ...]
    source: str = ""
    depth: int = _BUNDLED_DEPTH
    is_local: bool = True

    @property
    def name(self) -> str:
        """How reports call the shape: its IRI and its source."""
        return f"{self.node} ({self.source})" if self.source else str(self.node)


@dataclass(frozen=True)
class Shapes:
    """Node shapes, indexed by their targets.

    Parameters
    ----------
    links
        Predicates that the shapes follow; along these, a change affects nodes that point at it.
    inverse
        Predicates that the shapes follow from object to subject.
    objects_of
        Predicates whose objects are targets.
    others
        Statements that belong to no shape with a target, such as custom constraint components.
    left_out
        Shapes that are not applied, each with the reason.
    depth
        The largest depth of a shape.
    nodes
        Subjects of the definitions.
    """

    shapes: tuple[Shape, ...]
    links: frozenset[NamedNode] = frozenset()
    inverse: frozenset[NamedNode] = frozenset()
    objects_of: frozenset[NamedNode] = frozenset()
    others: tuple[TripleKey, ...] = ()
    left_out: tuple[str, ...] = ()
    depth: int = field(init=False)
    nodes: frozenset[Term] = field(init=False)

    def __post_init__(self) -> None:
        depth = max((shape.depth for shape in self.shapes), default=0)
        lines = (line for shape in self.shapes for line in shape.definition)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "nodes", frozenset(line[0] for line in lines))

    def of(self, roles: set[tuple[str, Term]]) -> list[Shape]:
        """Return the shapes that target nodes in these roles."""
        return [shape for shape in self.shapes if not shape.targets.isdisjoint(roles)]

    def definitions(self, shapes: Iterable[Shape]) -> list[TripleKey]:
        """Return the statements that define shapes."""
        lines = [line for shape in shapes for line in shape.definition]
        return list(dict.fromkeys([*lines, *self.others]))

    def local(self) -> Shapes:
        """Return those shapes that a part of the data suffices to check."""
        local = tuple(shape for shape in self.shapes if shape.is_local)
        return Shapes(local, self.links, self.inverse, self.objects_of, self.others)


@lru_cache(maxsize=32)
def read_shapes(files: tuple[Path, ...], *, bundled: bool = True) -> Shapes:
    """Read shapes from files.

    Parameters
    ----------
    bundled
        Whether the files come with the ontology: their SPARQL looks at neighbours only.

    Raises
    ------
    SyntaxError, OSError
        A file cannot be read.
    """
    about: dict[Term, dict[TripleKey, str]] = {}
    for path in files:
        source = "" if bundled else str(path)
        for quad in parse(path=path, rename_blank_nodes=True):
            about.setdefault(quad.subject, {})[triple_key(quad)] = source
    return _indexed(about, bundled)


def is_of_shapes(line: Any) -> bool:
    """Whether a statement may belong to a shape, by its predicate or type."""
    return line.predicate.value.startswith(SH) or (
        line.predicate == RDF_TYPE and line.object in _KINDS
    )


def of_graphs(store: GraphStore, apart: Iterable[GraphName] = ()) -> Shapes:
    """Read the shapes of the named graphs of a store.

    Parameters
    ----------
    apart
        Graphs to leave out.
    """
    skipped = {DEFAULT, *apart}
    starts: list[tuple[Any, GraphName]] = []
    for predicate, value in (
        *((RDF_TYPE, kind) for kind in _KINDS),
        *((target, None) for target in TARGETS),
    ):
        quads = store.quads_for_pattern(None, predicate, value, None)
        starts += [(q.subject, q.graph_name) for q in quads if q.graph_name not in skipped]
    about: dict[Term, dict[TripleKey, str]] = {}
    graphs = sorted({graph for _, graph in starts}, key=str)
    waiting = list(dict.fromkeys(node for node, _ in starts))
    while waiting:
        node = waiting.pop()
        if part_of_shape(node) in about:
            continue
        lines = about.setdefault(part_of_shape(node), {})
        for graph in graphs:
            for quad in store.quads_for_pattern(node, None, None, graph):
                key = _key(quad)
                lines[key] = str(getattr(graph, "value", graph))
                if _leads_on(key):
                    waiting.append(quad.object)
    return _indexed(about, bundled=False)


def part_of_shape(node: Any) -> Any:
    """Return a node as the definition of a shape has it: blank if it was blank when it was loaded.

    The loader gives blank nodes of data IRIs (RDF 1.1 Concepts, 3.5); an IRI that stands for a
    path or a list would be taken for a property.
    """
    if isinstance(node, NamedNode) and _GENID in node.value:
        return BlankNode(node.value.rpartition(_GENID)[2].replace("/", "-"))
    return node


def _key(quad: Any) -> TripleKey:
    into_data = quad.predicate.value in _INTO_DATA
    value = quad.object if into_data else part_of_shape(quad.object)
    return (part_of_shape(quad.subject), quad.predicate, value)


def _leads_on(line: TripleKey) -> bool:
    """Whether the object of a statement belongs to the definition that its subject is part of."""
    _, predicate, value = line
    if isinstance(value, BlankNode):
        return predicate.value not in _INTO_DATA
    if not isinstance(value, NamedNode):
        return False
    refers = predicate.value.startswith(SH) and predicate.value not in _INTO_DATA
    return predicate.value == _RDF + "first" or (
        refers and not predicate.value.lower().endswith("path")
    )


def _indexed(about: dict[Term, dict[TripleKey, str]], bundled: bool) -> Shapes:
    if not bundled:
        about = with_plain_integers(about)
    shapes = []
    used: set[Term] = set()
    for node, lines in about.items():
        targets = {(TARGETS[p], value) for _, p, value in lines if p in TARGETS}
        definition = [*_definition(node, about)]
        if not bundled and _is_class(node, lines):
            targets.add(("targetClass", node))
            definition.append((node, RDF_TYPE, _CLASSES[0]))  # type: ignore[arg-type]
        asks = any(line[1].value in _WHOLE for line in definition)
        has_own = any(line[0] == node and line[1].value == SH + "target" for line in definition)
        if not targets and not has_own:
            continue
        used.update(line[0] for line in definition)
        source = next(iter(lines.values()))
        shape = Shape(
            node,
            frozenset(targets),
            tuple(dict.fromkeys(definition)),
            source,
            _BUNDLED_DEPTH if bundled else _depth(node, about),
            is_local=bundled or not asks,
        )
        shapes.append(shape)
    objects_of = {
        value
        for shape in shapes
        for kind, value in shape.targets
        if kind == "targetObjectsOf" and isinstance(value, NamedNode)
    }
    rest = [] if bundled else [k for node in about if node not in used for k in about[node]]
    faults: dict[Term, str] = {}
    if not bundled:
        components = components_of(rest)
        rest = list(components.lines)
        faults = faults_of({shape.node: shape.definition for shape in shapes}, components)
    left_out = [f"{shape.name}: {faults[shape.node]}" for shape in shapes if shape.node in faults]
    shapes = [shape for shape in shapes if shape.node not in faults]
    links, inverse = frozenset(_links(about)), frozenset(_inverse(about))
    return Shapes(
        tuple(shapes), links, inverse, frozenset(objects_of), tuple(rest), tuple(left_out)
    )


def _is_class(node: Term, lines: Iterable[TripleKey]) -> bool:
    """Whether a shape is a class as well, whose instances it targets (SHACL, 2.1.3.3)."""
    kinds = {value for _, predicate, value in lines if predicate == RDF_TYPE}
    return isinstance(node, NamedNode) and _NODE_SHAPE in kinds and not kinds.isdisjoint(_CLASSES)


def _definition(node: Term, about: dict[Term, dict[TripleKey, str]]) -> Iterator[TripleKey]:
    """Yield the statements about a shape and about everything it refers to."""
    waiting, seen = [node], {node}
    while waiting:
        for line in about.get(waiting.pop(), ()):
            yield line
            if line[2] in about and line[2] not in seen and _leads_on(line):
                seen.add(line[2])
                waiting.append(line[2])


def _depth(
    node: Term, about: dict[Term, dict[TripleKey, str]], within: tuple[Term, ...] = ()
) -> int:
    """Return how many steps from a focus node a shape looks."""
    if node in within or len(within) > MAX_DEPTH:
        return MAX_DEPTH  # shapes that refer to each other
    lines = about.get(node, {})
    paths = [value for _, predicate, value in lines if predicate.value == SH + "path"]
    step = max((_length(path, about) for path in paths), default=0)
    within = (*within, node)
    inner = 0
    for _, predicate, value in lines:
        if predicate.value in _NESTING:
            for part in _members(value, about):
                inner = max(inner, _depth(part, about, within))
        elif not paths and predicate.value in (SH + "equals", SH + "disjoint", SH + "closed"):
            inner = max(inner, 1)
    return min(step + inner, MAX_DEPTH)


def _members(node: Term, about: dict[Term, dict[TripleKey, str]]) -> list[Term]:
    """Return the members of a list, or the node itself if it is none."""
    members: list[Term] = []
    at: Term | None = node
    seen: set[Term] = set()
    while at is not None and at not in seen:
        seen.add(at)
        lines = {predicate.value: value for _, predicate, value in about.get(at, {})}
        if _RDF + "first" not in lines:
            return members or [node]
        members.append(lines[_RDF + "first"])
        at = lines.get(_RDF + "rest")
    return members


def _length(path: Term, about: dict[Term, dict[TripleKey, str]]) -> int:
    """Return the largest number of steps of a path (SHACL, 2.3.1)."""
    waiting, seen, steps = [path], {path}, 0
    while waiting:
        node = waiting.pop()
        if isinstance(node, NamedNode):
            steps += 1
            continue
        for _, predicate, value in about.get(node, {}):
            if predicate.value in _REPEATED:
                return MAX_DEPTH
            if value not in seen or isinstance(value, NamedNode):
                seen.add(value)
                waiting.append(value)
    return steps


def _links(about: dict[Term, dict[TripleKey, str]]) -> Iterator[NamedNode]:
    for lines in about.values():
        for _, predicate, value in lines:
            if predicate.value == SH + "select":
                for prefix, name in _NAME.findall(getattr(value, "value", "")):
                    if prefix in ontology.PREFIXES:
                        yield NamedNode(ontology.PREFIXES[prefix] + name)
            elif isinstance(value, NamedNode) and (
                predicate.value in (SH + "path", _RDF + "first")
                or (predicate.value.startswith(SH) and predicate.value.endswith("Path"))
            ):
                yield value


def _inverse(about: dict[Term, dict[TripleKey, str]]) -> Iterator[NamedNode]:
    """Yield the predicates below sh:inversePath."""
    for lines in about.values():
        for _, predicate, value in lines:
            if predicate.value == SH + "inversePath":
                yield from _names_below(about, value)


def _names_below(about: dict[Term, dict[TripleKey, str]], root: Term) -> Iterator[NamedNode]:
    """Yield the IRIs in which a path ends; a list that contains itself ends the walk, too."""
    waiting, seen = [root], {root}
    while waiting:
        node = waiting.pop()
        if isinstance(node, NamedNode):
            yield node
            continue
        for _, _, value in about.get(node, {}):
            if value not in seen:
                seen.add(value)
                waiting.append(value)


def without_targets(lines: Iterable[TripleKey]) -> list[TripleKey]:
    """Return definitions of shapes without the statements that choose focus nodes."""
    return [
        line
        for line in lines
        if line[1] not in TARGETS and not (line[1] == RDF_TYPE and line[2] in _CLASSES)
    ]


def unprivileged_graphs(graphs: Graphs, names: Iterable[GraphName]) -> set[GraphName]:
    """Return the graphs whose shapes do not bind the commits of others.

    A robot writes what it likes into its own graph, and anybody into the shared one; a shape there
    would let it refuse what others store.
    """
    return {g for g in names if g == graphs.shared or graphs.owner(g) is not None}
