"""IRIs: the ontology's terms as Python attributes (``RT.GraspAttempt``), and new ones."""

from __future__ import annotations

import os
import re
import time
import uuid
from collections.abc import Iterable

import ontology
from rtask.errors import UnknownTermError
from rtask.rdf.terms import NamedNode, prologue

__all__ = [
    "CORA",
    "PREFIXES",
    "PROV",
    "RDF",
    "RDFS",
    "RT",
    "SOSA",
    "Namespace",
    "local_name",
    "mint",
    "reason",
    "uuid7",
    "values",
]

PREFIXES = prologue(ontology.PREFIXES)
"""``PREFIX`` lines for every query of the engine."""


class Namespace:
    """IRIs of one namespace by local name.

    >>> Namespace("urn:x#").mug
    <NamedNode value=urn:x#mug>
    """

    def __init__(self, start: str) -> None:
        self._start = start

    def __getattr__(self, name: str) -> NamedNode:
        if name.startswith("__"):
            raise AttributeError(name)
        return NamedNode(self._start + name)


RT = Namespace(ontology.NS)
RDF = Namespace(ontology.PREFIXES["rdf"])
RDFS = Namespace(ontology.PREFIXES["rdfs"])
PROV = Namespace(ontology.PREFIXES["prov"])
SOSA = Namespace(ontology.PREFIXES["sosa"])
CORA = Namespace(ontology.PREFIXES["cora"])

_CODE = re.compile(r"[a-z][a-z0-9_]*")


def reason(code: str) -> NamedNode:
    """Return the individual of an outcome reason such as ``ok`` or ``slip_lift``.

    Raises
    ------
    UnknownTermError
        If the text does not have the form of a code.
    """
    if not _CODE.fullmatch(code):
        raise UnknownTermError(f"{code!r} is not a reason code; expected a word such as slip_lift")
    return NamedNode(f"{ontology.NS}reason_{code}")


def local_name(iri: NamedNode | str) -> str:
    """Return the part of an IRI after the last ``#`` or ``/``.

    >>> local_name("urn:x/y#Mug")
    'Mug'
    """
    text = iri.value if isinstance(iri, NamedNode) else iri
    return re.split(r"[#/]", text)[-1]


def values(iris: Iterable[NamedNode | str]) -> str:
    """Return IRIs as the rows of a ``VALUES`` clause, sorted so that equal sets give equal text.

    >>> values(["urn:b", "urn:a"])
    '<urn:a> <urn:b>'
    """
    terms = {iri if isinstance(iri, NamedNode) else NamedNode(iri) for iri in iris}
    return " ".join(sorted(str(term) for term in terms))


def uuid7() -> uuid.UUID:
    """Return a UUID that sorts by creation time (RFC 9562, 5.7).

    >>> uuid7().version
    7
    """
    number = (time.time_ns() // 1_000_000) << 80 | int.from_bytes(os.urandom(10), "big")
    number = number & ~(0xF << 76) | 7 << 76
    number = number & ~(0x3 << 62) | 2 << 62
    return uuid.UUID(int=number)


def mint(base: str, name: str) -> str:
    """Return a new IRI whose local name begins with ``name``.

    >>> mint("urn:lab/", "GraspAttempt").startswith("urn:lab/grasp-attempt/")
    True
    """
    kind = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower()
    return f"{base}{kind}/{uuid7()}"
