"""IRIs: the ontology's terms as Python attributes (``RT.GraspAttempt``), and new ones."""

from __future__ import annotations

import hashlib
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
    "is_owned",
    "local_name",
    "mint",
    "owned_uuid7",
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


def owned_uuid7(owner: str) -> uuid.UUID:
    """Return a UUID that sorts by creation time and of which one can tell later whose it is.

    The last 40 of its random bits are a digest of the others and of the owner's name, so that
    nothing need be remembered: not by a server that was restarted, nor by its copies.

    >>> made = owned_uuid7("nao-1")
    >>> made.version, is_owned(made, "nao-1"), is_owned(made, "nao-2")
    (7, True, False)
    """
    drawn = uuid7()
    return uuid.UUID(int=drawn.int >> 40 << 40 | _owner_bits(drawn, owner))


def is_owned(made: uuid.UUID, owner: str) -> bool:
    """Whether a UUID was made for this owner by :func:`owned_uuid7`."""
    return made.int & (1 << 40) - 1 == _owner_bits(made, owner)


def _owner_bits(made: uuid.UUID, owner: str) -> int:
    digest = hashlib.sha256(made.bytes[:11] + owner.encode()).digest()
    return int.from_bytes(digest[:5], "big")


def mint(base: str, name: str) -> str:
    """Return a new IRI whose local name begins with ``name``.

    >>> mint("urn:lab/", "GraspAttempt").startswith("urn:lab/grasp-attempt/")
    True
    """
    kind = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name).lower()
    return f"{base}{kind}/{uuid7()}"
