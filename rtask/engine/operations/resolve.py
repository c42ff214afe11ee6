"""Resolution of a request for a kind or use of object to one visible object (Gatto 2016, 5).

The words are mapped to classes and functions. The reasoner's closure gives the objects that fit,
the gripper's limits those that it can hold, the robot's observations those that are visible. One
query finds the objects, another recalls their grasps. Reasons for failure come in this order: no
such kind, none visible, visible but impossible to hold, known and last seen elsewhere.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le, MaxLen
from pydantic import Field

from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.capability import Bounds, Verdict, can_hold
from rtask.engine.memory.confidence import posterior
from rtask.engine.memory.meaning import Meaning, Sense, meaning
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.operations.grasps import RecalledGrasp, recalled
from rtask.engine.operations.operation import operation
from rtask.engine.records.objects import no_object
from rtask.engine.remembered import Memory, Remembered, RememberedObject
from rtask.rdf.namespaces import PREFIXES, RDF, RT, local_name, values
from rtask.rdf.terms import NamedNode, Value, iri, literal
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Json, Number, Text, Texts, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["OfferedObject", "Reason", "ResolveRequest", "ResolvedRequest", "resolve_request"]

_MAX_CANDIDATES = 300
_MAX_ELSEWHERE = 3
_MAX_SEEN = 100
_EVER_S = 1e10
"""More seconds than any graph is old, and few enough for a time before now."""


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
    objects: list[OfferedObject]
    reasons: list[Reason]
    understood: Json
    explanation: Json
    suggestions: list[str]
    objects_untried: int
    """further objects of the kind seen within seen_within_s, beyond the most that one answer looks
    at: an unmet request is then not decided"""


@dataclass(frozen=True)
class ObjectCandidate:
    """An object that fits the request, visible or not.

    Parameters
    ----------
    is_seen
        The robot says so, or it was observed recently.
    seen, seen_by
        Time of the last observation (ISO 8601) and its author; empty if there is none.
    place
        ``x``, ``y``, ``z`` (m), ``frame_id`` of its latest pose, or None; in a frame of this robot
        or of none if there is one.
    thing
        IRI of the single thing that is there; empty if it is in a frame of another robot.
    chance
        Probability that its most reliable known grasp holds, 0..1; None without a grasp of this
        gripper type.
    """

    iri: str
    verdict: Verdict
    bounds: Bounds
    is_seen: bool
    seen: str = ""
    seen_by: str = ""
    place: dict[str, Any] | None = None
    thing: str = ""
    can_grasp: bool = False
    label: str = ""
    class_iri: str = ""
    chance: float | None = None

    def message(self) -> OfferedObject:
        """Return the object as the answer carries it."""
        return OfferedObject(
            object=self.iri,
            class_iri=self.class_iri,
            label=self.label,
            capability=self.verdict.capability,
            text=f"{self.label} {self.verdict.text}",
            width=self.bounds.width,
            mass=self.bounds.mass,
            mass_bound=self.bounds.mass_bound,
            chance=self.chance,
            seen=self.seen,
            thing=self.thing,
        )


@operation("read", "reads", "choose a seen object that serves a request, and its grasps")
def resolve_request(context: Context, request: ResolveRequest, access: Access) -> ResolvedRequest:
    """Return a visible object that can be held, with its grasps, or the reasons for failure."""
    gripper = context.grippers.find(request.gripper_id, access)
    meant = meaning(context, request.wanted)
    candidates: list[ObjectCandidate] = []
    memory, untried = Memory(), 0
    if meant.senses:
        candidates, untried = _find_candidates(context, meant, gripper, request)
        is_jaws = gripper.gripper.contact_kind == "jaws"
        iris = tuple(sorted(candidate.iri for candidate in candidates))
        memory = recall(context.kb, Question(objects=iris, in_space=not is_jaws))
        candidates = sorted(
            (_with_memory(candidate, memory, gripper, context) for candidate in candidates),
            key=_order,
        )
    excluded = set(request.exclude)
    offered = [
        candidate
        for candidate in candidates
        if candidate.is_seen
        and candidate.verdict.capability != "no"
        and candidate.iri not in excluded
    ]
    best = offered[0] if offered else None
    remembered = (
        memory.objects.get(best.iri, RememberedObject(best.iri)) if best else RememberedObject("")
    )
    reasons = _reasons(context, request.wanted, meant, candidates, excluded)
    if untried:
        reasons.append(_undecided(context, meant, len(candidates), untried))
    return ResolvedRequest(
        task_response="object" if best else "unmet",
        object=best.iri if best else "",
        thing=best.thing if best else "",
        class_iri=remembered.class_iri,
        label=remembered.label,
        grasps=_grasps(context, memory, best, gripper, request.max_grasps),
        objects=[candidate.message() for candidate in offered],
        reasons=reasons,
        understood={
            "classes": meant.terms("class"),
            "functions": meant.terms("function"),
            "ignored": list(meant.ignored),
        },
        explanation={
            "text": _sentence(context, meant, best, reasons),
            "proof": _proof(context, meant, best, gripper) if best and request.prove else [],
        },
        suggestions=list(meant.suggestions),
        objects_untried=untried,
    )


# Query


def _find_candidates(
    context: Context, meant: Meaning, gripper: StoredGripper, request: ResolveRequest
) -> tuple[list[ObjectCandidate], int]:
    """Return the objects that fit the words, and how many more may be in view.

    Those that the robot names come first, then those seen last, so that one query finds all that
    matter unless more than its limit were seen within the time.
    """
    given = request.objects
    now = dt.datetime.now(dt.UTC)
    fresh = now - dt.timedelta(seconds=min(request.seen_within_s, _EVER_S))
    seen_names: set[str] = set()
    candidates = []
    for row in context.kb.select(_query(meant.senses, gripper, given, context.kb.base)):
        name = str(row.value("object"))
        seen_names.add(name)
        if not row.value("fits"):
            continue
        last_seen, _, who = str(row.value("last") or "").partition(" ")
        is_seen = (
            name in given if given is not None else bool(last_seen) and _time(last_seen) >= fresh
        )
        bounds = Bounds(*(_number(row, column) for column in ("width", "mass", "bound")))
        verdict = can_hold(gripper.gripper, bounds)
        place, thing = _place(row)
        able = bool(row.value("able"))
        candidates.append(
            ObjectCandidate(
                name, verdict, bounds, is_seen, last_seen, who, place, thing, can_grasp=able
            )
        )
    for name in given or ():
        if iri(name).value not in seen_names:
            raise no_object(context, name, "objects")
    is_cut = given is None and len(seen_names) >= _MAX_CANDIDATES
    if not (is_cut and all(candidate.is_seen for candidate in candidates)):
        return candidates, 0
    count = context.kb.select(_count(meant.senses, fresh))[0].value("n")
    return candidates, max(int(str(count)) - len(candidates), 0)


def _count(senses: Sequence[Sense], fresh: dt.datetime) -> str:
    """Return the query for the number of objects that fit and were seen since a time."""
    return f"""{PREFIXES}
