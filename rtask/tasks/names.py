"""Names for people of what a plan mentions, different for different things."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from urllib.parse import unquote

from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select

__all__ = ["names_of"]

_CHUNK = 2000
_DIGITS = re.compile(r"[0-9a-f]{8}-[0-9a-f-]{20,}")


def names_of(select: Select, iris: Iterable[str]) -> dict[str, str]:
    """Return a name for each IRI: its own, that of its product, or its label.

    Of those that share a name, each has in brackets the part of its IRI that differs.
    """
    sought = sorted(set(iris))
    names: dict[str, str] = {}
    exemplars: set[str] = set()
    for at in range(0, len(sought), _CHUNK):
        nodes = " ".join(str(NamedNode(value)) for value in sought[at : at + _CHUNK])
        rows = select(
            f"{PREFIXES}SELECT ?s (MIN(?own) AS ?name) (MIN(?kind) AS ?product) "
            f"(MIN(?text) AS ?label) WHERE {{ VALUES ?s {{ {nodes} }} "
            "OPTIONAL { ?s rt:name ?own } OPTIONAL { ?s rt:exemplarOf/rt:name ?kind } "
            "OPTIONAL { ?s rdfs:label ?text } } GROUP BY ?s"
        )
        for row in rows:
            name = row.value("name") or row.value("product") or row.value("label")
            if name:
                names[str(row.value("s"))] = str(name)
            if row.value("product"):
                exemplars.add(str(row.value("s")))
    for value in sought:
        names.setdefault(value, unquote(local_name(value)) or value)
    return _distinct(names, exemplars)


def _distinct(names: dict[str, str], exemplars: set[str]) -> dict[str, str]:
    groups: dict[tuple[str, bool], list[str]] = defaultdict(list)
    for value, name in names.items():
        groups[name, value in exemplars].append(value)  # a thing is told from its product anyhow
    for (name, _), members in groups.items():
        if len(members) > 1:
            for value in members:
                names[value] = f"{name} ({_difference(value, members)})"
    return names


def _difference(value: str, members: Sequence[str]) -> str:
    """Return the first part of an IRI that is not the same in all of several."""
    parts = [re.split(r"[/#]", member) for member in members]
    own = re.split(r"[/#]", value)
    for at, part in enumerate(own):
        if any(len(other) <= at or other[at] != part for other in parts):
            return part[-4:] if _DIGITS.fullmatch(part) else unquote(part)
    return unquote(own[-1])
