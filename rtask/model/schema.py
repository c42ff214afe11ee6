"""Schema of an ontology: its classes and properties with the constraints of its shapes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import ontology
from rtask.model.codec import RDF_LANG_STRING, RDFS_LITERAL, THING
from rtask.model.limits import Limits
from rtask.model.python_names import class_name, field_name, local_name, unique_names
from rtask.rdf.terms import XSD, BlankNode, Literal, NamedNode, Subject, Term

__all__ = ["ClassSpec", "PropertySpec", "Schema", "read_schema"]

Triples = Iterable[tuple[Subject, NamedNode, Term]]

OWL, RDF, RDFS = (ontology.PREFIXES[name] for name in ("owl", "rdf", "rdfs"))
SH, RT = ontology.PREFIXES["sh"], ontology.NS
_TYPE = RDF + "type"
_CLOSED = RT + "CodedValue"
_COMMENTS = {
    RDFS + "label": "A name for people, in a language.",
    RDFS + "comment": "An explanation for people, in a language.",
}


@dataclass
class PropertySpec:
    """One property; the attributes of :class:`rtask.model.fields.Field`, and its place."""

    iri: str
    name: str
    is_link: bool
    value: str
    domains: list[str]
    is_list: bool = False
    functional: bool = False
    single: bool = False
    inverse: str | None = None
    stored: bool = True
    unit: str | None = None
    limits: Limits = field(default_factory=Limits)
    comment: str = ""


@dataclass
class ClassSpec:
    """One class; ``required`` holds the IRIs of properties that an instance must have."""

    iri: str
    name: str
    parents: list[str]
    comment: str = ""
    required: list[str] = field(default_factory=list)
    properties: list[PropertySpec] = field(default_factory=list)


@dataclass
class Schema:
    """Classes by IRI, superclasses first; individuals by Python name."""

    classes: dict[str, ClassSpec]
    individuals: dict[str, str]


class _Graph:
    """Index of a set of triples."""

    def __init__(self, triples: Triples) -> None:
        self._by: dict[tuple[Subject, str], list[Term]] = defaultdict(list)
        self._of: dict[tuple[str, Term], list[Subject]] = defaultdict(list)
        for s, p, o in triples:
            self._by[s, p.value].append(o)
            self._of[p.value, o].append(s)

    def objects(self, subject: Term, predicate: str) -> list[Term]:
        return self._by.get((subject, predicate), []) if not isinstance(subject, Literal) else []

    def subjects(self, predicate: str, value: Term) -> list[Subject]:
        return self._of.get((predicate, value), [])

    def named(self, *kinds: str) -> set[str]:
        """Return the IRIs of the things of these types."""
        subjects = (s for kind in kinds for s in self.subjects(_TYPE, NamedNode(kind)))
        return {s.value for s in subjects if isinstance(s, NamedNode)}

    def iris(self, subject: str, predicate: str) -> list[str]:
        """Return the IRIs that a thing has for a property."""
        values = self.objects(NamedNode(subject), predicate)
        return sorted({v.value for v in values if isinstance(v, NamedNode)})

    def text(self, subject: str, predicate: str) -> str:
        """Return an English or unmarked text."""
        values = [v for v in self.objects(NamedNode(subject), predicate) if isinstance(v, Literal)]
        plain = [v.value for v in values if v.language in (None, "en", "en-us", "en-gb")]
        return min(plain, default="")

    def members(self, head: Term) -> Iterator[Term]:
        """Yield the members of a list."""
        while isinstance(head, BlankNode):
            yield from self.objects(head, RDF + "first")[:1]
            head = next(iter(self.objects(head, RDF + "rest")), NamedNode(RDF + "nil"))


def read_schema(
    triples: Triples,
    shapes: Triples = (),
    primary: str = "",
    find_model: Callable[[str], object] = lambda iri: None,
) -> Schema:
    """Read classes and properties.

    Parameters
    ----------
    triples
        The ontology, with what it imports.
    shapes
        SHACL shapes; they take precedence over the ontology.
    primary
        Namespace whose names are used unchanged; equal names from other namespaces get the prefix
        of their vocabulary.
    find_model
        Tells whether an IRI is a class that is defined elsewhere.
    """
    triples = list(triples)
    graph, constraints = _Graph(triples), _Graph(shapes)
    iris = _public(graph.named(OWL + "Class", RDFS + "Class")) | {THING}
    iris |= {o.value for _, _, o in triples if isinstance(o, NamedNode) and find_model(o.value)}
    above = _hierarchy(graph, iris)
    names = unique_names(iris, primary, class_name)
    classes = {
        iri: ClassSpec(iri, names[iri], above[iri], graph.text(iri, RDFS + "comment"))
        for iri in _superclasses_first(above)
    }
    properties = _properties(graph, set(classes), primary)
    _apply_shapes(constraints, classes, properties)
    for spec in properties.values():
        for domain in spec.domains:
            classes[domain].properties.append(spec)
    return Schema(classes, _individuals(graph, classes, properties, primary))


def _public(iris: set[str]) -> set[str]:
    """Return the terms except auxiliary ones, such as the reified relations of CORA."""
    return {iri for iri in iris if not local_name(iri).startswith("_")}


def _hierarchy(graph: _Graph, iris: set[str]) -> dict[str, list[str]]:
    """Return direct superclasses, without cycles and redundant ones."""
    above: dict[str, set[str]] = {iri: set() for iri in iris}

    def ancestors(iri: str) -> set[str]:
        ancestors_, open_ = set[str](), [iri]
        while open_:
            fresh = above[open_.pop()] - ancestors_
            ancestors_ |= fresh
            open_ += fresh
        return ancestors_

    for iri in sorted(iris - {THING}):
        stated = set(graph.iris(iri, RDFS + "subClassOf"))
        for expression in graph.objects(NamedNode(iri), OWL + "equivalentClass"):
            for head in graph.objects(expression, OWL + "intersectionOf"):
                stated |= {m.value for m in graph.members(head) if isinstance(m, NamedNode)}
        for parent in sorted(stated & iris - {iri}):
            if iri not in ancestors(parent) and parent != THING:
                above[iri].add(parent)
    for iri in sorted(iris - {THING}):
        implied = set().union(*(ancestors(parent) for parent in above[iri]))
        above[iri] = (above[iri] - implied) or {THING}
    return {iri: sorted(parents) for iri, parents in above.items()}


def _superclasses_first(above: dict[str, list[str]]) -> list[str]:
    """Return all classes in one order, against which the bases of every class are consistent."""
    depth: dict[str, int] = {}
    open_ = sorted(above)
    while open_:  # hierarchies may be deeper than Python's stack
        iri = open_[-1]
        waiting = [parent for parent in above[iri] if parent not in depth]
        if waiting:
            open_ += waiting
        else:
            depth[open_.pop()] = 1 + max((depth[parent] for parent in above[iri]), default=-1)
    order = sorted(above, key=lambda iri: (depth[iri], iri))
    place = {iri: at for at, iri in enumerate(order)}
    for parents in above.values():
        parents.sort(key=lambda iri: -place[iri])
    return order


def _properties(graph: _Graph, classes: set[str], primary: str) -> dict[str, PropertySpec]:
    links = _public(graph.named(OWL + "ObjectProperty"))
    plain = _public(graph.named(OWL + "DatatypeProperty")) - links
    plain |= {RDFS + "label", RDFS + "comment"}
    functional = graph.named(OWL + "FunctionalProperty")
    inverse, stored = _inverses(graph, links)
    functional |= {
        inverse[iri] for iri in graph.named(OWL + "InverseFunctionalProperty") if iri in inverse
    }
    names = unique_names(links | plain, primary, field_name)
    specs = {}
    for iri in sorted(links | plain):
        is_list = RDF + "List" in graph.iris(iri, RDFS + "range")
        is_link = iri in links and not is_list
        units = graph.iris(iri, RT + "unit")
        specs[iri] = PropertySpec(
            iri,
            names[iri],
            is_link,
            _range(graph, iri, is_link, classes),
            _domains(graph, iri, classes),
            is_list,
            functional=iri in functional,
            single=iri in functional,
            inverse=inverse.get(iri),
            stored=iri in stored or iri not in inverse,
            unit=local_name(units[0]) if units else None,
            comment=_COMMENTS.get(iri) or graph.text(iri, RDFS + "comment"),
        )
    return specs


def _inverses(graph: _Graph, links: set[str]) -> tuple[dict[str, str], set[str]]:
    """Return pairs of inverses, and of each pair the one that names the other, which is stored."""
    inverse: dict[str, str] = {}
    stored: set[str] = set()
    for iri in sorted(links):
        for other in graph.iris(iri, OWL + "inverseOf"):
            if iri not in inverse and other not in inverse and other in links and other != iri:
                inverse[iri], inverse[other] = other, iri
                stored.add(iri)
    return inverse, stored


def _lineage(graph: _Graph, iri: str) -> list[str]:
    """Return a property and its superproperties, nearest first; their domains and ranges apply."""
    line = [iri]
    for name in line:
        line += [p for p in graph.iris(name, RDFS + "subPropertyOf") if p not in line]
    return line


def _range(graph: _Graph, iri: str, is_link: bool, classes: set[str]) -> str:
    stated = [name for above in _lineage(graph, iri) for name in graph.iris(above, RDFS + "range")]
    if is_link:
        return next((value for value in stated if value in classes), THING)
    if iri in (RDFS + "label", RDFS + "comment"):
        return RDF_LANG_STRING
    datatypes = (XSD, RDF)
    return next((value for value in stated if value.startswith(datatypes)), RDFS_LITERAL)


def _domains(graph: _Graph, iri: str, classes: set[str]) -> list[str]:
    """Return the classes that have a property; several where the domain is a union."""
    lineage = _lineage(graph, iri)
    for domain in (d for a in lineage for d in graph.objects(NamedNode(a), RDFS + "domain")):
        if isinstance(domain, NamedNode) and domain.value in classes:
            return [domain.value]
        for head in graph.objects(domain, OWL + "unionOf"):
            listed = {m.value for m in graph.members(head) if isinstance(m, NamedNode)}
            if listed & classes:
                return sorted(listed & classes)
    return [THING]


def _apply_shapes(
    shapes: _Graph, classes: dict[str, ClassSpec], properties: dict[str, PropertySpec]
) -> None:
    """Take limits, single values and required properties from SHACL (SHACL, 4)."""
    for shape in shapes.subjects(_TYPE, NamedNode(SH + "PropertyShape")):
        for iri in _path(shapes, shape):
            if iri in properties and _number(shapes, shape, "maxCount") == 1:
                properties[iri].single = True
    for node in shapes.subjects(_TYPE, NamedNode(SH + "NodeShape")):
        listed = shapes.objects(node, SH + "targetClass")
        targets = [t.value for t in listed if isinstance(t, NamedNode) and t.value in classes]
        for inner in shapes.objects(node, SH + "property"):
            for iri in _path(shapes, inner):
                if iri in properties:
                    _apply_shape(shapes, inner, targets, classes, properties[iri])
        for iri in _required_unless_of_a_class(shapes, node):
            if iri in properties:
                for target in targets:
                    classes[target].required.append(iri)


def _required_unless_of_a_class(shapes: _Graph, node: Term) -> Iterator[str]:
    """Yield properties that a shape requires of all that are in no other class (SHACL, 4.6.3).

    An object of a Python class is in no class that is not above it, so there they are required.
    """
    for head in shapes.objects(node, SH + "or"):
        alternatives = list(shapes.members(head))
        inner = [
            i for alternative in alternatives for i in shapes.objects(alternative, SH + "property")
        ]
        classes = [
            alternative for alternative in alternatives if shapes.objects(alternative, SH + "class")
        ]
        others_are_classes = len(inner) == 1 and len(classes) == len(alternatives) - 1
        if others_are_classes and (_number(shapes, inner[0], "minCount") or 0) >= 1:
            yield from _path(shapes, inner[0])


def _path(shapes: _Graph, shape: Term) -> list[str]:
    return [p.value for p in shapes.objects(shape, SH + "path") if isinstance(p, NamedNode)]


def _number(shapes: _Graph, shape: Term, name: str) -> float | None:
    values = shapes.objects(shape, SH + name)
    return float(values[0].value) if values and isinstance(values[0], Literal) else None


def _apply_shape(
    shapes: _Graph,
    shape: Term,
    targets: list[str],
    classes: dict[str, ClassSpec],
    spec: PropertySpec,
) -> None:
    if (_number(shapes, shape, "minCount") or 0) >= 1:
        for target in targets:
            classes[target].required.append(spec.iri)
    if not set(spec.domains) <= set(targets):
        return  # it applies to some of the subjects only
    if _number(shapes, shape, "maxCount") == 1:
        spec.single = True
    patterns = shapes.objects(shape, SH + "pattern")
    spec.limits = Limits(
        least=_number(shapes, shape, "minInclusive"),
        most=_number(shapes, shape, "maxInclusive"),
        above=_number(shapes, shape, "minExclusive"),
        below=_number(shapes, shape, "maxExclusive"),
        pattern=patterns[0].value if patterns and isinstance(patterns[0], Literal) else None,
    )


def _individuals(
    graph: _Graph,
    classes: dict[str, ClassSpec],
    properties: dict[str, PropertySpec],
    primary: str,
) -> dict[str, str]:
    """Return named individuals; a property whose range is a closed list is bound to it."""
    named = sorted(graph.named(OWL + "NamedIndividual"))
    below: dict[str, set[str]] = {iri: {iri} for iri in classes}
    for iri in reversed(list(classes)):
        for parent in classes[iri].parents:
            below[parent] |= below[iri]
    members: dict[str, list[str]] = defaultdict(list)
    for iri in named:
        kinds = set(graph.iris(iri, _TYPE))
        for kind, narrower in below.items():
            if kinds & narrower:
                members[kind].append(iri)
    closed = below.get(_CLOSED, set())
    for spec in properties.values():
        if spec.is_link and spec.value in closed and members[spec.value]:
            spec.limits = Limits(one_of=tuple(members[spec.value]))
    own = {iri for iri in named if iri.startswith(primary or "")}
    return {name: iri for iri, name in unique_names(own, primary, field_name).items()}
