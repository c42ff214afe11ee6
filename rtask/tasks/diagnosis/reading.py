"""Reads from the graph what failed, and what is known around it."""

from __future__ import annotations

import datetime as dt
import json
from dataclasses import replace
from typing import Any

from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import NamedNode, literal
from rtask.sparql.results import Row
from rtask.tasks.actions import Select
from rtask.tasks.diagnosis.assignment import read_assignment
from rtask.tasks.diagnosis.attempt import Failure, Hand, Try
from rtask.tasks.names import names_of

__all__ = ["read_failure", "read_hands"]

_NOTHING = "<urn:rtask:nothing>"
_MAX_OTHERS = 400
_SUBJECT = """
# The latest attempt that is meant, failed ones first, and the planned step that it carried out.
SELECT ?attempt ?step ?ok ?ended WHERE {
  { BIND(%(s)s AS ?attempt) ?attempt rt:hasOutcome ?any
    OPTIONAL { ?step rt:carriedOutBy ?attempt } }
  UNION { %(s)s rt:hasSubTask* ?step . ?step rt:carriedOutBy|rt:through ?attempt }
  UNION { ?task rt:handles %(s)s ; rt:through ?attempt }
  UNION { ?attempt rt:handlesExemplar %(s)s }
  ?attempt rt:hasOutcome ?outcome . ?outcome rt:success ?said
  OPTIONAL { ?outcome rt:judgedSuccess ?judged } BIND(COALESCE(?judged, ?said) AS ?ok)
  OPTIONAL { ?attempt prov:endedAtTime ?ended }
} ORDER BY ?ok DESC(?ended) DESC(?attempt) LIMIT 1"""
_STEP = """
# The planned step that is meant and ended last, failed ones first. One that is still carried out,
# or was given back, has not failed.
SELECT ?step ?text ?values ?result ?comment ?begun ?ended ?robot ?deadline ?action WHERE {
  %(s)s rt:hasSubTask* ?step . ?step rt:parameterValues ?values .
  ?claim rt:claims ?step ; prov:startedAtTime ?begun ; prov:wasAssociatedWith ?robot .
  OPTIONAL { ?step rdfs:label ?text }
  ?claim rt:claimResult ?result FILTER(?result IN ("done", "failed", "declined"))
  OPTIONAL { ?claim rt:claimComment ?comment }
  OPTIONAL { ?claim prov:endedAtTime ?ended }
  OPTIONAL { ?plan rt:hasSubTask ?step ; rt:taskDeadline ?deadline }
} ORDER BY DESC(?result IN ("failed", "declined")) DESC(?begun) LIMIT 1"""
_HAND = """rt:gripperType ?kind } OPTIONAL { ?hand rt:maxOpening ?opening }
  OPTIONAL { ?hand rt:maxPayload ?payload } OPTIONAL { ?hand rt:maxForce ?force }
  OPTIONAL { ?hand rt:jawWidth ?finger } OPTIONAL { ?robot rt:name ?name"""
_ATTEMPT = (
    """
SELECT DISTINCT * WHERE {
  %s rt:hasOutcome ?outcome ; rt:activates ?hand ; rt:performedBy ?robot .
  BIND(%s AS ?attempt) ?outcome rt:success ?said .
  OPTIONAL { ?outcome rt:judgedSuccess ?judged } OPTIONAL { ?outcome rt:hasReason/rt:code ?code }
  OPTIONAL { ?outcome rt:hasFeedback/rt:saidReason/rt:code ?saidCode }
  OPTIONAL { ?attempt rt:executesGrasp ?grasp
    OPTIONAL { ?grasp rt:graspPose [ rt:x ?along ; rt:theta ?turn ] } }
  OPTIONAL { ?through rt:through ?attempt ; rt:handles ?product }
  OPTIONAL { ?attempt rt:handlesExemplar ?thing }
  OPTIONAL { ?attempt prov:startedAtTime ?started } OPTIONAL { ?attempt prov:endedAtTime ?ended }
  OPTIONAL { ?attempt rt:usedRecognition ?seen . ?seen rt:bestMatch/rt:matchScore ?best
    OPTIONAL { ?seen rt:hasMatch/rt:matchScore ?next FILTER(?next < ?best) } }
  OPTIONAL { ?hand """
    + _HAND
    + """ }
} ORDER BY DESC(?next) LIMIT 1"""
)
_OTHERS = (
    """
SELECT DISTINCT ?attempt ?ok ?product ?hand ?robot ?name ?kind ?opening ?payload ?force ?finger
  ?grasp ?along ?ended WHERE {
  { ?task rt:handles %s ; rt:through ?attempt } UNION { ?attempt rt:activates %s }
  ?attempt rt:hasOutcome ?outcome ; rt:activates ?hand ; rt:performedBy ?robot .
  ?outcome rt:judgedSuccess ?ok .
  ?through rt:through ?attempt ; rt:handles ?product
  OPTIONAL { ?attempt rt:executesGrasp ?grasp
    OPTIONAL { ?grasp rt:graspPose [ rt:x ?along ; rt:theta ?turn ] } }
  OPTIONAL { ?attempt prov:endedAtTime ?ended }
  OPTIONAL { ?hand """
    + _HAND
    + """ }
} ORDER BY DESC(?attempt) LIMIT %d"""
)
_PRODUCT = """
SELECT (MAX(?x) AS ?length) (MAX(?w) AS ?width) (MAX(?m) AS ?mass) WHERE {
  OPTIONAL { %(s)s rt:extentX ?x } OPTIONAL { %(s)s rt:graspWidth ?w }
  OPTIONAL { %(s)s rt:mass ?m } }"""
