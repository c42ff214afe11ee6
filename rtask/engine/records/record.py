"""Storage of one attempt, for insertion of objects and reports of outcomes."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rtask.engine.decisions import Decision
from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.calibration import Scored, calibrate
from rtask.engine.memory.causes import Causes, Tried, place_along
from rtask.engine.memory.confidence import believe, posterior
from rtask.engine.memory.statistics import Pending, count, judged_counts
from rtask.engine.policy import UNJUDGED
from rtask.engine.records.attempts import (
    CONTACT_CLASSES,
    Attempt,
    attempt_triples,
    find_grasp,
    quality_kind,
    state_grasp,
)
from rtask.engine.records.exemplars import exemplar_handled, move_exemplar
from rtask.engine.records.objects import state_frame, state_recognition
from rtask.engine.records.outcomes import Outcome
from rtask.engine.records.places import Handled, Located, place_before, state_moved
from rtask.engine.records.received import Received
from rtask.engine.records.task_tree import state_task_tree
from rtask.engine.terms import find_task
from rtask.engine.triples import Triples, rounded
from rtask.errors import ConflictError, UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES, RDF, RT
from rtask.rdf.terms import NamedNode, Value, iri, literal
from rtask.world import WorldEdit
from rtask.world.names import present

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = [
    "Earlier",
    "Entry",
    "Recorded",
    "Withdrawn",
    "earlier",
    "record",
    "resolve_grasp",
    "task_iri",
]

Withdrawn = list[tuple[NamedNode, NamedNode, Value]]


@dataclass(frozen=True)
class Earlier:
    """Result of an earlier request with the same id."""

    object_iri: str = ""
    grasp: str = ""
    view: str = ""
    has_attempt: bool = False
    held: bool | None = None
    """Whether the attempt was reported as a success; None if there was none."""

    def refuse_contradiction(self, task_id: str, held: bool) -> None:
        """Refuse a report that says something else than the one that is stored.

        Raises
        ------
        ConflictError
            The message has both outcomes.
        """
        if self.held is not None and self.held != held:
            words = ("failed", "succeeded")
            raise ConflictError(
                f"the task {task_id} is stored as {words[self.held]}, and this report says that it "
                f"{words[held]}; report another attempt under an id of its own, or have a person "
                "confirm what happened (give_feedback)",
                stored=words[self.held],
                reported=words[held],
            )


@dataclass(frozen=True)
class Entry:
    """An attempt as described by messages.

    Parameters
    ----------
    now
        The end of an attempt whose outcome does not tell it.
    graph
        Graph that it is written to.
    exemplar
        IRI of the single thing, if it is known by a sighting or by name; or empty.
    seen
        Where the object of the same message was seen, and when.
    """

    object_iri: NamedNode
    gripper: StoredGripper
    received: Received
    outcome: Outcome
    task: str
    task_id: str
    now: dt.datetime
    graph: NamedNode
    decision: Decision | None = None
    event: NamedNode | None = None
    exemplar: str = ""
    seen: tuple[Located, dt.datetime] | None = None


def earlier(context: Context, task_id: str, who: list[NamedNode]) -> Earlier | None:
    """Return the result of an earlier request with this id by one of these agents, or None."""
    agents = f"VALUES ?agent {{ {' '.join(map(str, who))} }}"
    same_request = f"?event rt:requestId {literal(task_id)}"
    # Each part is a query of its own; otherwise the store reads every event before the id.
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?thing ?grasp ?view ?held WHERE {{
  {{ {agents} {same_request} ; rt:performedBy ?agent ; rt:executesGrasp ?grasp .
     ?task rt:through ?event ; rt:handles ?thing
     OPTIONAL {{ ?event rt:hasOutcome/rt:success ?held }} }}
  UNION
  {{ {agents} {same_request} ; prov:wasAssociatedWith ?agent ; sosa:hasFeatureOfInterest ?thing .
     ?view a rt:View ; prov:wasDerivedFrom ?event }}
}} ORDER BY ?thing ?grasp ?view""")
    events = [row.to_dict() for row in rows]
    if not events:
        return None

    def first(name: str) -> str:
        return next((str(row[name]) for row in events if row[name] is not None), "")

    grasp = first("grasp")
    held = {"true": True, "false": False}.get(first("held").lower())
    return Earlier(first("thing"), grasp, first("view"), bool(grasp), held)


def task_iri(context: Context, task_id: str) -> NamedNode:
    """Return the IRI of a task; ids chosen by clients get one here."""
    start = f"{context.kb.base}task/"
    return iri(task_id) if task_id.startswith(start) else context.names.unique("task")


