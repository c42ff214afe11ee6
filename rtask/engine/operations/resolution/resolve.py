"""Resolution of a request for a kind or use of object to one visible object (Gatto 2016, 5).

The words are mapped to classes and functions. The reasoner's closure gives the objects that fit,
the gripper's limits those that it can hold, the robot's observations those that are visible. One
query finds the objects, another recalls their grasps. Reasons for failure come in this order: no
such kind, none visible, visible but impossible to hold, known and last seen elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.confidence import posterior
from rtask.engine.memory.meaning import meaning
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.operations.grasps import recalled
from rtask.engine.operations.operation import operation
from rtask.engine.remembered import Memory, Remembered, RememberedObject
from rtask.rdf.namespaces import local_name

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

from rtask.engine.operations.resolution.candidates import ObjectCandidate, find_candidates
from rtask.engine.operations.resolution.messages import ResolvedRequest, ResolveRequest
from rtask.engine.operations.resolution.proof import proof
from rtask.engine.operations.resolution.reasons import find_reasons, sentence, undecided

__all__ = ["resolve_request"]


@operation("read", "reads", "choose a seen object that serves a request, and its grasps")
def resolve_request(context: Context, request: ResolveRequest, access: Access) -> ResolvedRequest:
    """Return a visible object that can be held, with its grasps, or the reasons for failure."""
    gripper = context.grippers.find(request.gripper_id, access)
    meant = meaning(context, request.wanted)
    candidates: list[ObjectCandidate] = []
    memory, untried = Memory(), 0
    if meant.senses:
        candidates, untried = find_candidates(context, meant, gripper, request)
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
    reasons = find_reasons(context, request.wanted, meant, candidates, excluded)
    grasps = _grasps(memory, best, gripper)
    if untried:
        reasons.append(undecided(context, meant, len(candidates), untried))
    return ResolvedRequest(
        task_response="object" if best else "unmet",
        object=best.iri if best else "",
        thing=best.thing if best else "",
        class_iri=remembered.class_iri,
        label=remembered.label,
        grasps=recalled(context, grasps, request.max_grasps),
        grasps_left_out=max(len(grasps) - request.max_grasps, 0),
        objects=[candidate.message() for candidate in offered],
        reasons=reasons,
        understood={
            "classes": meant.terms("class"),
            "functions": meant.terms("function"),
            "colours": meant.terms("colour"),
            "traits": meant.terms("trait"),
            "printed": [sense.words for sense in meant.senses if sense.kind == "print"],
            "ignored": list(meant.ignored),
        },
        explanation={
            "text": sentence(context, meant, best, reasons),
            "proof": proof(context, meant, best, gripper) if best and request.prove else [],
        },
        suggestions=list(meant.suggestions),
        objects_untried=untried,
    )


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
    memory: Memory, best: ObjectCandidate | None, gripper: StoredGripper
) -> list[Remembered]:
    """Return the known grasps of an object for a type of gripper."""
    if best is None:
        return []
    kind = gripper.gripper.gripper_type
    return [g for g in memory.of(best.iri) if g.gripper_type == kind]