_GRASPS = """
SELECT DISTINCT ?grasp ?kind ?along WHERE {
  %s rt:hasGrasp ?grasp . ?grasp rt:gripperType ?kind ;
    rt:graspPose [ rt:x ?along ; rt:theta ?turn ] } ORDER BY ?grasp LIMIT 200"""
_PLACEMENTS = """
SELECT ?at ?hand ?begin ?end WHERE {
  ?placement rt:placementOf %s ; time:hasBeginning/time:inXSDDateTimeStamp ?begin
  OPTIONAL { ?placement time:hasEnd/time:inXSDDateTimeStamp ?end }
  OPTIONAL { ?placement rt:placedOn|rt:placedIn ?at } OPTIONAL { ?placement rt:heldBy ?hand }
} ORDER BY ?begin"""
_NEIGHBOURS = """
SELECT DISTINCT ?thing WHERE { ?thing rt:locatedOn %s FILTER(?thing != %s) } LIMIT 20"""
_HANDS = (
    """
SELECT DISTINCT ?hand ?robot ?name ?kind ?opening ?payload ?force ?finger WHERE {
  ?robot rt:hasEndEffector ?hand . %s
  OPTIONAL { ?hand """
    + _HAND
    + """ }
} ORDER BY ?hand LIMIT 50"""
)


def read_failure(select: Select, subject: str) -> Failure:
    """Return what failed: an attempt, a task, a planned step, a stored plan, or at an object.

    A planned step that has not ended is returned as such, with why it is its robot's.

    Parameters
    ----------
    subject
        Its IRI; of an object also its name. Of an object the latest attempt that failed is meant.

    Raises
    ------
    UnknownTermError
        Nothing of this name was attempted or ended.
    UsageError
        Several objects have this name.
    """
    subject = _iri_of(select, subject)
    node = str(NamedNode(subject))
    latest = next(iter(select(PREFIXES + _SUBJECT % {"s": node})), None)
    step = next(iter(select(PREFIXES + _STEP % {"s": node})), None)
    attempt = "" if latest is None else str(latest.value("attempt"))
    if step is not None and _is_of_other_step(latest, step):
        attempt = ""  # a step that failed without an attempt, after one that held
    assignment = read_assignment(select, subject)
    if not attempt and step is None and assignment is not None:
        return Failure(
            subject, "", subject, assignment.step, Try(Hand("", "")), has_ended=False,
            assignment=assignment.reason,
        )  # fmt: skip
    if not attempt and step is None:
        raise UnknownTermError(
            f"{subject}: the graph has no attempt, and no step that ended, under this name",
            field="subject",
        )
    tried, more = _of_attempt(select, attempt) if attempt else (Try(Hand("", "")), {})
    if step is not None:
        tried, more = _with_step(select, tried, more, step)
    failure = _around(select, subject, attempt, tried, more)
    if assignment is None or assignment.is_planned:
        return failure
    return replace(failure, assignment=assignment.reason)


def _iri_of(select: Select, subject: str) -> str:
    """Return the IRI that is given, or that of the object with this name."""
    try:
        return NamedNode(subject).value
    except ValueError:
        pass
    query = f"?s a rt:ManipulableObject ; rt:name {literal(subject)}"
    rows = select(f"{PREFIXES}SELECT DISTINCT ?s WHERE {{ {query} }} ORDER BY ?s LIMIT 20")
    objects = [str(row.value("s")) for row in rows]
    if not objects:
        raise UnknownTermError(
            f"{subject!r} is no IRI, and no object in the graph has this name; `rtask tasks` lists "
            "plans, `rtask objects list` objects",
            field="subject",
        )
    if len(objects) > 1:
        raise UsageError(
            f"{len(objects)} objects are called {subject!r}; give the IRI: {', '.join(objects)}",
            field="subject",
        )
    return objects[0]