SELECT (COUNT(DISTINCT ?object) AS ?n) WHERE {{
  {_fitting(senses)}
  ?event sosa:hasFeatureOfInterest ?object ; sosa:resultTime ?time
  FILTER(?time >= {literal(fresh)})
}}"""


def _query(
    senses: Sequence[Sense], gripper: StoredGripper, given: Sequence[str] | None, base: str
) -> str:
    """Return the query for the objects that fit, and for those that the robot names."""
    named = f"VALUES ?object {{ {values(given or ())} }}"
    robots, own = (literal(text) for text in (f"{base}robot/", f"{gripper.robot.value}/"))
    return f"""{PREFIXES}
SELECT ?object (MAX(?fit) AS ?fits) (MAX(?named) AS ?is_named) (MAX(?can) AS ?able)
  (MIN(?w) AS ?width) (MAX(?m) AS ?mass)
  (MIN(?b) AS ?bound) (MAX(?look) AS ?last) (MAX(?at) AS ?pose)
WHERE {{
  {{
    SELECT ?object (MAX(?f) AS ?fit) (MIN(?f) AS ?only_fit) WHERE {{
      {{ {_fitting(senses)} BIND(true AS ?f) }}
      UNION
      {{ {named} ?object a rt:ManipulableObject BIND(false AS ?f) }}
    }}
    GROUP BY ?object
  }}
  BIND(!?only_fit AS ?named)
  BIND(EXISTS {{ {gripper.robot} rt:canGrasp ?object }} AS ?can)
  OPTIONAL {{ ?object rt:graspWidth|rt:effectiveGraspWidth ?w }}
  OPTIONAL {{ ?object rt:mass|rt:effectiveMass ?m }}
  OPTIONAL {{ ?object rt:massBound ?b }}
  OPTIONAL {{
    ?event sosa:hasFeatureOfInterest ?object ; sosa:resultTime ?time
    OPTIONAL {{ ?event prov:wasAssociatedWith/rt:name ?name }}
    BIND(CONCAT(STR(?time), " ", COALESCE(?name, "")) AS ?look)
  }}
  OPTIONAL {{
    {{ ?object rt:currentPose ?p . ?p rt:atTime ?since
       FILTER NOT EXISTS {{ ?estimate rt:estimatedPose ?p ; prov:invalidatedAtTime ?end }} }}
    UNION
    {{ ?thing rt:exemplarOf ?object ; rt:currentPlacement ?there .
       ?there rt:placementPose ?p ; time:hasBeginning/time:inXSDDateTimeStamp ?since }}
    ?p rt:inFrame ?in ; rt:x ?x ; rt:y ?y ; rt:z ?z . ?in rt:frameId ?frame
    BIND(STRSTARTS(STR(?in), {own}) || !STRSTARTS(STR(?in), {robots}) AS ?mine)
    BIND(CONCAT(IF(?mine, "1", "0"), STR(?since), " ", STR(?x), " ", STR(?y), " ", STR(?z), " ",
      COALESCE(STR(?thing), "-"), " ", ?frame) AS ?at)
  }}
}}
GROUP BY ?object ORDER BY DESC(?is_named) DESC(?last) ?object LIMIT {_MAX_CANDIDATES}"""


def _fitting(senses: Sequence[Sense]) -> str:
    """Return the pattern of objects that fit all senses."""
    parts = []
    for k, sense in enumerate(senses):
        path = "a" if sense.kind == "class" else "rt:hasFunction"
        parts.append(f"VALUES ?term{k} {{ {values(sense.terms)} }} ?object {path} ?term{k} .")
    no_thing = "FILTER NOT EXISTS { ?object a rt:Exemplar }"
    return f"{' '.join(parts)} ?object a rt:ManipulableObject {no_thing}"


def _number(row: Row, name: str) -> float | None:
    value: Any = row.value(name)
    return None if value is None else float(value)


def _time(text: str) -> dt.datetime:
    time = dt.datetime.fromisoformat(text)
    return time if time.tzinfo else time.replace(tzinfo=dt.UTC)


def _place(row: Row) -> tuple[dict[str, Any] | None, str]:
    """Return the latest place, and the thing that is there if this robot may find it there."""
    if row["pose"] is None:
        return None, ""
    since, x, y, z, thing, frame = str(row.value("pose")).split(" ", 5)
    is_mine = since.startswith("1") and thing != "-"
    place = {"x": float(x), "y": float(y), "z": float(z), "frame_id": frame}
    return place, thing if is_mine else ""


# Choice


def _with_memory(
    candidate: ObjectCandidate, memory: Memory, gripper: StoredGripper, context: Context
) -> ObjectCandidate:
    """Return an object with name, class and the probability of its most reliable grasp."""
    remembered = memory.objects.get(candidate.iri, RememberedObject(candidate.iri))
    chances = [
        _chance(context, g)
        for g in memory.of(candidate.iri)
        if g.gripper_type == gripper.gripper.gripper_type
    ]
    label = remembered.label or local_name(candidate.iri)
    chance = max(chances, default=None)
    return replace(candidate, label=label, class_iri=remembered.class_iri, chance=chance)


def _chance(context: Context, grasp: Remembered) -> float:
    counts = [(t.held, t.is_fast, t.count) for t in grasp.tallies]
    return round(posterior(context.policy, grasp.prior, counts).mean, 6)


def _order(candidate: ObjectCandidate) -> tuple[bool, bool, float, str]:
    """Return the sort key: visible first, proven first, then by the probability of a grasp."""
    chance = 0.5 if candidate.chance is None else candidate.chance
    return not candidate.is_seen, candidate.verdict.capability != "proven", -chance, candidate.iri


def _grasps(
    context: Context,
    memory: Memory,
    best: ObjectCandidate | None,
    gripper: StoredGripper,
    most: int,
) -> list[RecalledGrasp]:
    if best is None:
        return []
    kind = gripper.gripper.gripper_type
    mine = [g for g in memory.of(best.iri) if g.gripper_type == kind]
    return recalled(context, mine, most)


# Answer


def _reasons(
    context: Context,
    wanted: str,
    meant: Meaning,
    candidates: list[ObjectCandidate],
    excluded: set[str],
) -> list[Reason]:
    """Return why the request is not met, or why other objects were not chosen."""
    if not meant.senses:
        near = f"; did you mean {meant.suggestions[0]!r}?" if meant.suggestions else ""
        return [_reason("no_such_kind", f"{wanted!r} names no kind and no use of things{near}")]
    reasons = []
    seen = [candidate for candidate in candidates if candidate.is_seen]
    if not seen:
        text = f"{_asked(context, meant)}: nothing of that is seen"
        reasons.append(_reason("not_seen", text))
    for candidate in seen:
        if candidate.iri in excluded:
            reasons.append(_reason("excluded", f"{candidate.label} was not wanted", candidate))
        elif candidate.verdict.capability == "no":
            reasons.append(
                _reason(
                    candidate.verdict.code, f"{candidate.label} {candidate.verdict.text}", candidate
                )
            )
    unseen = [candidate for candidate in candidates if not candidate.is_seen]
    latest = sorted(unseen, key=lambda candidate: candidate.seen, reverse=True)[:_MAX_ELSEWHERE]
    reasons += [
        _reason("elsewhere", f"{candidate.label} {_last_seen(candidate)}", candidate)
        for candidate in latest
    ]
    if not candidates:
        reasons.append(_reason("none_known", f"{_asked(context, meant)}: the graph knows none"))
    return reasons


def _undecided(context: Context, meant: Meaning, tried: int, untried: int) -> Reason:
    text = (
        f"{_asked(context, meant)}: of {tried + untried} seen, only the {tried} seen last were "
        "looked at; name those in view in objects, or give a shorter seen_within_s"
    )
    return _reason("not_decided", text)


def _last_seen(candidate: ObjectCandidate) -> str:
    if not candidate.seen:
        return "has never been looked at"
    by = f" by {candidate.seen_by}" if candidate.seen_by else ""
    clause = f"was seen at {candidate.seen[:19]}Z{by}"
    if candidate.place is None:
        return clause
    x, y, z, frame = (candidate.place[name] for name in ("x", "y", "z", "frame_id"))
    return f"{clause}, at ({x:.2f}, {y:.2f}, {z:.2f}) of {frame}"


def _reason(code: str, text: str, candidate: ObjectCandidate | None = None) -> Reason:
    return Reason(
        code=code,
        text=text,
        object=candidate.iri if candidate else "",
        label=candidate.label if candidate else "",
        value=candidate.verdict.value if candidate else None,
        limit=candidate.verdict.limit if candidate else None,
        seen=candidate.seen if candidate else "",
        seen_by=candidate.seen_by if candidate else "",
        place=candidate.place if candidate else None,
    )


def _asked(context: Context, meant: Meaning) -> str:
    """Return the request in the graph's words: ``a cup to drink from``."""
    kinds = [
        " or ".join(f"a {context.classes.get(term).label}" for term in sense.terms)
        for sense in meant.senses
        if sense.kind == "class"
    ]
    uses = [
        "to " + " or ".join(context.functions.all()[term][0] for term in sense.terms)
        for sense in meant.senses
        if sense.kind == "function"
    ]
    return " ".join([" and ".join(kinds) or "something", *uses])


