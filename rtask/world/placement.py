"""Placements: the intervals in which a thing, or a frame, was at one place."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

import ontology
from grasp.spatial.frames import matrix_from_pose
from rtask.rdf.namespaces import PROV, RT, Namespace
from rtask.rdf.terms import NamedNode, iri, python_value

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = [
    "DEFAULT_SIGMA_M",
    "RELATIONS",
    "TIME",
    "Placement",
    "Relation",
    "pose_of",
    "read_placement",
    "seconds",
]

TIME = Namespace(ontology.PREFIXES["time"])
Relation: TypeAlias = Literal["at", "on", "in", "held_by"]
RELATIONS: dict[NamedNode, Relation] = {
    RT.placedOn: "on", RT.placedIn: "in", RT.heldBy: "held_by",
}  # fmt: skip
"""Relation that each property of a placement stands for; a mere pose is ``at``."""

DEFAULT_SIGMA_M = 0.01
"""Standard deviation per axis of a position that came without one, m."""

# A namespace makes a term anew each time that it is asked, and placements are read very often.
_CONFIRMED_AT, _SIGMA, _CONFIDENCE = RT.confirmedAt, RT.positionSigma, RT.placementConfidence
_OF, _POSE, _IN_FRAME = RT.placementOf, RT.placementPose, RT.inFrame
_BEGINNING, _END, _STAMP = TIME.hasBeginning, TIME.hasEnd, TIME.inXSDDateTimeStamp
_AUTHOR, _SOURCE = PROV.wasAttributedTo, PROV.wasDerivedFrom
_POSITION = (RT.x, RT.y, RT.z)
_QUATERNION = (RT.qx, RT.qy, RT.qz, RT.qw)


@dataclass(frozen=True, eq=False)
class Placement:
    """The place of a thing, or the pose of a frame, during an interval.

    Parameters
    ----------
    iri, subject
        The placement, and the thing or frame that it is of.
    begin, end, confirmed
        Unix time, s; ``end`` is None while it lasts, ``confirmed`` when it was last seen there.
    relation, place
        How the thing was related to a support, container or hand, and its IRI; a mere pose is
        ``at`` the empty IRI.
    frame, frame_from_subject
        IRI of the frame in which the pose was measured, and the pose (4, 4), m; empty and None if
        no pose is known.
    sigma_m
        Standard deviation of the position per axis, when it was measured.
    confidence
        That the thing was there when the interval began, 0..1.
    agent, source
        IRIs of who said so, and of the observation or attempt from which it follows; or empty.
    """

    iri: str
    subject: str
    begin: float
    end: float | None = None
    confirmed: float = 0.0
    relation: Relation = "at"
    place: str = ""
    frame: str = ""
    frame_from_subject: NDArray[np.float64] | None = None
    sigma_m: float = DEFAULT_SIGMA_M
    confidence: float = 1.0
    agent: str = ""
    source: str = ""

    @property
    def is_current(self) -> bool:
        """Whether it has no end."""
        return self.end is None

    def follows(self, before: Placement) -> bool:
        """Whether a thing only moved on or in the place where it was before, or was seen there."""
        is_same = (self.relation, self.place) == (before.relation, before.place)
        return self.relation != "at" and is_same and before.end == self.begin

    def holds_at(self, time_s: float) -> bool:
        """Whether the interval contains a time."""
        return self.begin <= time_s and (self.end is None or time_s < self.end)


def read_placement(kb: GraphCore, node: str, parts: set[str] | None = None) -> Placement | None:
    """Return a stored placement, or None if its subject or its begin is missing.

    Parameters
    ----------
    parts
        Takes the IRIs of the instants and the pose that it consists of.
    """
    parts = set() if parts is None else parts
    subject, begin, end, confirmed = "", None, None, []
    relation: Relation = "at"
    values: dict[str, str] = {}
    pose: NamedNode | None = None
    sigma, confidence = DEFAULT_SIGMA_M, 1.0
    for quad in kb.match(iri(node)):
        value = quad.object
        if not isinstance(value, NamedNode):
            if quad.predicate == _CONFIRMED_AT:
                confirmed.append(seconds(python_value(value)))
            elif quad.predicate == _SIGMA:
                sigma = float(str(python_value(value)))
            elif quad.predicate == _CONFIDENCE:
                confidence = float(str(python_value(value)))
        elif quad.predicate == _OF:
            subject = value.value
        elif quad.predicate == _BEGINNING:
            parts.add(value.value)
            begin = _instant(kb, value)
        elif quad.predicate == _END:
            # Two robots may each have said when it ended: the earlier one was there first.
            parts.add(value.value)
            moment = _instant(kb, value)
            end = moment if end is None or (moment is not None and moment < end) else end
        elif quad.predicate in RELATIONS:
            relation, values["place"] = RELATIONS[quad.predicate], value.value
        elif quad.predicate == _POSE:
            pose = value
            parts.add(value.value)
        elif quad.predicate == _AUTHOR:
            values["agent"] = value.value
        elif quad.predicate == _SOURCE:
            values["source"] = value.value
    if not subject or begin is None:
        return None
    frame, matrix = ("", None) if pose is None else pose_of(kb, pose)
    latest = max([begin, *confirmed])
    return Placement(
        node, subject, begin, end, latest if end is None else min(latest, end), relation,
        values.get("place", ""), frame, matrix, sigma, confidence, values.get("agent", ""),
        values.get("source", ""),
    )  # fmt: skip


def pose_of(kb: GraphCore, pose: NamedNode) -> tuple[str, NDArray[np.float64] | None]:
    """Return the frame of a stored pose and the pose (4, 4), m, or ("", None) if incomplete."""
    stored = {quad.predicate: quad.object for quad in kb.match(pose)}
    frame = stored.get(_IN_FRAME)
    if not isinstance(frame, NamedNode) or not {*_POSITION, *_QUATERNION} <= stored.keys():
        return "", None
    position, quaternion = (
        np.array([float(str(python_value(stored[name]))) for name in names])
        for names in (_POSITION, _QUATERNION)
    )
    return frame.value, np.asarray(matrix_from_pose(position, quaternion), np.float64)


def seconds(value: object) -> float:
    """Return the Unix time, s, of a stored time."""
    time = value if isinstance(value, dt.datetime) else dt.datetime.fromisoformat(str(value))
    return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()


def _instant(kb: GraphCore, node: NamedNode) -> float | None:
    for quad in kb.match(node, _STAMP):
        return seconds(python_value(quad.object))
    return None
