"""Python names for the classes and properties of ontologies."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Container

import ontology

__all__ = ["class_name", "field_name", "local_name", "unique_names"]

_RESERVED = {
    *("iri", "annotations", "registry", "str", "int", "float", "bool", "object", "datetime"),
    *("ontology", "Model", "One", "Many", "Link", "Links", "Ordered", "Identity", "Limits"),
    *("Registry", "NamedNode", "ClassVar", "REGISTRY"),
}
"""Names that are reserved in classes and generated modules."""


def local_name(iri: str) -> str:
    """Return the part of an IRI behind the last separator."""
    return re.split(r"[#/:]", iri.rstrip("#/"))[-1]


def class_name(local: str) -> str:
    """Return the name of a Python class for a local name."""
    words = re.split(r"\W+", local)
    return "".join(word[:1].upper() + word[1:] for word in words)


def field_name(local: str) -> str:
    """Return the name of a Python field for a local name."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", local)
    return re.sub(r"\W+", "_", words).lower()


def _prefix(iri: str) -> str:
    for name, namespace in ontology.PREFIXES.items():
        if iri.startswith(namespace):
            return name
    parts = re.split(r"[#/:]", iri.rstrip("#/"))
    return re.sub(r"\W", "_", parts[-2]) if len(parts) > 1 and parts[-2] else "other"


def _is_taken(name: str, taken: Container[str]) -> bool:
    special = keyword.iskeyword(name) or name.startswith("__") or name in _RESERVED
    return special or name in taken


def unique_names(iris: set[str], primary: str, make: Callable[[str], str]) -> dict[str, str]:
    """Give each IRI its own Python name."""
    taken: dict[str, str] = {}
    order = sorted(iris, key=lambda iri: (not primary or not iri.startswith(primary), iri))
    for iri in order:
        name = make(local_name(iri))
        if not name.isidentifier() or _is_taken(name, taken):
            name = make(f"{_prefix(iri)}-{local_name(iri)}")
        if not name.isidentifier():
            name = f"n_{name}" if f"n_{name}".isidentifier() else "unnamed"
        while _is_taken(name, taken):
            name = f"{name.lstrip('_')}_"
        taken[name] = iri
    return {iri: name for name, iri in taken.items()}
