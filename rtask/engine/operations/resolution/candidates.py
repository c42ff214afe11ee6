"""Objects that fit a request, visible or not, found by one query."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.capability import Bounds, Verdict, can_hold
from rtask.engine.memory.meaning import Meaning, Sense, SenseKind
from rtask.engine.records.objects import no_object
from rtask.rdf.namespaces import PREFIXES, RDF, RT, values
from rtask.rdf.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.sparql.results import Row

from rtask.engine.operations.resolution.messages import OfferedObject, ResolveRequest

__all__ = ["PROPERTIES", "ObjectCandidate", "find_candidates"]

PROPERTIES: Mapping[SenseKind, NamedNode] = {
    "class": RDF.type, "function": RT.hasFunction, "colour": RT.hasColour, "trait": RT.hasTrait,
}  # fmt: skip
"""By which property of an object each kind of condition holds."""

MAX_CANDIDATES = 300
_EVER_S = 1e10
"""More seconds than any graph is old, and few enough for a time before now."""


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


def find_candidates(
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
    # A robot that names an object which is not there has a wrong picture: it is told, not answered
    # with the others.
    for name in given or ():
        if iri(name).value not in seen_names:
            raise no_object(context, name, "objects")
    # The newest come first: a cut among objects seen long ago leaves out none that is in view.
    is_cut = given is None and len(seen_names) >= MAX_CANDIDATES
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
GROUP BY ?object ORDER BY DESC(?is_named) DESC(?last) ?object LIMIT {MAX_CANDIDATES}"""


def _fitting(senses: Sequence[Sense]) -> str:
    """Return the pattern of objects that fit all senses."""
    parts = []
    for k, sense in enumerate(senses):
        if sense.kind == "print":
            parts.append(f"VALUES ?object {{ {values(sense.terms)} }}")
            continue
        path = PROPERTIES[sense.kind]
        parts.append(f"VALUES ?term{k} {{ {values(sense.terms)} }} ?object {path} ?term{k} .")
    without_exemplar = "FILTER NOT EXISTS { ?object a rt:Exemplar }"
    return f"{' '.join(parts)} ?object a rt:ManipulableObject {without_exemplar}"


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
