"""A grasp, or the confidence that was too low: the thresholds of Kehoe 2014, 4.3.

Three confidences stand between a look and a grasp: that it is this object (s_I against c_I), that
it is where it seems (s_T against c_T), that the grasp will hold (s_G against c_G). The first that
is too low ends the decision, and is told with its number, the best alternatives and what would
help.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rtask.engine.operations.messages import Field
from rtask.engine.policy import Policy

if TYPE_CHECKING:
    from rtask.engine.memory.choice import Option
    from rtask.engine.operations.recognise import Situation

__all__ = ["DECISION", "Thresholds", "asked", "decide", "grasps_above"]

_MOST_ALTERNATIVES = 3

DECISION = (
    Field("decide", "boolean", "answer with a grasp or with the confidence that was too low",
          default=False),
    Field("min_identity", "number", "c_I, that it is this object; asks to decide",
          low=0.0, high=1.0),
    Field("min_pose", "number", "c_T, that it is where it seems; asks to decide",
          low=0.0, high=1.0),
    Field("min_grasp", "number", "c_G, that the grasp will hold; asks to decide",
          low=0.0, high=1.0),
)  # fmt: skip
"""Fields of a request that ask for a decision; without any of them nothing is held back."""


@dataclass(frozen=True)
class Thresholds:
    """c_I, c_T and c_G, each 0..1."""

    identity: float
    pose: float
    grasp: float


def asked(policy: Policy, request: dict[str, Any]) -> Thresholds | None:
    """Return the thresholds of a request, or None when it does not ask for a decision.

    >>> asked(Policy(), dict(decide=False, min_identity=None, min_pose=None, min_grasp=0.5))
    Thresholds(identity=0.7, pose=0.7, grasp=0.5)
    """
    given = [request[name] for name in ("min_identity", "min_pose", "min_grasp")]
    if not request["decide"] and all(one is None for one in given):
        return None
    identity = request.get("min_confidence")
    identity = policy.min_identity if identity is None else identity
    default = (identity, policy.min_pose, policy.min_grasp)
    numbers = (d if g is None else float(g) for d, g in zip(default, given, strict=True))
    return Thresholds(*numbers)


def grasps_above(chosen: Sequence[Option], threshold: float) -> list[Option]:
    """Return the options that are sure enough, in their order."""
    return [one for one in chosen if one.choice is not None and one.choice.mean >= threshold]


def decide(thresholds: Thresholds, situation: Situation, identity: float) -> dict[str, Any]:
    """Return the decision: ``grasp``, or which confidence was too low and what would help.

    Parameters
    ----------
    situation
        With every option that the learner offers.
    identity
        s_I of the best match, 1.0 for an object that the robot followed.
    """
    pose = None if situation.pose is None else float(situation.pose.confidence)
    grasp = max((o.choice.mean for o in situation.chosen if o.choice is not None), default=0.0)
    answer: dict[str, Any] = {
        "answer": "grasp",
        "too_low": "",
        "confidence": grasp,
        "threshold": thresholds.grasp,
        "confidences": {"identity": identity, "pose": pose, "grasp": grasp},
        "thresholds": {
            "identity": thresholds.identity,
            "pose": thresholds.pose,
            "grasp": thresholds.grasp,
        },
        "alternatives": [],
        "text": "",
        "advice": "",
    }
    if situation.known is None or identity < thresholds.identity:
        low = ("identity", identity, thresholds.identity, _objects(situation), _look(situation))
    elif pose is not None and pose < thresholds.pose:
        low = ("pose", pose, thresholds.pose, _poses(situation), _turn(situation))
    elif not situation.chosen or grasp < thresholds.grasp:
        low = ("grasp", grasp, thresholds.grasp, _grasps(situation), _try(situation))
    else:
        answer["text"] = _sentence(identity, pose, grasp)
        return answer
    name, confidence, threshold, alternatives, advice = low
    said = f"{name}: {math.floor(confidence * 100) / 100:.2f} is below {threshold:.2f}"
    if name == "identity" and confidence >= threshold:
        said = f"identity: {confidence:.2f}, and too little is known yet to compare it with"
    elif name == "grasp" and not situation.chosen:
        said = "grasp: there is none that could hold it"
    answer.update(
        answer="too_low", too_low=name, confidence=confidence, threshold=threshold,
        alternatives=alternatives, text=said, advice=advice,
    )  # fmt: skip
    return answer


def _sentence(identity: float, pose: float | None, grasp: float) -> str:
    seen = "" if pose is None else f", where it is {pose:.2f}"
    return f"what it is {identity:.2f}{seen}, that it will hold {grasp:.2f}: all suffice"


def _objects(situation: Situation) -> list[dict[str, Any]]:
    """Return the best matches; the second near to the first tells a false match (Kehoe 4.6)."""
    matches = situation.recognition.matches[:_MOST_ALTERNATIVES]
    known = situation.memory.objects
    return [
        {
            "object": match.object_iri,
            "label": known[match.object_iri].label if match.object_iri in known else "",
            "confidence": float(match.confidence),
        }
        for match in matches
    ]


def _look(situation: Situation) -> str:
    if not situation.recognition.matches:
        return "nothing known looks like it: insert it, or let a person name it (teach_object)"
    return "look again from another side or nearer, or let a person name it (teach_object)"


def _poses(situation: Situation) -> list[dict[str, Any]]:
    assert situation.pose is not None
    others = situation.pose.estimate.alternatives[:_MOST_ALTERNATIVES]
    return [{"score": float(other.score)} for other in others]


def _turn(situation: Situation) -> str:
    assert situation.pose is not None
    found = situation.pose.estimate
    if found.ambiguous:
        return "it fits in several poses: look from a side that tells them apart"
    return f"{100 * found.coverage:.0f} % of what was seen fits: look from where it was seen before"


def _grasps(situation: Situation) -> list[dict[str, Any]]:
    sure = [one for one in situation.chosen if one.choice is not None]
    sure.sort(key=lambda one: -one.choice.mean if one.choice else 0.0)
    return [
        {
            "id": one.id,
            "confidence": one.choice.mean if one.choice else 0.0,
            "attempts": one.remembered.attempts if one.remembered else 0,
            "text": one.explanation.get("text", ""),
        }
        for one in sure[:_MOST_ALTERNATIVES]
    ]


def _try(situation: Situation) -> str:
    if not situation.chosen:
        return "no grasp is left: let geometry propose (propose), or plan one (rtask grasp)"
    return "let geometry propose others (propose), try another hand, or turn the object"
