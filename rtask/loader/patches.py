"""Known faults of published ontologies, left out when these are loaded (``ontology/patches.toml``).

A fault is a statement; a statement with a list is recognised by the list's members, and the list
is left out with it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pyoxigraph import BlankNode, NamedNode, Quad

import ontology

__all__ = ["Patch", "mend", "patches"]

_RDF = ontology.PREFIXES["rdf"]
_FIRST, _REST, _NIL = (NamedNode(_RDF + name) for name in ("first", "rest", "nil"))


@dataclass(frozen=True)
class Fault:
    """Statements with one subject and predicate that are left out.

    Parameters
    ----------
    objects
        Their objects.
    members
        Of a statement whose object is a list: the members of the list, in any order.
    """

    subject: NamedNode
    predicate: NamedNode
    objects: frozenset[NamedNode]
    members: frozenset[NamedNode]

    @property
    def size(self) -> int:
        """Number of statements."""
        return len(self.objects) or 1


@dataclass(frozen=True)
class Patch:
    """A named patch of one published ontology.

    Parameters
    ----------
    ontology
        IRI of the ontology.
    edition
        Where the fault was found.
    reason
        Why the statements are wrong.
    """

    name: str
    ontology: str
    edition: str
    reason: str
    faults: tuple[Fault, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the patch as JSON-able values."""
        return {
            "name": self.name,
            "ontology": self.ontology,
            "edition": self.edition,
            "reason": self.reason,
            "removes": [line for fault in self.faults for line in _lines(fault)],
        }


def _lines(fault: Fault) -> list[str]:
    start = f"{fault.subject} {fault.predicate}"
    if fault.members:
        return [f"{start} ( {' '.join(sorted(map(str, fault.members)))} )"]
    return [f"{start} {object_text}" for object_text in sorted(map(str, fault.objects))]


@lru_cache(maxsize=1)
def patches() -> tuple[Patch, ...]:
    """Return the known patches."""
    listed = tomllib.loads(ontology.patches().read_text("utf-8"))["patch"]
    return tuple(
        Patch(
            entry["name"],
            entry["ontology"],
            entry["edition"],
            entry["reason"],
            tuple(map(_fault, entry["remove"])),
        )
        for entry in listed
    )


def _fault(entry: dict[str, Any]) -> Fault:
    objects = entry.get("objects") or ([entry["object"]] if "object" in entry else [])
    return Fault(
        NamedNode(entry["subject"]),
        NamedNode(entry["predicate"]),
        frozenset(map(NamedNode, objects)),
        frozenset(map(NamedNode, entry.get("members", ()))),
    )


def mend(
    quads: Sequence[Quad], name: NamedNode | None
) -> tuple[list[Quad], list[Patch], list[Patch]]:
    """Leave the known faults of an ontology out.

    Parameters
    ----------
    quads
        All statements of the document.
    name
        IRI of the ontology; ``None`` for data.

    Returns
    -------
    list of Quad
        What is left.
    list of Patch
        Patches that were applied.
    list of Patch
        Patches for this ontology whose statements the document does not have.
    """
    applied: list[Patch] = []
    stale: list[Patch] = []
    wrong: set[Quad] = set()
    for patch in patches():
        if name is None or patch.ontology != name.value:
            continue
        faulty = {quad for fault in patch.faults for quad in _faulty_quads(fault, quads)}
        (applied if faulty else stale).append(patch)
        wrong |= faulty
    if not wrong:
        return list(quads), applied, stale
    return [quad for quad in quads if quad not in wrong], applied, stale


def _faulty_quads(fault: Fault, quads: Iterable[Quad]) -> set[Quad]:
    """Return the statements of a fault that a document has, lists with all their nodes."""
    stated = [q for q in quads if q.subject == fault.subject and q.predicate == fault.predicate]
    if not fault.members:
        return {quad for quad in stated if quad.object in fault.objects}
    about: dict[object, list[Quad]] = {}
    for quad in quads:
        if isinstance(quad.subject, BlankNode):
            about.setdefault(quad.subject, []).append(quad)
    faulty: set[Quad] = set()
    for quad in stated:
        cells, members = _list(quad.object, about)
        if members == fault.members:
            faulty |= {quad, *cells}
    return faulty


def _list(head: object, about: dict[object, list[Quad]]) -> tuple[list[Quad], set[object]]:
    """Return the statements of a list and its members; nothing where it does not end."""
    cells: list[Quad] = []
    members: set[object] = set()
    seen: set[object] = set()
    while head != _NIL and head not in seen:
        seen.add(head)
        own = about.get(head, [])
        cells += own
        members |= {quad.object for quad in own if quad.predicate == _FIRST}
        head = next((quad.object for quad in own if quad.predicate == _REST), head)
    return (cells, members) if head == _NIL else ([], set())
