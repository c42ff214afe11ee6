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
MAX_TOLD = 20
_Facts = Mapping[NamedNode, list[Any]]


def commit_events(kb: KnowledgeBase, change: Change) -> list[Event]:
    """Return what a commit tells; a commit that tells nothing else is one ``wrote`` event.

    Reads the statements of the commit and looks up names, so that it can be called for each commit.
    """
    who, seq = change.agent or OPERATOR, change.commit.seq
    at = change.commit.time.timestamp()
    found: list[Event] = []
    if len(change.added) <= MAX_READ:
        added = _by_subject(change)
        found = [*_objects(kb, who, added), *_outcomes(kb, who, added), *_verdicts(who, added)]
    if not found:
        size = change.commit.added + change.commit.removed
        count = f"{size} statement{'' if size == 1 else 's'}"
        told = (
            (f"changed the graph: {change.note}", count) if change.note else (f"changed {count}",)
        )
        found = [Event("wrote", who, *told)]
    numbered = found[:MAX_TOLD]
    return [Event(**{**vars(event), "seq": seq, "time_s": at}) for event in numbered]


def _by_subject(change: Change) -> dict[Any, dict[NamedNode, list[Any]]]:
    facts: dict[Any, dict[NamedNode, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for quad in change.added:
        facts[quad.subject][quad.predicate].append(quad.object)
    return facts


def _of_type(added: Mapping[Any, _Facts], kind: NamedNode) -> Iterable[tuple[Any, _Facts]]:
    return ((s, facts) for s, facts in added.items() if kind in facts.get(RDF.type, ()))


def _one(facts: _Facts, predicate: NamedNode) -> Any:
    """Return a value in Python; IRIs as they are; none if it is not stated."""
    values = facts.get(predicate)
    if not values:
        return None
    return python_value(values[0]) if isinstance(values[0], Literal) else values[0]


def _objects(kb: KnowledgeBase, who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    """Return the objects that are new to the graph: only those have a new id."""
    found: list[Event] = []
    for subject, facts in added.items():
        if len(found) == MAX_TOLD:  # names of more would be looked up for nothing
            break
        if RT.objectId in facts and isinstance(subject, NamedNode):
            name = name_of(kb, subject)
            found.append(
                Event("wrote", who, f"told the graph of {name}", "a new object",
                      object=subject.value, object_name=name)
            )  # fmt: skip
    return found


def _outcomes(kb: KnowledgeBase, who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    handled = {
        attempt: facts[RT.handles][0]
        for facts in added.values()
        if RT.handles in facts
        for attempt in facts.get(RT.through, ())
    }
    found = []
    for attempt, facts in _of_type(added, RT.GraspAttempt):
        outcome = added.get(_one(facts, RT.hasOutcome), {})
        held = _one(outcome, RT.success)
        thing = handled.get(attempt) or _object_of(kb, _one(facts, RT.executesGrasp))
        name = name_of(kb, thing) if thing is not None else "something"
        code = _one(outcome, RT.hasReason)
        reason = code.value.rpartition("reason_")[2] if isinstance(code, NamedNode) else ""
        placed = " and put it down" if _one(outcome, RT.placed) else ""
        thus = f"held {name}{placed}" if held else f"did not hold {name}: {reason_words(reason)}"
        pictures = _pictures(added, attempt)
        found.append(
            Event("outcome", who, thus.rstrip(": "), _reasons(facts, added, outcome),
                  object=thing.value if isinstance(thing, NamedNode) else "", object_name=name,
                  held=bool(held), before=pictures.get("pre_grasp", ""),
                  after=next((pictures[p] for p in AFTER if p in pictures), ""))
        )  # fmt: skip
    return found


def _reasons(facts: _Facts, added: Mapping[Any, _Facts], outcome: _Facts) -> str:
    """Return which grasp was tried, what was expected of it, and what the robot measured."""
    said = []
    number, rank = _one(facts, RT.attemptNumber), _one(facts, RT.candidateRank)
    if number is not None:
        said.append(f"attempt {number}")
    if rank is not None:
        count = _one(facts, RT.candidateCount)
        said.append(f"choice {rank} of {count}" if count else f"choice {rank}")
    alpha, beta = _one(facts, RT.priorAlpha), _one(facts, RT.priorBeta)
    if alpha and beta:
        said.append(f"expected {alpha / (alpha + beta):.0%}")
    feedback = added.get(_one(outcome, RT.hasFeedback), {})
    measured = _one(feedback, RT.comment)
    return "; ".join([", ".join(said), *([str(measured)] if measured else [])]).strip("; ")


def _pictures(added: Mapping[Any, _Facts], attempt: Any) -> dict[str, str]:
    """Return the SHA-256 of each picture of an attempt by its phase."""
    found = {}
    for _, facts in _of_type(added, RT.ColorImage):
        blob = _one(facts, RT.hasBlob)
        if _one(facts, PROV.wasGeneratedBy) == attempt and isinstance(blob, NamedNode):
            found[str(_one(facts, RT.name))] = blob.value.rpartition(":")[2]
    return found


def _verdicts(who: str, added: Mapping[Any, _Facts]) -> list[Event]:
    found = []
    for _, facts in _of_type(added, RT.HumanFeedback):
        held = bool(_one(facts, RT.verdict))
        words = "says that it held" if held else "says that it did not hold"
        detail = str(_one(facts, RT.comment) or "")
        found.append(Event("verdict", who, words, detail, held=held))
    return found


def name_of(kb: KnowledgeBase, thing: NamedNode) -> str:
    """Return what to call an object: its name, else its kind."""
    named = kb.match(thing, RT.name)
    if named:
        return str(python_value(named[0].object))
    kinds = {
        str(python_value(label.object))
        for kind in _kinds(kb, thing)
        for label in kb.match(kind, RDFS.label)[:1]
    }
    return f"an {title(None, ', '.join(sorted(kinds)))}"


def _kinds(kb: KnowledgeBase, thing: NamedNode) -> Sequence[NamedNode]:
    """Return the most specific kinds of an object: a mug, not also a container."""
    types = {quad.object for quad in kb.match(thing, RDF.type)} - {RT.ManipulableObject}
    above = {
        kind: {quad.object for quad in kb.match(kind, RDFS.subClassOf, None)} - {kind}
        for kind in types
        if isinstance(kind, NamedNode)
    }
    kinds = [kind for kind, found in above.items() if RT.ManipulableObject in found]
    return [
        kind for kind in kinds
        if not any(kind in above[below] and below not in above[kind] for below in kinds)
    ]  # fmt: skip


def _object_of(kb: KnowledgeBase, grasp: Any) -> Any:
    """Return the object that a grasp belongs to, for robots that report no task around it."""
    found = kb.match(None, RT.hasGrasp, grasp) if isinstance(grasp, NamedNode) else []
    return found[0].subject if found else None
