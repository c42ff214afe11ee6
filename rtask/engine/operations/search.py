"""Which known objects look like this one? (Gatto 2016, 3.2.4)"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.engine.memory.recall import Memory, Remembered, recall
from rtask.engine.memory.statistics import lower_95
from rtask.engine.perception.identity import recognise, settle
from rtask.engine.perception.observation import Observation
from rtask.engine.perception.placement import place

if TYPE_CHECKING:
    from features.recognition.recogniser import Match, Recognition
    from rtask.engine.engine import Engine
    from rtask.kb.commit.access import Access

__all__ = ["best_grasp", "match_message", "search_object", "similar_objects"]


def search_object(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Answer with the known objects that look alike, best first; writes nothing.

    A description narrows the answer to its kinds of objects, in the same query.
    """
    from rtask.engine.operations.recognise import question_for

    seen = engine.observations.observe(request)
    recognition = recognise(
        engine.recogniser, seen, engine.policy, request["max_results"], request["min_confidence"]
    )
    description = request["class_description"]
    kinds = engine.classes.find(description) if description else []
    answer: dict[str, Any] = {"similar_objects": [], "suggestions": []}
    if description and not kinds:
        answer["suggestions"] = engine.classes.suggestions(description)
        return answer
    only = tuple(kind.iri.value for kind in kinds)
    memory = recall(engine.kb, question_for(engine, seen, recognition, None, None, only))
    recognition = settle(recognition, memory, seen, engine.policy)
    least = request["min_confidence"] or 0.0
    similar = similar_objects(seen, recognition, memory)
    answer["similar_objects"] = [entry for entry in similar if entry["confidence"] >= least]
    return answer


def match_message(match: Match, memory: Memory) -> dict[str, Any]:
    """Return one match of recognition as messages carry it."""
    known = memory.objects[match.object_iri]
    return {
        "object": match.object_iri,
        "class_iri": known.class_iri,
        "label": known.label,
        "confidence": float(match.confidence),
        "inliers": int(match.inliers),
    }


def similar_objects(
    seen: Observation, recognition: Recognition, memory: Memory
) -> list[dict[str, Any]]:
    """Return the matches with the position of each object's best grasp, or nulls without one."""
    answer = []
    for match in recognition.matches:
        known = memory.objects.get(match.object_iri)
        if known is None:
            continue
        entry: dict[str, Any] = {
            "class": known.short_id,
            "class_iri": known.class_iri,
            "object": known.iri,
            "label": known.label,
            "confidence": float(match.confidence),
            **dict.fromkeys(("X", "Y", "Z", "rad", "grasp")),
        }
        best = best_grasp(memory.of(known.iri))
        placement = place(seen, known.is_round)
        if best is not None and placement is not None:
            x, y, theta = placement.to_frame(best.x, best.y, best.theta)
            z = float(placement.frame_from_object[2, 3]) + best.z
            entry.update(X=x, Y=y, Z=z, rad=theta, grasp=best.grasp)
        answer.append(entry)
    return answer


def best_grasp(grasps: list[Remembered]) -> Remembered | None:
    """Return the grasp that is surest to hold, by what happened and then by geometry."""
    return max(
        grasps,
        key=lambda g: (lower_95(g.successes, g.attempts), g.successes, g.quality, g.x, g.y),
        default=None,
    )
