"""The request for an object of some kind or use, and its answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le, MaxLen
from pydantic import Field

from rtask.engine.operations.grasps import RecalledGrasp
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Json, Number, Text, Texts, Unit, Whole

if TYPE_CHECKING:
    pass

__all__ = ["OfferedObject", "Reason", "ResolveRequest", "ResolvedRequest"]

_MAX_SEEN = 100


class ResolveRequest(Message):
    """A request for an object of some kind or use among those seen."""

    wanted: Text
    """words, or the IRI of a class or function"""
    gripper_id: Text | None = None
    """name or IRI of the end effector to hold it; default: the robot's only one"""
    objects: Annotated[Texts, MaxLen(_MAX_SEEN)] | None = None
    """IRIs of the objects seen now, perhaps none; default: those seen within seen_within_s"""
    seen_within_s: Annotated[Number, Unit("s"), Ge(0)] = 600.0
    """without objects: maximum age of an observation"""
    exclude: Annotated[Texts, MaxLen(1000)] = Field(default_factory=list)
    """IRIs of objects not to offer again"""
    max_grasps: Annotated[Whole, Ge(1), Le(50)] = 10
    """maximum number of grasps"""
    prove: Flag = True
    """include the reasoner's proofs"""


class OfferedObject(Answer):
    """A visible object that fits a request; lengths in m, masses in kg."""

    object: str
    class_iri: str
    label: str
    capability: str
    text: str
    width: float | None
    mass: float | None
    mass_bound: float | None
    chance: float | None
    seen: str
    thing: str
    """IRI of the single thing that this robot saw last; empty if its place is not known"""


class Reason(Answer):
    """Reason why a request is not met, or not by this object."""

    code: str
    text: str
    object: str
    label: str
    value: float | None
    limit: float | None
    seen: str
    seen_by: str
    place: Json | None


class ResolvedRequest(Answer):
    """An object that fits a request, with its grasps, or the reasons why there is none."""

    task_response: str
    object: str
    thing: str
    """IRI of the single thing to take; empty if its place is not known"""
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]
    grasps_left_out: int
    """how many more of the object are known; max_grasps asks for them"""
    objects: list[OfferedObject]
    reasons: list[Reason]
    understood: Json
    explanation: Json
    suggestions: list[str]
    objects_untried: int
    """further objects of the kind seen within seen_within_s, beyond the most that one answer looks
    at: an unmet request is then not decided"""
