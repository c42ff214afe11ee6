"""Python source for the classes of an ontology: typed, so that a checker knows every field."""

from __future__ import annotations

import textwrap
from pathlib import Path

import pyoxigraph as ox

import ontology
from rtask.model.codec import python_type
from rtask.model.limits import Limits
from rtask.model.schema import THING, ClassSpec, PropertySpec, Schema, Triples, read_schema

__all__ = ["generate", "generate_rtask", "rtask_schema", "write_rtask"]

_HEADER = '''"""Typed classes for the vocabulary of RTASK; generated, do not edit.

Written by ``rtask.model.generate.generate_rtask()`` from the modules and shapes of the room
``ontology``.
"""

# fmt: off
# ruff: noqa: E501 - one field is one line, however long

from __future__ import annotations

import datetime
from typing import ClassVar

import ontology
from rtask.kb.terms import NamedNode
from rtask.model.fields import Link, Links, Many, One
from rtask.model.instance import Identity, Model, Registry
from rtask.model.limits import Limits

REGISTRY = Registry()
'''


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
    """Write that source, into this package unless ``path`` says where; return the file."""
    file = path or Path(__file__).parent / "generated" / "rtask.py"
    file.write_text(generate_rtask(), encoding="utf-8")
    return file


def generate(schema: Schema) -> str:
    """Return the source of a module with one class for each class of a schema.

    The same schema always gives the same text.
    """
    used = {iri for spec in schema.classes.values() for iri in _iris(spec)}
    used |= set(schema.individuals.values())
    prefixes = {
        name: namespace
        for name, namespace in ontology.PREFIXES.items()
        if any(iri.startswith(namespace) for iri in used)
    }
    write = _Writer(schema, prefixes)
    constants = "\n".join(f'_{name.upper()} = ontology.PREFIXES["{name}"]' for name in prefixes)
    parts = [_HEADER + constants]
    parts += [write.model(spec) for spec in schema.classes.values()]
    individuals = [
        f"{name} = NamedNode({write.iri(iri)})" for name, iri in sorted(schema.individuals.items())
    ]
    return "\n\n\n".join([*parts, "\n".join(individuals)]).rstrip() + "\n"


def _iris(spec: ClassSpec) -> list[str]:
    values = [v for prop in spec.properties for v in (prop.iri, prop.value, *prop.limits.one_of)]
    return [spec.iri, *values, *(p.inverse for p in spec.properties if p.inverse)]


class _Writer:
    """Writes classes of one schema."""

    def __init__(self, schema: Schema, prefixes: dict[str, str]) -> None:
        self._schema = schema
        self._prefixes = prefixes
        specs = [prop for spec in schema.classes.values() for prop in spec.properties]
        self._names = {prop.iri: prop.name for prop in specs}

    def iri(self, iri: str) -> str:
        """Return an expression for an IRI."""
        for name, namespace in self._prefixes.items():
            if iri.startswith(namespace):
                return f'_{name.upper()} + "{iri[len(namespace) :]}"'
        return f'"{iri}"'

    def model(self, spec: ClassSpec) -> str:
        """Return one class."""
        bases = ", ".join(self._schema.classes[p].name for p in spec.parents) or "Model"
        lines = [f"class {spec.name}({bases}):", self._docstring(spec), ""]
        lines.append(f"    __iri__: ClassVar[str] = {self.iri(spec.iri)}")
        if spec.iri == THING:
            lines.append("    __registry__ = REGISTRY")
        required = sorted(self._names[iri] for iri in spec.required)
        if required:
            listed = ", ".join(f'"{name}"' for name in required)
            lines.append(f"    __required__: ClassVar[tuple[str, ...]] = ({listed},)")
        lines.append("")
        if spec.iri == THING:
            lines.append("    iri: Identity = Identity()")
        lines += [self._field(prop) for prop in sorted(spec.properties, key=lambda p: p.name)]
        return "\n".join(lines).rstrip()

    def _docstring(self, spec: ClassSpec) -> str:
        text = spec.comment or "The root of all classes."
        lines = textwrap.wrap(text, 94)
        lines += ["", f"``{_short(spec.iri)}``"]
        own = sorted(spec.properties, key=lambda p: p.name)
        if own:
            lines += ["", "Attributes", "----------"]
        for prop in own:
            lines.append(prop.name)
            unit = f" [{prop.unit}]" if prop.unit else ""
            lines += textwrap.wrap(
                prop.comment + unit, 90, initial_indent="    ", subsequent_indent="    "
            )
        body = "\n".join(f"    {line}".rstrip() for line in lines).replace("\\", "\\\\")
        return f'    """{body.strip()}\n    """'

    def _field(self, prop: PropertySpec) -> str:
        if prop.is_link:
            kind = "Link" if prop.single else "Links"
            inner = self._schema.classes[prop.value].name
        else:
            kind = "One" if prop.single else "Many"
            plain = python_type(prop.value)
            dated = plain.__module__ == "datetime"
            inner = f"datetime.{plain.__name__}" if dated else plain.__name__
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


def _short(iri: str) -> str:
    for name, namespace in ontology.PREFIXES.items():
        if iri.startswith(namespace):
            return f"{name}:{iri[len(namespace) :]}"
    return iri
