"""Generate typed Python source for the classes of an ontology."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path
from typing import Protocol

import pyoxigraph as ox

import ontology
from rtask.model.codec import THING, python_type
from rtask.model.instance import Model, Registry
from rtask.model.limits import Limits
from rtask.model.schema import ClassSpec, PropertySpec, Schema, Triples, read_schema

__all__ = ["generate", "generate_for", "generate_rtask", "rtask_schema", "write_rtask"]

_ORIGIN = """Typed classes for the vocabulary of RTASK; generated, do not edit.

Written by ``rtask.model.generate.generate_rtask()`` from the modules and shapes in ``ontology/``.
"""
_HEADER = """
# fmt: off
# ruff: noqa: E501 - one field is one line, however long

from __future__ import annotations

import datetime
{decimal}from typing import ClassVar

import ontology
from rtask.model.fields import Link, Links, Many, One
{extends}from rtask.model.instance import Identity, Model, Registry
from rtask.model.limits import Limits
{lists}from rtask.rdf.terms import NamedNode

REGISTRY = Registry({parent})
"""


def _triples(paths: list[Path]) -> Triples:
    return [
        (quad.subject, quad.predicate, quad.object)
        for path in paths
        for quad in ox.parse(path=str(path), rename_blank_nodes=True)
    ]


def rtask_schema() -> Schema:
    """Return the schema of the bundled ontology and its shapes."""
    shapes = [*ontology.shapes(), *ontology.graph_shapes()]
    return read_schema(_triples(ontology.modules()), _triples(shapes), ontology.NS)


def generate_rtask() -> str:
    """Return the source of :mod:`rtask.model.generated.rtask`."""
    return generate(rtask_schema())


def write_rtask(path: Path | None = None) -> Path:
    """Write that source to ``path``, by default into this package; return the file."""
    file = path or Path(__file__).parent / "generated" / "rtask.py"
    file.write_text(generate_rtask(), encoding="utf-8")
    return file


def generate(schema: Schema, origin: str = _ORIGIN, parent: Registry | None = None) -> str:
    """Return the source of a module with one class for each class of a schema.

    The same schema always gives the same text.

    Parameters
    ----------
    origin
        The docstring of the module.
    parent
        The classes of RTASK, if the module extends them instead of repeating them.
    """
    write = _Writer(schema, parent)
    own = write.own
    fields = [prop for spec in own for prop in write.fields(spec)]
    used = {iri for spec in own for iri in _iris(spec, write.fields(spec))}
    used |= set(schema.individuals.values())
    write.prefixes = {
        name: namespace
        for name, namespace in ontology.PREFIXES.items()
        if any(iri.startswith(namespace) for iri in used)
    }
    header = _HEADER.format(
        decimal="import decimal\n" if any(map(_is_decimal, fields)) else "",
        extends="from rtask.model.generated import rtask as RTASK\n" if parent else "",
        lists="from rtask.model.lists import Ordered\n" if any(p.is_list for p in fields) else "",
        parent="RTASK.REGISTRY" if parent else "",
    )
    constants = "\n".join(
        f'_{name.upper()} = ontology.PREFIXES["{name}"]' for name in write.prefixes
    )
    parts = [f'"""{origin}"""\n{header}{constants}'.rstrip()]
    parts += [write.model(spec) for spec in own]
    individuals = [
        f"{name} = NamedNode({write.iri(iri)})" for name, iri in sorted(schema.individuals.items())
    ]
    return "\n\n\n".join([*parts, "\n".join(individuals)]).rstrip() + "\n"


class OntologySource(Protocol):
    """An ontology: its name, its IRI (empty if it has none) and its statements."""

    @property
    def name(self) -> str: ...
    @property
    def iri(self) -> str: ...
    @property
    def triples(self) -> Triples: ...


def generate_for(modules: Iterable[OntologySource]) -> str:
    """Return the source of typed classes for any ontology.

    They are subclasses of RTASK's classes where the ontology says so.

    Parameters
    ----------
    modules
        From :func:`rtask.ontology_docs.read_source`.
    """
    from rtask.model.generated.rtask import REGISTRY

    modules = list(modules)
    named = [module.iri for module in modules if module.iri]
    primary = min(named, default="")
    triples = [triple for module in modules for triple in module.triples]
    space = primary if primary.endswith(("#", "/")) else f"{primary}#"
    schema = read_schema(triples, primary=space, find_model=REGISTRY.find)
    title = ", ".join(sorted(named)) or ", ".join(module.name for module in modules)
    origin = f"Typed classes for {title}; generated, do not edit.\n\n``rtask model generate``.\n"
    return generate(schema, origin.replace("\\", "/").replace('"', "'"), REGISTRY)


def _is_decimal(prop: PropertySpec) -> bool:
    return not prop.is_link and not prop.is_list and python_type(prop.value) is Decimal


def _iris(spec: ClassSpec, fields: list[PropertySpec]) -> list[str]:
    values = [v for prop in fields for v in (prop.iri, prop.value, *prop.limits.one_of)]
    return [spec.iri, *values, *(p.inverse for p in fields if p.inverse)]


class _Writer:
    """Writes classes of one schema."""

    def __init__(self, schema: Schema, parent: Registry | None) -> None:
        self._schema = schema
        self._parent = parent
        self.prefixes: dict[str, str] = {}
        self.own = [spec for spec in schema.classes.values() if self._model_of(spec.iri) is None]
        specs = [prop for spec in schema.classes.values() for prop in spec.properties]
        self._names = {prop.iri: prop.name for prop in specs}
        self._orders: dict[str, list[str] | None] = {}

    def _model_of(self, iri: str) -> type[Model] | None:
        return self._parent.find(iri) if self._parent is not None else None

    def _class(self, iri: str) -> str:
        """Return the name of a class in the module."""
        model = self._model_of(iri)
        return f"RTASK.{model.__name__}" if model else self._schema.classes[iri].name

    def _order(self, iri: str) -> list[str] | None:
        """Return a class and its superclasses in Python's order; ``None`` if there is none."""
        if iri not in self._orders:
            model = self._model_of(iri)
            above = self._schema.classes[iri].parents if model is None else _iris_above(model)
            orders = [self._order(parent) or [parent] for parent in above]
            merged = _merged([*orders, list(above)])
            self._orders[iri] = None if merged is None else [iri, *merged]
        return self._orders[iri]

    def fields(self, spec: ClassSpec) -> list[PropertySpec]:
        """Return the fields that a class adds, and what the ontology adds to RTASK's above it."""
        parents = [model for iri in spec.parents if (model := self._model_of(iri)) is not None]
        above = {model for base in parents for model in base.__mro__}
        properties = {prop.iri: prop for prop in spec.properties}
        for other in self._schema.classes.values():
            if self._model_of(other.iri) in above:
                properties |= {prop.iri: prop for prop in other.properties}
        inherited = {iri for model in parents for iri in model.__by_iri__}
        return sorted(
            (p for p in properties.values() if p.iri not in inherited), key=lambda p: p.name
        )

    def iri(self, iri: str) -> str:
        """Return an expression for an IRI."""
        for name, namespace in self.prefixes.items():
            if iri.startswith(namespace):
                return f"_{name.upper()} + {_quoted(iri[len(namespace) :])}"
        return _quoted(iri)

    def model(self, spec: ClassSpec) -> str:
        """Return the source of one class."""
        bases = ", ".join(map(self._class, spec.parents)) or "Model"
        # Type checkers have only Python's own order of bases; see `ModelType`.
        unordered = "" if self._order(spec.iri) else "  # type: ignore[misc, metaclass]"
        lines = [f"class {spec.name}({bases}):{unordered}", self._docstring(spec), ""]
        lines.append(f"    __iri__: ClassVar[str] = {self.iri(spec.iri)}")
        if spec.iri == THING or self._parent is not None:
            lines.append("    __registry__ = REGISTRY")
        required = sorted(self._names[iri] for iri in spec.required)
        if required:
            listed = ", ".join(f'"{name}"' for name in required)
            lines.append(f"    __required__: ClassVar[tuple[str, ...]] = ({listed},)")
        lines.append("")
        if spec.iri == THING:
            lines.append("    iri: Identity = Identity()")
        lines += [self._field(prop) for prop in self.fields(spec)]
        return "\n".join(lines).rstrip()

    def _docstring(self, spec: ClassSpec) -> str:
        text = spec.comment or ("The root of all classes." if spec.iri == THING else "")
        lines = [*textwrap.wrap(text, 94), ""] if text else []
        lines.append(f"``{_short(spec.iri)}``")
        own = self.fields(spec)
        if own:
            lines += ["", "Attributes", "----------"]
        for prop in own:
            lines.append(prop.name)
            unit = f" [{prop.unit}]" if prop.unit else ""
            lines += textwrap.wrap(
                prop.comment + unit, 90, initial_indent="    ", subsequent_indent="    "
            )
        body = "\n".join(f"    {line}".rstrip() for line in lines).replace("\\", "\\\\")
        body = body.replace('""', "''")
        return f'    """{body.strip()}\n    """'

    def _field(self, prop: PropertySpec) -> str:
        if prop.is_list:
            kind, inner = "Ordered", "object"
        elif prop.is_link:
            kind = "Link" if prop.single else "Links"
            inner = self._class(prop.value)
        else:
            kind = "One" if prop.single else "Many"
            plain = python_type(prop.value)
            far = plain.__module__ in ("datetime", "decimal")
            inner = f"{plain.__module__}.{plain.__name__}" if far else plain.__name__
        options = [self.iri(prop.iri), self.iri(prop.value)]
        if prop.functional:
            options.append("functional=True")
        if prop.inverse:
            options.append(f"inverse={self.iri(prop.inverse)}")
        if not prop.stored:
            options.append("stored=False")
        if prop.unit:
            options.append(f'unit="{prop.unit}"')
        limits = self._limits(prop.limits)
        if limits:
            options.append(f"limits={limits}")
        return f"    {prop.name}: {kind}[{inner}] = {kind}({', '.join(options)})"

    def _limits(self, limits: Limits) -> str:
        options = [
            f"{name}={value!r}"
            for name in ("least", "most", "above", "below", "pattern")
            if (value := getattr(limits, name)) is not None
        ]
        if limits.one_of:
            listed = ", ".join(self.iri(iri) for iri in limits.one_of)
            options.append(f"one_of=({listed},)")
        return f"Limits({', '.join(options)})" if options else ""


def _iris_above(model: type[Model]) -> list[str]:
    return [
        base.__iri__ for base in model.__bases__ if issubclass(base, Model) and base is not Model
    ]


def _merged(orders: list[list[str]]) -> list[str] | None:
    """Merge orders of classes into one that agrees with each (C3, Barrett et al. 1996)."""
    merged: list[str] = []
    while orders := [order for order in orders if order]:
        later = {iri for order in orders for iri in order[1:]}
        head = next((order[0] for order in orders if order[0] not in later), None)
        if head is None:
            return None
        merged.append(head)
        orders = [order[1:] if order[0] == head else order for order in orders]
    return merged


def _quoted(text: str) -> str:
    """Return a string literal with double quotes."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _short(iri: str) -> str:
    for name, namespace in ontology.PREFIXES.items():
        if iri.startswith(namespace):
            return f"{name}:{iri[len(namespace) :]}"
    return iri
