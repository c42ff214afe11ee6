"""Statements about placements, things and doubts about their identity."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import ontology
from grasp.spatial.frames import pose_from_matrix
from rtask.rdf.namespaces import PROV, RDF, RT, mint
from rtask.rdf.terms import Literal, NamedNode, Triple, Value
from rtask.world.placement import RELATIONS, TIME, Placement

__all__ = [
    "Statement",
    "confirmed",
    "doubted",
    "ended",
    "new_exemplar",
    "placed",
    "pose_statements",
    "time_stamp",
]

Statement: TypeAlias = tuple[NamedNode, NamedNode, Value]

_STAMP = NamedNode(ontology.PREFIXES["xsd"] + "dateTimeStamp")
_PROPERTY = {relation: name for name, relation in RELATIONS.items()}


def time_stamp(time_s: float) -> Literal:
    """Return a Unix time, s, as xsd:dateTimeStamp."""
    time = dt.datetime.fromtimestamp(time_s, dt.UTC)
    return Literal(time.isoformat().replace("+00:00", "Z"), datatype=_STAMP)


def placed(placement: Placement) -> Iterator[Statement]:
    """Yield the statements of a new placement, which has not ended."""
    node, begin = NamedNode(placement.iri), NamedNode(f"{placement.iri}/begin")
    yield node, RDF.type, RT.Placement
    yield node, RT.placementOf, NamedNode(placement.subject)
    yield node, TIME.hasBeginning, begin
    yield begin, RDF.type, TIME.Instant
    yield begin, TIME.inXSDDateTimeStamp, time_stamp(placement.begin)
    if placement.relation in _PROPERTY:
        yield node, _PROPERTY[placement.relation], NamedNode(placement.place)
    if placement.frame_from_subject is not None:
        pose = NamedNode(f"{placement.iri}/pose")
        yield node, RT.placementPose, pose
        yield node, RT.positionSigma, _number(placement.sigma_m, 6)
        yield from pose_statements(pose, placement.frame, placement.frame_from_subject)
    yield node, RT.placementConfidence, _number(float(np.clip(placement.confidence, 0, 1)), 6)
    if placement.agent:
        yield node, PROV.wasAttributedTo, NamedNode(placement.agent)
    if placement.source:
        yield node, PROV.wasDerivedFrom, NamedNode(placement.source)


def pose_statements(
    pose: NamedNode, frame: str, frame_from_body: NDArray[np.float64]
) -> Iterator[Statement]:
    """Yield the statements of an ``rt:Pose`` (4, 4), m, in a frame."""
    position, quaternion = pose_from_matrix(frame_from_body)
    yield pose, RDF.type, RT.Pose
    yield pose, RT.inFrame, NamedNode(frame)
    for name, number in zip("xyz", position, strict=True):
        yield pose, getattr(RT, name), _number(float(number), 6)
    for name, number in zip("xyzw", quaternion, strict=True):
        # The norm must be 1 within 1e-6, which six digits do not guarantee.
        yield pose, getattr(RT, f"q{name}"), _number(float(number), 10)


def ended(placement: str, time_s: float) -> Iterator[Statement]:
    """Yield the statements that end a placement."""
    end = NamedNode(f"{placement}/end")
    yield NamedNode(placement), TIME.hasEnd, end
    yield end, RDF.type, TIME.Instant
    yield end, TIME.inXSDDateTimeStamp, time_stamp(time_s)


def confirmed(placement: str, time_s: float) -> Statement:
    """Return the statement that a thing was seen again where it was."""
    return NamedNode(placement), RT.confirmedAt, time_stamp(time_s)


def new_exemplar(exemplar: str, product: str) -> Iterator[Statement]:
    """Yield the statements of a new exemplar of a product."""
    node = NamedNode(exemplar)
    yield node, RDF.type, RT.Exemplar
    yield node, RT.exemplarOf, NamedNode(product)


def doubted(
    base: str, exemplar: str, other: str, chance: float, time_s: float
) -> Iterator[Statement]:
    """Yield the statements that a thing may be another one, with the chance and since when."""
    statement = Triple(NamedNode(exemplar), RT.possiblyIdenticalTo, NamedNode(other))
    reifier = NamedNode(mint(base, "statement"))
    yield NamedNode(exemplar), RT.possiblyIdenticalTo, NamedNode(other)
    yield reifier, RDF.reifies, statement
    yield reifier, RT.confidence, _number(chance, 6)
    yield reifier, PROV.generatedAtTime, dt.datetime.fromtimestamp(time_s, dt.UTC)


def _number(value: float, digits: int) -> float:
    # -0.0 and 0.0 would be two values of a functional property.
    return round(value, digits) + 0.0