def resolve_grasp(
    context: Context, triples: Triples, object_iri: NamedNode, gripper_type: str, grasp: Received
) -> tuple[NamedNode, bool]:
    """Return the grasp of an object that a message names, and whether it is new.

    A grasp of another object that was tried on this one becomes a grasp of this one, derived from
    the other; likewise one of another type of gripper, so that outcomes are told apart by hand.

    Raises
    ------
    UnknownTermError
        Only an id is given, and it is not a grasp of this object.
    """
    if grasp.iri is not None and context.kb.match(object_iri, RT.hasGrasp, grasp.iri):
        mine = context.kb.match(grasp.iri, RT.gripperType, literal(gripper_type))
        if mine or grasp.in_object is None:
            return grasp.iri, False
    if grasp.in_object is None:
        name = grasp.id or "without an id"
        is_posed = grasp.in_frame is not None or grasp.frame_from_gripper is not None
        lacking = "its pose is missing"
        if is_posed:
            lacking = (
                "nothing says where the object stood, on which its pose depends; give the "
                "task_id of a decision, or the pose on the object as grasp.in_object"
            )
        raise UnknownTermError(f"grasp {name} is not a grasp of {object_iri.value}, and {lacking}")
    same = find_grasp(context, object_iri, gripper_type, grasp)
    if same is not None:
        return same, False
    state_frame(context, triples, object_iri)
    source = grasp.iri
    if source is not None and not context.kb.match(None, RT.hasGrasp, source):
        source = None
    return state_grasp(context, triples, object_iri, gripper_type, grasp, derived_from=source), True


@dataclass(frozen=True)
class Recorded:
    """Changes made by an attempt to be stored.

    Parameters
    ----------
    withdrawn
        Statements of the old count, belief and place, to be withdrawn.
    counts
        Judged attempts of the grasp by (held, in coarse physics), including this one; None if
        this one is not judged.
    exemplar
        IRI of the single thing; empty if nobody knows which one it was.
    """

    grasp: NamedNode
    withdrawn: Withdrawn
    counts: Mapping[tuple[bool, bool], int] | None = None
    exemplar: str = ""


def record(context: Context, triples: Triples, entry: Entry, pending: Pending) -> Recorded:
    """Add an attempt with grasp, outcome, count and belief, and where it left the object.

    Parameters
    ----------
    pending
        Counts of this commit so far; those of the attempt are added.
    """
    entry = replace(entry, received=entry.received.held_by(entry.gripper.gripper))
    _check_kind(context, entry)
    entry.received.check_reach()
    grasp, is_new = resolve_grasp(
        context, triples, entry.object_iri, entry.gripper.gripper.gripper_type, entry.received
    )
    entry = _with_belief(context, entry, grasp, is_new, pending)
    recognition = None
    if entry.decision is not None and entry.decision.recognition is not None:
        recognition = state_recognition(context, triples, entry.decision.recognition, entry.event)
    task_class, task_name = find_task(entry.task)
    started, ended = entry.outcome.span(entry.now)
    node = context.names.unique("attempt")
    place = _place_before(context, entry, started or ended)
    exemplar, withdrawn = _handle(context, triples, entry, pending, node)
    attempt = Attempt(
        attempt=node,
        object_iri=entry.object_iri,
        grasp=grasp,
        gripper=entry.gripper,
        task=task_iri(context, entry.task_id),
        task_class=task_class,
        task_name=task_name,
        request_id=entry.task_id,
        started=started,
        ended=ended,
        outcome=entry.outcome,
        received=entry.received,
        recognition=recognition,
        exemplar=iri(exemplar) if exemplar else None,
        times=_times(entry),
        seed=None if entry.decision is None else entry.decision.seed,
        place=None if place is None else (place.frame_id, place.frame_from_object),
    )
    triples.extend(attempt_triples(context, attempt))
    state_task_tree(context, triples, attempt)
    gripper, held = entry.gripper, entry.outcome.held
    if entry.outcome.reason in UNJUDGED:
        return Recorded(grasp, withdrawn, exemplar=exemplar)
    if entry.graph == context.kb.graphs.agent(gripper.robot_name):
        withdrawn += count(
            context, triples, grasp, gripper.gripper.gripper_type, gripper.robot, entry.graph,
            attempts=1, successes=int(held), pending=pending,
        )  # fmt: skip
    stated = pending.judged.setdefault(grasp, Counter())
    stated[held, entry.outcome.is_fast] += 1
    counts = Counter(judged_counts(context, grasp)) + stated
    quality = entry.received.quality if is_new else None
    withdrawn += believe(
        context, triples, grasp, counts, gripper.robot, entry.graph,
        None if quality is None else rounded(quality),
    )  # fmt: skip
    withdrawn += _calibrate(context, triples, entry, pending)
    _tell_causes(context, triples, entry, pending, (attempt.attempt, grasp, is_new))
    return Recorded(grasp, withdrawn, counts, exemplar)


