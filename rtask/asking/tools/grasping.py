"""Tools about things to be grasped: where they are, how they were held, which one will do."""

from __future__ import annotations

from typing import Annotated, Any

from annotated_types import Ge, Le
from pydantic import Field

from rtask.asking.tools.declaration import Asked, Paged, PagedAnswer, rest, tool
from rtask.asking.tools.evidence import outcomes_page, statements_page
from rtask.asking.tools.places import MAX_PLACES, Place, places_of
from rtask.asking.tools.values import Value
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import RDF_TYPE, NamedNode, iri
from rtask.wire.message import Answer
from rtask.wire.types import Number, Text, Texts

__all__ = ["find_object", "recall_grasps", "where_is"]

PAGE, MAX_GRASPS = 50, 10_000
_ENGINE = ["the engine, quoting the graph"]


class WhereIs(Paged):
    """A thing whose place is asked for."""

    object: Text
    """IRI or name"""


class Spot(Answer):
    """One place; x, y, z in m in the frame; no time is known where it is empty."""

    thing: str
    """what was asked for, or one of the things of that product"""
    relation: str
    place: Value
    frame_id: Value | None
    position: list[float] | None
    time: str
    confidence: float | None
    by: str
    proof: str
    why: str
    """page of the estimate that has the confidence"""


class Places(PagedAnswer):
    """Where something is, the latest first; stated is false if nobody says."""

    object: str
    stated: bool
    places: list[Spot]


class RecallGrasps(Paged):
    """An object whose known grasps are asked for."""

    object: Text
    gripper: Text | None = None
    """only of its type"""


class GraspEntry(Answer):
    """A grasp in the frame of its object: m, rad; expected is the chance that it holds."""

    id: str
    kind: str
    gripper_type: str
    position: list[float]
    orientation: list[float]
    width: float | None
    attempts: int
    successes: int
    expected: float
    proof: str
    why: str
    """page of the outcomes behind it"""


class GraspEntries(PagedAnswer):
    """Known grasps of an object, most reliable first."""

    object: str
    label: Value
    grasps: list[GraspEntry]


class FindObject(Paged):
    """A wish."""

    wish: Text
    """its kind or use"""
    gripper: Text | None = None
    """default: the only one of the calling robot"""
    objects: Texts | None = None
    """IRIs in view; default: seen within the time"""
    seen_within_s: Annotated[Number, Ge(0), Le(1e9)] = 600.0


class Offer(Answer):
    """An object that fits, or why one does not."""

    object: str
    label: Value
    fits: bool
    reason: str
    """proven, likely, or the code of what is in the way"""
    chance: float | None
    proof: str
    why: str
    """page of the outcomes behind the chance"""


class Offers(PagedAnswer):
    """Objects that serve a wish, the best first, or why there is none."""

    met: bool
    offers: list[Offer] = Field(default_factory=list)
    understood: list[str]
    objects_untried: int
    """seen and not looked at: not met is then not decided"""


@tool(
    "Say where a thing is: present places with frame, time, author and confidence.",
    {"object": "kb:object/7"},
    {"object": "red mug"},
    entries=("places",),
)
def where_is(asked: Asked, request: WhereIs) -> Places:
    """Return the present places of a thing; no place is no proof that it is nowhere."""
    subject = asked.resource(request.object)
    commit = asked.kb.seq
    places, is_cut = places_of(asked.kb, subject, request.offset + MAX_PLACES)
    spots = [_spot(asked, place) for place in places[request.offset :]]
    name = asked.terms.short(subject)
    more = rest(len(places), int(is_cut))
    return Places(commit=commit, object=name, stated=bool(places), places=spots, **more)


def _spot(asked: Asked, place: Place) -> Spot:
    terms, subject = asked.terms, place.thing
    author = terms.author(place.graph)
    predicate = {"at": RT.currentPose, "on": RT.locatedOn}.get(place.relation)
    shown = asked.kb.match(subject, predicate) if predicate is not None else []
    proof = terms.proof((subject, shown[0].predicate, shown[0].object)) if shown else ""
    return Spot(
        thing=terms.short(subject),
        relation=place.relation,
        place=terms.value(place.place, [author]),
        frame_id=None if place.frame_id is None else terms.value(place.frame_id),
        position=None if place.position is None else list(place.position),
        time=place.time,
        confidence=place.confidence,
        by=author,
        proof=proof,
        why="" if place.estimate is None else statements_page(asked, place.estimate),
    )


