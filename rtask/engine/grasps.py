"""What is known about taking one object, without looking at it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rtask.engine.confidence import Confidence, posterior, stored_confidences
from rtask.engine.messages import Field, nearest
from rtask.engine.question import Question
from rtask.engine.recall import Remembered, recall
from rtask.engine.statistics import lower_95, summary
from rtask.engine.vocabulary import PREFIXES
from rtask.errors import UnknownTermError
from rtask.kb.terms import literal

if TYPE_CHECKING:
    from rtask.engine.engine import Engine
    from rtask.kb.access import Access

__all__ = ["RECALL_GRASPS", "recall_grasps", "recalled"]

RECALL_GRASPS = (
    Field("object", "string", "IRI, objectId or name of the object", required=True),
    Field("gripper_id", "string", "only grasps of this gripper's type"),
    Field("max_grasps", "integer", "length of the answer's list", default=10, low=1, high=50),
)


def recall_grasps(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Return the grasps of an object in its own frame, the surest first."""
    name = _object(engine, request["object"])
    memory = recall(engine.kb, Question(objects=(name,)))
    known = memory.objects[name]
    grasps = memory.of(name)
    if request["gripper_id"]:
        wanted = engine.grippers.find(request["gripper_id"], access.agent).gripper.gripper_type
        grasps = [g for g in grasps if g.gripper_type == wanted]
    return {
        "object": name,
        "class_iri": known.class_iri,
        "label": known.label,
        "grasps": recalled(engine, grasps, request["max_grasps"]),
    }


def recalled(engine: Engine, grasps: Iterable[Remembered], most: int) -> list[dict[str, Any]]:
    """Return grasps in their object's frame as messages carry them, the surest first.

    Surest is the best lower bound on what happened, then the stored quality.
    """
    order = sorted(
        grasps, key=lambda g: (-lower_95(g.successes, g.attempts), -g.successes, -g.quality)
    )[:most]
    stored = stored_confidences(engine, [g.grasp for g in order])
    return [
        {
            "id": g.grasp,
            "gripper_type": g.gripper_type,
            "x": g.x,
            "y": g.y,
            "z": g.z,
            "theta": g.theta,
            "opening": g.opening,
            "grasp_quality": g.quality,
            "statistics": summary(g.successes, g.attempts),
            "confidence": _confidence(engine, g, stored.get(g.grasp, Confidence())),
        }
        for g in order
    ]


def _confidence(engine: Engine, grasp: Remembered, stored: Confidence) -> dict[str, Any]:
    """Return prior and posterior of a grasp; before the first outcome the two are one.

    A belief that was stored under other rules is computed anew from the attempts.
    """
    policy, note = engine.policy, ""
    prior = grasp.prior if stored.prior is None else stored.prior
    belief = stored.belief
    if belief is None:
        belief = posterior(policy, prior, ())
    elif stored.policy != policy.version:
        counts = [(t.held, t.count * policy.weight_of(t.is_fast)) for t in grasp.tallies]
        belief = posterior(policy, prior, counts)
        note = f"computed anew: stored by the rules {stored.policy or 'of an older release'}"
    return {
        "mean": belief.mean,
        "alpha": belief.alpha,
        "beta": belief.beta,
        "prior": prior,
        "evaluation": stored.evaluation,
        "updated": stored.updated,
        "policy": policy.version,
        "note": note,
    }


def _object(engine: Engine, name: str) -> str:
    rows = engine.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?object ?name WHERE {{ ?object rt:objectId ?id
  OPTIONAL {{ ?object rt:name ?name }}
  FILTER(STR(?object) = {literal(name)} || ?id = {literal(name)} || ?name = {literal(name)})
}} ORDER BY ?object""")
    if rows:
        return str(rows[0].value("object"))
    names = engine.kb.select(
        f"{PREFIXES} SELECT DISTINCT ?n {{ ?o rt:objectId ?id ; rt:name ?n }} ORDER BY ?n"
    )
    hint = nearest(name, [str(row.value("n")) for row in names])
    raise UnknownTermError(f"unknown object {name!r}{hint}")
