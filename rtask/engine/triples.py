"""Triples to be stored together, with uniform numbers and times."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import ontology
from grasp.spatial.frames import pose_from_matrix
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import Literal, NamedNode, Triple, Value

if TYPE_CHECKING:
    from rtask.kb.commit.transaction import Transaction
    from rtask.kb.durability.blobs import Blob

__all__ = ["Triples", "rounded", "stamp"]

_STAMP = NamedNode(ontology.PREFIXES["xsd"] + "dateTimeStamp")
_METRE_DIGITS = 6
_QUATERNION_DIGITS = 10


def stamp(time: dt.datetime) -> Literal:
    """Return a time as xsd:dateTimeStamp, the type of ``rt:atTime``."""
    return Literal(time.astimezone(dt.UTC).isoformat().replace("+00:00", "Z"), datatype=_STAMP)


def rounded(value: float) -> float:
    """Return a number rounded as in the graph.

    >>> rounded(-1e-9)
    0.0
    """
    # -0.0 and 0.0 would be two values of a functional property.
    return round(value, _METRE_DIGITS) + 0.0


class Triples:
    """Triples that will be stored together.

    Examples
    --------
    >>> triples = Triples()
    >>> triples.add(RT.mug, RT.mass, 0.3)
    >>> triples.add(RT.mug, RT.name, None)
    >>> len(triples)
    1
    """

    def __init__(self) -> None:
        self._stated: list[tuple[NamedNode, NamedNode, Value]] = []

    def __iter__(self) -> Iterator[tuple[NamedNode, NamedNode, Value]]:
        return iter(self._stated)

    def __len__(self) -> int:
        return len(self._stated)

    def add(self, subject: NamedNode, predicate: NamedNode, value: Value | None) -> None:
        """Add a triple; None adds nothing."""
        if value is None:
            return
        if isinstance(value, float):
            value = rounded(value)
        self._stated.append((subject, predicate, value))

    def node(
        self,
        subject: NamedNode,
        kinds: Iterable[NamedNode],
        properties: Mapping[NamedNode, Value | None],
    ) -> NamedNode:
        """Add the classes and properties of an individual, and return it."""
        for kind in kinds:
            self._stated.append((subject, RDF.type, kind))
        for predicate, value in properties.items():
            self.add(subject, predicate, value)
        return subject

    def pose(
        self, subject: NamedNode, frame: NamedNode, frame_from_body: NDArray[np.float64]
    ) -> NamedNode:
        """Add an ``rt:Pose``: seven numbers in a frame."""
        position, quaternion = pose_from_matrix(frame_from_body)
        self.node(subject, [RT.Pose], {RT.inFrame: frame})
        for name, number in zip("xyz", position, strict=True):
            self.add(subject, getattr(RT, name), float(number))
        for name, number in zip("xyzw", quaternion, strict=True):
            # The norm must be 1 within 1e-6, which six digits do not guarantee.
            exact = round(float(number), _QUATERNION_DIGITS) + 0.0
            self._stated.append((subject, getattr(RT, "q" + name), exact))
        return subject

    def position(
        self, subject: NamedNode, frame: NamedNode, place: NDArray[np.float64]
    ) -> NamedNode:
        """Add the frame and the coordinates (3,), m, of an ``rt:Position``."""
        self.add(subject, RT.inFrame, frame)
        for name, number in zip("xyz", place, strict=True):
            self.add(subject, getattr(RT, name), float(number))
        return subject

    def direction(
        self, subject: NamedNode, frame: NamedNode, vector: NDArray[np.float64]
    ) -> NamedNode:
        """Add an ``rt:Direction``: a unit vector (3,) in a frame."""
        self.node(subject, [RT.Direction], {RT.inFrame: frame})
        for name, number in zip("XYZ", vector, strict=True):
            # As of quaternions, the norm must be 1 within 1e-6.
            exact = round(float(number), _QUATERNION_DIGITS) + 0.0
            self._stated.append((subject, getattr(RT, "dir" + name), exact))
        return subject

    def blob(self, blob: Blob) -> NamedNode:
        """Add the description of stored bytes."""
        for subject, predicate, value in blob.statements():
            assert isinstance(subject, NamedNode)
            self._stated.append((subject, predicate, value))
        return blob.iri

    def with_confidence(
        self,
        reifier: NamedNode,
        subject: NamedNode,
        predicate: NamedNode,
        value: NamedNode,
        confidence: float,
    ) -> None:
        """Add a triple with a confidence on its reifier (RDF 1.2)."""
        self._stated.append((subject, predicate, value))
        self._stated.append((reifier, RDF.reifies, Triple(subject, predicate, value)))
        self.add(reifier, RT.confidence, confidence)

    def extend(self, others: Iterable[tuple[NamedNode, NamedNode, Value]]) -> None:
        """Add all triples of another collection."""
        self._stated.extend(others)

    def discard(self, subject: NamedNode, predicates: Collection[NamedNode]) -> None:
        """Remove the values of some properties of a subject."""
        self._stated = [t for t in self._stated if t[0] != subject or t[1] not in predicates]

    def write(self, transaction: Transaction) -> None:
        """Assert everything in the transaction's own graph."""
        for subject, predicate, value in self._stated:
            transaction.add(subject, predicate, value)