@tool(
    "List an object's known grasps and how often each held, most reliable first.",
    {"object": "kb:object/7"},
    {"object": "red mug", "gripper": "panda_hand"},
    entries=("grasps",),
    operation="recall_grasps",
)
def recall_grasps(asked: Asked, request: RecallGrasps) -> GraspEntries:
    """Return what the engine recalls, with the facts that decide between grasps."""
    commit = asked.kb.seq
    subject = asked.resource(request.object)
    if request.offset >= MAX_GRASPS:
        raise UsageError(
            f"offset: the {MAX_GRASPS} most reliable grasps are listed; name a gripper, or ask for "
            f"all by ask_sparql: SELECT ?grasp {{ {subject} rt:hasGrasp ?grasp }}"
        )
    most = min(request.offset + PAGE, MAX_GRASPS)
    args: dict[str, Any] = {"object": subject.value, "max_grasps": most}
    if request.gripper is not None:
        args["gripper_id"] = request.gripper
    answer = asked.operate("recall_grasps", **args)
    grasps = [_grasp(asked, subject, grasp) for grasp in answer.grasps[request.offset :]]
    return GraspEntries(
        commit=commit,
        object=asked.terms.short(iri(answer.object)),
        label=asked.terms.text(answer.label, _ENGINE),
        grasps=grasps,
        **rest(most, answer.grasps_left_out),
    )


def _grasp(asked: Asked, subject: NamedNode, grasp: Any) -> GraspEntry:
    pose = grasp.grasp_pose["pose"]
    position, orientation = pose["position"], pose["orientation"]
    name = iri(grasp.id)
    return GraspEntry(
        id=asked.terms.short(name),
        kind=grasp.kind,
        gripper_type=grasp.gripper_type,
        position=[round(position[axis], 4) for axis in "xyz"],
        orientation=[round(orientation[axis], 4) for axis in "xyzw"],
        width=grasp.width,
        attempts=grasp.statistics["attempts"],
        successes=grasp.statistics["successes"],
        expected=round(grasp.confidence.mean, 3),
        proof=asked.terms.proof((subject, RT.hasGrasp, name)),
        why=outcomes_page(asked, grasp=name),
    )


@tool(
    "Find an object in view by kind or use that a hand can hold, or say why there is none.",
    {"wish": "something to drink from", "gripper": "panda_hand"},
    {"wish": "a carton", "seen_within_s": 3600},
    entries=("offers",),
    operation="resolve_request",
)
def find_object(asked: Asked, request: FindObject) -> Offers:
    """Return the objects that fit a wish, then what is in the way of others."""
    commit = asked.kb.seq
    args: dict[str, Any] = {"wanted": request.wish, "seen_within_s": request.seen_within_s}
    args |= {"max_grasps": 1, "prove": False}
    if request.gripper is not None:
        args["gripper_id"] = request.gripper
    if request.objects is not None:
        args["objects"] = [asked.resource(name).value for name in request.objects]
    answer = asked.operate("resolve_request", **args)
    offers = [_offer(asked, it, it.capability, True, it.chance) for it in answer.objects]
    offers += [_offer(asked, it, it.code, False, None) for it in answer.reasons]
    understood = [*answer.understood["classes"], *answer.understood["functions"]]
    return Offers(
        commit=commit,
        met=answer.task_response == "object",
        offers=offers[request.offset :],
        understood=[asked.terms.short(iri(name)) for name in understood],
        objects_untried=answer.objects_untried,
    )


def _offer(asked: Asked, candidate: Any, reason: str, fits: bool, chance: float | None) -> Offer:
    proof, short, why = "", "", ""
    if candidate.object:
        subject = iri(candidate.object)
        kind = getattr(candidate, "class_iri", "")
        proof = asked.terms.proof((subject, RDF_TYPE, iri(kind))) if kind else ""
        short = asked.terms.short(subject)
        why = "" if chance is None else outcomes_page(asked, object=subject)
    return Offer(
        object=short,
        label=asked.terms.text(candidate.label, _ENGINE),
        fits=fits,
        reason=reason,
        chance=chance,
        proof=proof,
        why=why,
    )