def _is_of_other_step(latest: Row | None, step: Row) -> bool:
    """Whether the attempt that was found is not what made the step end as it did."""
    if latest is None or step.value("result") not in ("failed", "declined"):
        return False
    return bool(latest.value("ok")) or (
        latest.value("step") is not None and latest.value("step") != step.value("step")
    )


def _of_attempt(select: Select, attempt: str) -> tuple[Try, dict[str, Any]]:
    node = str(NamedNode(attempt))
    row = next(iter(select(PREFIXES + _ATTEMPT % (node, node))), None)
    if row is None:
        return Try(Hand("", "")), {}
    judged = row.value("judged")
    held = bool(row.value("said") if judged is None else judged)
    code = str(row.value("saidCode") or row.value("code") or "")
    best, following = _number(row, "best"), _number(row, "next")
    tried = Try(
        _hand(row), _text(row, "product"), _text(row, "thing"), _text(row, "grasp"),
        along=_number(row, "along"), held=held, reason=code,
    )  # fmt: skip
    begun = row.value("started") or row.value("ended")
    margin = None if best is None or following is None else best - following
    return tried, {"begun": begun, "held": held, "margin": margin}


def _with_step(
    select: Select, tried: Try, more: dict[str, Any], step: Row
) -> tuple[Try, dict[str, Any]]:
    """Add what the step of a plan says about an attempt, or of what failed without one."""
    arguments = _arguments(step)
    thing = tried.thing or arguments.get("thing", "")
    hand = tried.hand
    if not hand.iri and arguments.get("hand"):
        rows = select(PREFIXES + _HANDS % f"FILTER(?hand = {NamedNode(arguments['hand'])})")
        hand = next((_hand(row) for row in rows), hand)
    product = tried.product
    if not product and thing:
        rows = select(
            f"{PREFIXES}SELECT ?p WHERE {{ {NamedNode(thing)} rt:exemplarOf ?p }} LIMIT 1"
        )
        product = next((str(row.value("p")) for row in rows), "")
    result, comment = _text(step, "result"), _text(step, "comment")
    code = tried.reason or _code_of(result, comment)
    deadline, ended = _time(step.value("deadline")), _time(step.value("ended"))
    is_late = None if deadline is None or ended is None else ended > deadline
    changed = Try(
        hand, product, thing, tried.grasp, arguments.get("place", ""), tried.along,
        tried.held and result != "failed", code,
    )  # fmt: skip
    held = result == "done" or (more.get("held", False) and result not in ("failed", "declined"))
    return changed, more | {
        "held": held, "text": _text(step, "text"), "step": _text(step, "step"),
        "begun": step.value("begun"), "is_late": is_late,
    }  # fmt: skip


def _code_of(result: str, comment: str) -> str:
    """Return the code of why a step ended without an attempt, as robots comment it."""
    if result == "declined":
        return "declined"
    if "not seen" in comment or "nobody knows" in comment:
        return "not_seen"
    word = comment.split(":")[0].strip()
    return word if word.replace("_", "").isalpha() else ""


def _around(
    select: Select, subject: str, attempt: str, tried: Try, more: dict[str, Any]
) -> Failure:
    length = width = mass = None
    begun = _time(more.get("begun"))
    others: tuple[Try, ...] = ()
    is_cut = False
    grasps: tuple[tuple[str, str, float], ...] = ()
    if tried.product:
        product = str(NamedNode(tried.product))
        for row in select(PREFIXES + _PRODUCT % {"s": product}):
            length, width, mass = (_number(row, name) for name in ("length", "width", "mass"))
        grasps = tuple(
            (_text(row, "grasp"), _text(row, "kind"), _number(row, "along") or 0.0)
            for row in select(PREFIXES + _GRASPS % product)
        )
        others, is_cut = _others(select, product, attempt, tried, begun)
    age_s, is_elsewhere, place, origin, seen_at = _placements(select, tried, begun)
    place = tried.place or place
    tried = Try(
        tried.hand, tried.product, tried.thing, tried.grasp, place, tried.along, tried.held,
        tried.reason,
    )  # fmt: skip
    near = _neighbours(select, tried)
    names = names_of(select, [iri for iri in (tried.product, tried.thing, *near) if iri])
    what = names.get(tried.thing) or names.get(tried.product) or local_name(subject)
    text = more.get("text") or f"{tried.hand.name or 'a robot'} grasps {what}"
    return Failure(
        subject, attempt, more.get("step", ""), text, tried, bool(more.get("held")), length,
        width, mass, age_s, is_elsewhere, more.get("margin"), tuple(names[iri] for iri in near),
        more.get("is_late"), others, is_cut, _hands(select, tried), grasps, origin, seen_at,
    )  # fmt: skip


