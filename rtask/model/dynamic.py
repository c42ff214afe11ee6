"""Python classes for any loaded ontology, created at run time."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rtask.errors import UnknownTermError
from rtask.model.codec import THING
from rtask.model.fields import Field, Link, Links, Many, One
from rtask.model.instance import Identity, Model, Registry, make_class
from rtask.model.lists import Ordered
from rtask.model.registry import rank, vocabularies_of
from rtask.model.schema import ClassSpec, PropertySpec, Schema, Triples, read_schema
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.model.backing import Statements

__all__ = ["Vocabulary", "build", "load_model"]

_IMPORTS = "http://www.w3.org/2002/07/owl#imports"


class Vocabulary:
    """The classes of one ontology, by local name (attribute) or by IRI (index).

    Parameters
    ----------
    registry
        The classes.
    individuals
        Python name to IRI of the named individuals.
    """

    def __init__(self, registry: Registry, individuals: dict[str, str]) -> None:
        self.registry = registry
        self._names = {model.__name__: model for model in registry}
        self._individuals = individuals

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name in self._names:
            return self._names[name]
        if name in self._individuals:
            return NamedNode(self._individuals[name])
        near = difflib.get_close_matches(name, [*self._names, *self._individuals], 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise AttributeError(f"the ontology has no class {name!r}{hint}")

    def __getitem__(self, name: str | NamedNode) -> type[Model]:
        model = self.registry.find(iri(name).value)
        if model is None:
            raise UnknownTermError(f"the ontology has no class {iri(name)}")
        return model

    def __iter__(self) -> Iterator[type[Model]]:
        return iter(self.registry)

    def __dir__(self) -> list[str]:
        return sorted([*self._names, *self._individuals])


def load_model(kb: Statements, name: str | NamedNode) -> Vocabulary:
    """Return classes for a loaded ontology and its imports.

    Classes of the built-in vocabulary are reused, so that an ontology that extends it fits in.

    Parameters
    ----------
    name
        IRI of the ontology, which is also the name of its graph.

    Raises
    ------
    UnknownTermError
        If no graph of that name is loaded.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:") as kb:
    ...     onto = load_model(kb, "https://w3id.org/rtask-kg/onto")
    ...     onto.Mug.mass
    Mug.mass
    """
    from rtask.model.generated import rtask as built_in

    graphs, open_ = list[NamedNode](), [iri(name)]
    while open_:
        graph = open_.pop()
        quads = kb.match(predicate=_IMPORTS, graph=graph)
        graphs.append(graph)
        open_ += [
            q.object
            for q in quads
            if isinstance(q.object, NamedNode) and q.object not in [*graphs, *open_]
        ]
    triples: Triples = [
        (q.subject, q.predicate, q.object) for graph in graphs for q in kb.match(graph=graph)
    ]
    if not triples:
        raise UnknownTermError(f"no ontology {iri(name)} is loaded; kb.load() it first")
    registry = built_in.REGISTRY
    schema = read_schema(triples, primary=_namespace(iri(name).value), find_model=registry.find)
    vocabulary = build(schema, registry)
    vocabularies_of(kb)[iri(name).value] = vocabulary.registry
    return vocabulary


def _namespace(ontology_iri: str) -> str:
    return ontology_iri if ontology_iri.endswith(("#", "/")) else ontology_iri + "#"


def build(schema: Schema, parent: Registry | None = None) -> Vocabulary:
    """Create classes from a schema; those that ``parent`` already has are reused."""
    registry = Registry(parent)
    made: dict[str, type[Model]] = {}
    added: dict[type[Model], list[PropertySpec]] = {}
    for spec in schema.classes.values():
        inherited = parent.find(spec.iri) if parent is not None else None
        if (
            inherited is not None
        ):  # what the ontology adds to it is inherited by its own classes below
            made[spec.iri] = inherited
            added[inherited] = [
                prop for prop in spec.properties if prop.iri not in inherited.__by_iri__
            ]
        else:
            bases = [made[base] for base in spec.parents] or [Model]
            made[spec.iri] = _make_class(spec, bases, added, registry)
    return Vocabulary(registry, schema.individuals)


def _make_class(
    spec: ClassSpec,
    bases: list[type[Model]],
    added: dict[type[Model], list[PropertySpec]],
    registry: Registry,
) -> type[Model]:
    bases = [b for b in bases if not any(o is not b and issubclass(o, b) for o in bases)]
    body: dict[str, Any] = {
        "__iri__": spec.iri,
        "__registry__": registry,
        "__doc__": f"{spec.comment}\n\n``{spec.iri}``".strip(),
        "__module__": __name__,
    }
    if spec.iri == THING:
        body["iri"] = Identity()
    names = {prop.iri: prop.name for prop in spec.properties}
    body["__required__"] = tuple(names[iri] for iri in spec.required if iri in names)
    above = {model for base in bases for model in base.__mro__}
    extra = [prop for model, props in added.items() if model in above for prop in props]
    inherited = {iri for base in bases for iri in base.__by_iri__}
    for prop in (*spec.properties, *extra):
        if prop.iri not in inherited:
            body[prop.name] = make_field(prop)
    return make_class(spec.name, tuple(sorted(bases, key=rank)), body)


def make_field(spec: PropertySpec) -> Field:
    """Return the field of a property."""
    kind: type[Field]
    if spec.is_list:
        kind = Ordered
    elif spec.is_link:
        kind = Link if spec.single else Links
    else:
        kind = One if spec.single else Many
    return kind(
        spec.iri,
        spec.value,
        functional=spec.functional,
        inverse=spec.inverse,
        stored=spec.stored,
        unit=spec.unit,
        limits=spec.limits,
    )
