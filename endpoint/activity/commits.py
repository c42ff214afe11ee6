"""Commits as events for people: new objects, outcomes of attempts, verdicts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from endpoint.activity.log import OPERATOR, Event
from endpoint.activity.words import AFTER, title
from rtask.engine.words import reason_words
from rtask.kb.commit.commit import Change
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PROV, RDF, RDFS, RT
from rtask.rdf.terms import Literal, NamedNode, python_value

__all__ = ["commit_events"]

MAX_READ = 20_000
MAX_LISTED = 20
_Facts = Mapping[NamedNode, list[Any]]


def commit_events(kb: KnowledgeBase, change: Change) -> list[Event]:
    """Return what a commit tells; a commit that tells nothing else is one ``wrote`` event.

    Reads the statements of the commit and looks up names, so that it can be called for each commit.
    """
    who, seq = change.agent or OPERATOR, change.commit.seq
    at = change.commit.time.timestamp()
    events: list[Event] = []
    if len(change.added) <= MAX_READ:
        added = _by_subject(change)
        events = [*_objects(kb, who, added), *_outcomes(kb, who, added), *_verdicts(who, added)]
    if not events:
        size = change.commit.added + change.commit.removed
        count = f"{size} statement{'' if size == 1 else 's'}"
        describers = (
            (f"changed the graph: {change.note}", count) if change.note else (f"changed {count}",)
        )
        events = [Event("wrote", who, *describers)]
    if len(events) > MAX_LISTED:
        shown = MAX_LISTED - 1
        rest = f"and {len(events) - shown} more in one commit"
        events = [*events[:shown], Event("wrote", who, rest, f"commit {seq}")]
    numbered = events
    return [Event(**{**vars(event), "seq": seq, "time_s": at}) for event in numbered]


def _by_subject(change: Change) -> dict[Any, dict[NamedNode, list[Any]]]:
    facts: dict[Any, dict[NamedNode, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for quad in change.added:
        facts[quad.subject][quad.predicate].append(quad.object)
    return facts


def _of_type(added: Mapping[Any, _Facts], kind: NamedNode) -> Iterable[tuple[Any, _Facts]]:
    return ((s, facts) for s, facts in added.items() if kind in facts.get(RDF.type, ()))


def _value(facts: _Facts, predicate: NamedNode) -> Any:
    """Return a value in Python; IRIs as they are; none if it is not stated."""
    values = facts.get(predicate)
    if not values:
        return None
    return python_value(values[0]) if isinstance(values[0], Literal) else values[0]


def _objects(kb: KnowledgeBase, who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    """Return the objects that are new to the graph: only those have a new id."""
    events: list[Event] = []
    for subject, facts in added.items():
        if RT.objectId in facts and isinstance(subject, NamedNode):
            # Further ones are only counted: their names would be looked up for nothing.
            name = name_of(kb, subject) if len(events) < MAX_LISTED else subject.value
            events.append(
                Event("wrote", who, f"told the graph of {name}", "a new object",
                      object=subject.value, object_name=name)
            )  # fmt: skip
    return events


def _outcomes(kb: KnowledgeBase, who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    handled = {
        attempt: facts[RT.handles][0]
        for facts in added.values()
        if RT.handles in facts
        for attempt in facts.get(RT.through, ())
    }
    events = []
    for attempt, facts in _of_type(added, RT.GraspAttempt):
        outcome = added.get(_value(facts, RT.hasOutcome), {})
        held = _value(outcome, RT.success)
        subject = handled.get(attempt) or _object_of(kb, _value(facts, RT.executesGrasp))
        name = name_of(kb, subject) if subject is not None else "something"
        code = _value(outcome, RT.hasReason)
        reason = code.value.rpartition("reason_")[2] if isinstance(code, NamedNode) else ""
        placed = " and put it down" if _value(outcome, RT.placed) else ""
        thus = f"held {name}{placed}" if held else f"did not hold {name}: {reason_words(reason)}"
        pictures = _pictures(added, attempt)
        events.append(
            Event("outcome", who, thus.rstrip(": "), _reasons(facts, added, outcome),
                  object=subject.value if isinstance(subject, NamedNode) else "", object_name=name,
                  held=bool(held), before=pictures.get("pre_grasp", ""),
                  after=next((pictures[p] for p in AFTER if p in pictures), ""))
        )  # fmt: skip
    return events


def _reasons(facts: _Facts, added: Mapping[Any, _Facts], outcome: _Facts) -> str:
    """Return which grasp was tried, what was expected of it, and what the robot measured."""
    reasons = []
    number, rank = _value(facts, RT.attemptNumber), _value(facts, RT.candidateRank)
    if number is not None:
        reasons.append(f"attempt {number}")
    if rank is not None:
        count = _value(facts, RT.candidateCount)
        reasons.append(f"choice {rank} of {count} grasps" if count else f"choice {rank}")
    alpha, beta = _value(facts, RT.priorAlpha), _value(facts, RT.priorBeta)
    if alpha and beta:
        reasons.append(f"expected to hold: {alpha / (alpha + beta):.0%}")
    feedback = added.get(_value(outcome, RT.hasFeedback), {})
    measured = _value(feedback, RT.comment)
    return "; ".join([", ".join(reasons), *([str(measured)] if measured else [])]).strip("; ")


def _pictures(added: Mapping[Any, _Facts], attempt: Any) -> dict[str, str]:
    """Return the SHA-256 of each picture of an attempt by its phase."""
    pictures = {}
    for _, facts in _of_type(added, RT.ColorImage):
        blob = _value(facts, RT.hasBlob)
        if _value(facts, PROV.wasGeneratedBy) == attempt and isinstance(blob, NamedNode):
            pictures[str(_value(facts, RT.name))] = blob.value.rpartition(":")[2]
    return pictures


def _verdicts(who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    events = []
    for _, facts in _of_type(added, RT.HumanFeedback):
        held = bool(_value(facts, RT.verdict))
        words = "says that it held" if held else "says that it did not hold"
        detail = str(_value(facts, RT.comment) or "")
        events.append(Event("verdict", who, words, detail, held=held))
    return events


def name_of(kb: KnowledgeBase, subject: NamedNode) -> str:
    """Return what to call an object: its name, else its kind."""
    named = kb.match(subject, RT.name)
    if named:
        return str(python_value(named[0].object))
    kinds = {
        str(python_value(label.object))
        for kind in _kinds(kb, subject)
        for label in kb.match(kind, RDFS.label)[:1]
    }
    return f"an {title(None, ', '.join(sorted(kinds)))}"


def _kinds(kb: KnowledgeBase, subject: NamedNode) -> Sequence[NamedNode]:
    """Return the most specific kinds of an object: a mug, not also a container."""
    types = {quad.object for quad in kb.match(subject, RDF.type)}
    types -= {RT.ManipulableObject, RT.Exemplar}
    above = {
        kind: {quad.object for quad in kb.match(kind, RDFS.subClassOf, None)} - {kind}
        for kind in types
        if isinstance(kind, NamedNode)
    }
    kinds = [kind for kind, ancestors in above.items() if RT.ManipulableObject in ancestors]
    return [
        kind for kind in kinds
        if not any(kind in above[below] and below not in above[kind] for below in kinds)
    ]  # fmt: skip


def _object_of(kb: KnowledgeBase, grasp: Any) -> Any:
    """Return the object that a grasp belongs to, for robots that report no task around it."""
    holders = kb.match(None, RT.hasGrasp, grasp) if isinstance(grasp, NamedNode) else []
    # A single thing inherits the grasps of its product.
    objects = [q.subject for q in holders if not kb.match(q.subject, RDF.type, RT.Exemplar)]
    return objects[0] if objects else None