def _with_belief(
    context: Context, entry: Entry, grasp: NamedNode, is_new: bool, pending: Pending
) -> Entry:
    """Return an attempt with the belief before it; a plan on a view comes without the learner's."""
    quality = entry.received.quality
    if entry.received.belief is not None or quality is None:
        return entry
    counts = Counter() if is_new else Counter(judged_counts(context, grasp))
    counts += pending.judged.get(grasp, Counter())
    tallies = [(*how, number) for how, number in counts.items()]
    before = posterior(context.policy, min(max(rounded(quality), 0.0), 1.0), tallies)
    return replace(entry, received=replace(entry.received, belief=(before.alpha, before.beta)))


def _place_before(context: Context, entry: Entry, begun: dt.datetime) -> Located | None:
    """Return where the robot knew the object when a recorded attempt began; None if unknown."""
    if entry.outcome.report.motion is None:
        return None
    if entry.seen is not None and entry.seen[1] <= begun:
        return entry.seen[0]
    return place_before(context.kb, entry.object_iri, entry.gripper.robot, entry.graph, begun)


def _handle(
    context: Context, triples: Triples, entry: Entry, pending: Pending, attempt: NamedNode
) -> tuple[str, Withdrawn]:
    """State where an attempt left its object; return the single thing, and what is withdrawn."""
    _, ended = entry.outcome.span(entry.now)
    edit = pending.world = pending.world or WorldEdit(context.world, entry.graph)
    exemplar = entry.exemplar or ("" if entry.decision is None else entry.decision.exemplar)
    exemplar = present(context.world, exemplar) if exemplar else ""
    if not (exemplar and edit.is_of(exemplar, entry.object_iri.value)):
        exemplar = exemplar_handled(context, edit, entry.object_iri, entry.gripper, entry.outcome)
    move_exemplar(edit, exemplar, entry.gripper, entry.outcome, ended, attempt)
    handled = Handled(entry.gripper.robot, exemplar)
    withdrawn = state_moved(
        context, triples, entry.object_iri, handled, entry.outcome, ended, entry.graph
    )
    added, removed = edit.drain()
    triples.extend(added)
    return exemplar, [*withdrawn, *removed]


def _check_kind(context: Context, entry: Entry) -> None:
    """Refuse an outcome of a stored grasp that the hand cannot have carried out."""
    grasp, hand = entry.received.iri, entry.gripper.gripper
    if grasp is None:
        return
    classes = {quad.object for quad in context.kb.match(grasp, RDF.type)}
    kind = next((k for k, class_iri in CONTACT_CLASSES.items() if class_iri in classes), "jaws")
    if kind != hand.contact_kind:
        raise UsageError(
            f"grasp: {grasp.value} is by {kind}, and {hand.name!r} holds by {hand.contact_kind}",
            field="grasp",
        )  # fmt: skip


def _calibrate(context: Context, triples: Triples, entry: Entry, pending: Pending) -> Withdrawn:
    """Restate the hand's map from scores to chances where the robot itself reports a score."""
    quality, gripper = entry.received.quality, entry.gripper
    if quality is None or entry.graph != context.kb.graphs.agent(gripper.robot_name):
        return []
    kind = quality_kind(entry.received)
    scores = pending.scored.setdefault((gripper.iri, kind), [])
    scores.append(Scored("", kind, rounded(quality), entry.outcome.held))
    return calibrate(context, triples, gripper, kind, scores, entry.graph)


def _tell_causes(
    context: Context,
    triples: Triples,
    entry: Entry,
    pending: Pending,
    stored: tuple[NamedNode, NamedNode, bool],
) -> None:
    """Add a judged attempt from above to those that speak about hidden causes."""
    attempt, grasp, is_new = stored
    at, gripper = entry.received.in_object, entry.gripper.gripper
    if is_new:
        x = None if at is None or entry.received.orientation is not None else rounded(at[0])
    else:
        x = place_along(context.kb.match, grasp)
    if x is None:
        return
    if pending.causes is None:
        pending.causes = Causes(context)
    pending.causes.size(entry.object_iri, triples)
    outcome = entry.outcome
    pending.causes.add(
        entry.object_iri,
        Tried(attempt, x, outcome.held, float(gripper.finger_width), outcome.reason),
    )


def _times(entry: Entry) -> Mapping[str, float]:
    decided: dict[str, Any] = {}
    if entry.decision is not None:
        decided = {k: v for k, v in entry.decision.times.items() if k != "total_s"}
    times = entry.outcome.report.times
    stated_times = {} if times is None else times.model_dump(exclude_none=True)
    if entry.outcome.report.duration_s is not None:
        decided["execution_s"] = entry.outcome.report.duration_s
    return {**decided, **stated_times}