def _others(
    select: Select, product: str, attempt: str, tried: Try, begun: dt.datetime | None
) -> tuple[tuple[Try, ...], bool]:
    """Return the latest other attempts, and whether there are earlier ones."""
    hand = str(NamedNode(tried.hand.iri)) if tried.hand.iri else _NOTHING
    rows = list(select(PREFIXES + _OTHERS % (product, hand, _MAX_OTHERS + 1)))
    seen: dict[str, Try] = {}
    for row in rows[:_MAX_OTHERS]:
        iri = _text(row, "attempt")
        if iri != attempt and iri not in seen:
            ended = _time(row.value("ended"))
            seen[iri] = Try(
                _hand(row), _text(row, "product"), grasp=_text(row, "grasp"),
                along=_number(row, "along"), held=row.value("ok") is True, is_other=True,
                is_since=begun is not None and ended is not None and ended > begun,
            )  # fmt: skip
    return tuple(seen.values()), len(rows) > _MAX_OTHERS


def _placements(
    select: Select, tried: Try, begun: dt.datetime | None
) -> tuple[float | None, bool, str, str, str]:
    """Return how old the place was, whether the thing turned up elsewhere, and the place.

    With it come the place or hand where it was believed to be, and the place where it turned up.
    """
    if not tried.thing or begun is None:
        return None, False, tried.place, "", ""
    rows = list(select(PREFIXES + _PLACEMENTS % NamedNode(tried.thing)))
    placements = [
        (time, _text(row, "at"), _text(row, "hand"), _time(row.value("end")))
        for row in rows if (time := _time(row.value("begin")))
    ]  # fmt: skip
    before = [placement for placement in placements if placement[0] <= begun]
    after = [placement for placement in placements if placement[0] > begun]
    place = tried.place or (before[-1][1] if before else "")
    age_s = (begun - before[-1][0]).total_seconds() if before else None
    is_elsewhere = bool(after) and after[0][1] != place and not after[0][2]
    # A thing that is lost is nowhere since: its stay has ended, and no other has begun.
    is_elsewhere |= not after and any(end is not None and end > begun for *_, end in before[-1:])
    origin = (before[-1][1] or before[-1][2]) if before else ""
    seen_at = next((at for _, at, _, _ in after if at), "")
    return age_s, is_elsewhere, place, origin, seen_at


def _neighbours(select: Select, tried: Try) -> tuple[str, ...]:
    if not tried.place:
        return ()
    thing = str(NamedNode(tried.thing)) if tried.thing else _NOTHING
    rows = select(PREFIXES + _NEIGHBOURS % (NamedNode(tried.place), thing))
    return tuple(sorted(_text(row, "thing") for row in rows))


def _hands(select: Select, tried: Try) -> tuple[Hand, ...]:
    """Return the hands that can grasp the thing and reach its place, as far as is known."""
    able = ""
    what = tried.thing or tried.product
    if what:
        able += f"?robot rt:canGrasp {NamedNode(what)} . "
    if tried.place:
        able += f"?robot rt:reaches {NamedNode(tried.place)} . "
    rows = select(PREFIXES + _HANDS % able)
    return tuple({hand.iri: hand for hand in map(_hand, rows)}.values())


def read_hands(select: Select) -> dict[str, Hand]:
    """Return the hands of all robots, by their IRIs; at most fifty."""
    return {hand.iri: hand for hand in map(_hand, select(PREFIXES + _HANDS % ""))}


def _hand(row: Row) -> Hand:
    return Hand(
        _text(row, "hand"), _text(row, "robot"), _text(row, "name") or local_name(
            _text(row, "robot")), _text(row, "kind"), _number(row, "opening"),
        _number(row, "payload"), _number(row, "force"), _number(row, "finger") or 0.0,
    )  # fmt: skip


def _arguments(step: Row) -> dict[str, str]:
    try:
        values = json.loads(_text(step, "values"))
    except ValueError:
        return {}
    return {str(k): str(v) for k, v in values.items()} if isinstance(values, dict) else {}


def _text(row: Row, name: str) -> str:
    value = row.value(name)
    return "" if value is None else str(value)


def _number(row: Row, name: str) -> float | None:
    text = _text(row, name)
    return float(text) if text else None


def _time(value: object) -> dt.datetime | None:
    if value is None or value == "":
        return None
    time = value if isinstance(value, dt.datetime) else dt.datetime.fromisoformat(str(value))
    return time if time.tzinfo else time.replace(tzinfo=dt.UTC)