def _sentence(
    context: Context, meant: Meaning, best: ObjectCandidate | None, reasons: Sequence[Reason]
) -> str:
    """Return the answer in words."""
    if best is None:
        return "; ".join(reason.text for reason in reasons)
    chance = "no grasp of it is known yet"
    if best.chance is not None:
        chance = f"its surest grasp holds with a chance of {best.chance:.2f}"
    sentence = f"{best.label} is {_asked(context, meant)}; it {best.verdict.text}; {chance}"
    over = f"; not understood: {', '.join(meant.ignored)}" if meant.ignored else ""
    return sentence + over


def _proof(
    context: Context, meant: Meaning, best: ObjectCandidate, gripper: StoredGripper
) -> list[str]:
    """Return the lines of a proof that the object fits and that the robot can hold it."""
    object_iri = iri(best.iri)
    lines = []
    for sense in meant.senses:
        predicate = RDF.type if sense.kind == "class" else RT.hasFunction
        held = [t for t in sense.terms if context.kb.match(object_iri, predicate, iri(t))]
        for term in held[:1]:
            lines += proof_lines(context.kb, object_iri, predicate, iri(term))
    if best.can_grasp:
        lines += proof_lines(context.kb, gripper.robot, RT.canGrasp, object_iri)
    return lines


def proof_lines(kb: GraphCore, subject: NamedNode, predicate: NamedNode, value: Value) -> list[str]:
    """Return the reasoner's proof of a statement, or the graphs in which it is asserted.

    Empty if the statement does not hold; if that was not decided, the line says so.
    """
    graphs = [quad.graph_name for quad in kb.match(subject, predicate, value)]
    asserted = [graph for graph in graphs if graph != kb.graphs.inferred]
    if asserted:
        where = ", ".join(sorted(str(graph) for graph in asserted))
        return [f"{subject} {predicate} {value} asserted in {where}"]
    if not kb.reasons:
        return []
    explanation = kb.explain(subject, predicate, value)
    return [] if explanation.holds is False else explanation.render().splitlines()
