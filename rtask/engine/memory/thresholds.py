"""Decide whether confidence suffices for a grasp, with the thresholds of Kehoe 2014, 4.3.

Three confidences must reach their thresholds before a grasp: in the object's identity (s_I, c_I),
in its pose (s_T, c_T) and in the grasp (s_G, c_G). The first that is too low ends the decision; the
answer gives its value, the best alternatives and advice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

from grasp.spatial.collision import SLIDE
from rtask.engine.decisions import Option
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, RememberedObject

if TYPE_CHECKING:
    from features.pose import PoseEstimate
    from features.recognition.recogniser import Recognition

__all__ = ["Assessment", "Thresholds", "Unknown", "asked", "decide", "grasps_above"]

MAX_ALTERNATIVES = 3
Unknown = Literal["refuse", "if_new", "grasp"]
"""Treatment of objects that are not recognised; see :attr:`Thresholds.unknown`."""


@dataclass(frozen=True)
class Thresholds:
    """c_I, c_T and c_G, each 0..1.

    Parameters
    ----------
    needs_pose
        Whether the request names c_T: a pose that nothing tells is then too uncertain.
    cautious
        Whether c_G is compared with the lower end of the 90 % interval of a grasp's chance, not
        with its mean.
    unknown
        Treatment of objects that are not recognised: ``refuse`` all; ``if_new`` grasps those that
        resemble nothing known, so that no other view could recognise them; ``grasp`` all, for tasks
        that do not depend on the identity.
    """

    identity: float
    pose: float
    grasp: float
    needs_pose: bool = False
    cautious: bool = False
    unknown: Unknown = "refuse"


@dataclass(frozen=True)
class Assessment:
    """Input of a decision.

    Parameters
    ----------
    recognised
        The recognised object, or None.
    pose
        Pose of the object; None if stored data do not determine it.
    chosen
        All options of the learner, in its order.
    lies_flat
        Whether it is so low and wide that only the support keeps the hand from holding it.
    """

    recognition: Recognition
    memory: Memory
    recognised: RememberedObject | None
    pose: PoseEstimate | None
    chosen: Sequence[Option]
    lies_flat: bool = False


class Asking(Protocol):
    """The fields of a request that ask for a decision."""

    @property
    def decide(self) -> bool:
        """Whether to decide by the thresholds of the policy."""

    @property
    def min_confidence(self) -> float | None:
        """For an object to count as recognised; c_I where that is not given."""

    @property
    def min_identity(self) -> float | None:
        """Threshold c_I."""

    @property
    def min_pose(self) -> float | None:
        """Threshold c_T."""

    @property
    def min_grasp(self) -> float | None:
        """Threshold c_G."""

    @property
    def cautious(self) -> bool:
        """Whether the task asks for caution."""

    @property
    def unknown(self) -> Unknown:
        """Treatment of objects that are not recognised."""


def asked(policy: Policy, request: Asking) -> Thresholds | None:
    """Return the thresholds of a request, or None when it does not ask for a decision.

    >>> from types import SimpleNamespace
    >>> wish = {"min_confidence": None, "min_identity": None, "min_pose": None, "min_grasp": 0.5}
    >>> how = {"decide": False, "cautious": False, "unknown": "refuse"}
    >>> asked(Policy(), SimpleNamespace(**how, **wish)).grasp
    0.5
    """
    given = (request.min_identity, request.min_pose, request.min_grasp)
    if not request.decide and all(value is None for value in given):
        return None
    identity = request.min_confidence
    identity = policy.min_identity if identity is None else identity
    default = (identity, policy.min_pose, policy.min_grasp)
    # By None and not by truth: a threshold of 0 is meant.
    least, pose, grasp = (d if g is None else float(g) for d, g in zip(default, given, strict=True))
    return Thresholds(
        least,
        pose,
        grasp,
        needs_pose=bool(request.min_pose),
        cautious=request.cautious,
        unknown=request.unknown,
    )


def grasps_above(chosen: Sequence[Option], thresholds: Thresholds) -> list[Option]:
    """Return the options with sufficient confidence, in their order."""
    return [option for option in chosen if _chance(option, thresholds.cautious) >= thresholds.grasp]


def _chance(option: Option, cautious: bool = False) -> float:
    """Return the chance that a grasp holds, 0 where the learner has not looked at it."""
    if option.choice is None:
        return 0.0
    return option.choice.interval90[0] if cautious else option.choice.mean


def decide(thresholds: Thresholds, case: Assessment, identity: float) -> dict[str, Any]:
    """Return the decision: ``grasp``, or the confidence that was too low, with advice.

    Parameters
    ----------
    identity
        s_I of the best match; 1.0 for an object that the robot kept track of.
    """
    pose = None if case.pose is None else float(case.pose.confidence)
    grasp = max((_chance(option, thresholds.cautious) for option in case.chosen), default=0.0)
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
    # In the order in which a robot can do something about it: what it is, where it is, how to grasp
    # it.
    is_new = case.recognised is None and _may_be_new(thresholds, case)
    if not is_new and (case.recognised is None or identity < thresholds.identity):
        low = ("identity", identity, thresholds.identity, _objects(case), _look(case))
    elif (pose is not None and pose < thresholds.pose) or (pose is None and thresholds.needs_pose):
        low = ("pose", pose or 0.0, thresholds.pose, _poses(case), _turn(case))
    elif not case.chosen or grasp < thresholds.grasp:
        low = ("grasp", grasp, thresholds.grasp, _grasps(case, thresholds.cautious), _try(case))
    else:
        answer["text"] = _sentence(None if is_new else identity, pose, grasp)
        return answer
    name, confidence, threshold, alternatives, advice = low
    # Rounded down: "0.95 is below 0.95" would be told otherwise.
    reason = f"{name}: {math.floor(confidence * 100) / 100:.2f} is below {threshold:.2f}"
    if name == "identity" and confidence >= threshold:
        reason = f"identity: {confidence:.2f}, and too little is known yet to compare it with"
    elif name == "grasp" and not case.chosen:
        reason = "grasp: there is none that could hold it"
    elif name == "pose" and case.pose is None:
        reason = f"pose: nothing stored tells it, and {threshold:.2f} is asked for"
    answer.update(
        answer="too_low", too_low=name, confidence=confidence, threshold=threshold,
        alternatives=alternatives, text=reason, advice=advice,
    )  # fmt: skip
    return answer


def _may_be_new(thresholds: Thresholds, case: Assessment) -> bool:
    """Tell whether an object that was not recognised is grasped as a new one."""
    doubtful = case.recognition.ask_again
    return thresholds.unknown == "grasp" or (thresholds.unknown == "if_new" and not doubtful)


def _sentence(identity: float | None, pose: float | None, grasp: float) -> str:
    if identity is None:
        return f"a new object; that it will hold {grasp:.2f}: this suffices"
    seen = "" if pose is None else f", where it is {pose:.2f}"
    return f"what it is {identity:.2f}{seen}, that it will hold {grasp:.2f}: all suffice"


def _objects(case: Assessment) -> list[dict[str, Any]]:
    """Return the best matches, since a close second suggests a false match (Kehoe 2014, 4.6)."""
    matches = case.recognition.matches[:MAX_ALTERNATIVES]
    recognised = case.memory.objects
    return [
        {
            "object": match.object_iri,
            "label": recognised[match.object_iri].label if match.object_iri in recognised else "",
            "confidence": float(match.confidence),
        }
        for match in matches
    ]


def _look(case: Assessment) -> str:
    if not case.recognition.matches:
        return "nothing known looks like it: insert it, or let a person name it (teach_object)"
    return "look again from another side or nearer, or let a person name it (teach_object)"


def _poses(case: Assessment) -> list[dict[str, Any]]:
    if case.pose is None:
        return []
    others = case.pose.alternatives[:MAX_ALTERNATIVES]
    return [{"score": float(other.score)} for other in others]


def _turn(case: Assessment) -> str:
    if case.pose is None:
        return "store more views of it (insert_object): its model then tells the pose"
    pose = case.pose
    if pose.is_turn_free:
        return "it is so round that it fits at any turn: no other look tells more of how it lies"
    if pose.ambiguous:
        return "it fits in several poses: look from a side that tells them apart"
    return f"{100 * pose.coverage:.0f} % of what was seen fits: look from where it was seen before"


def _grasps(case: Assessment, cautious: bool) -> list[dict[str, Any]]:
    sure = [option for option in case.chosen if option.choice is not None]
    sure.sort(key=lambda option: -_chance(option, cautious))
    return [
        {
            "id": option.id,
            "confidence": _chance(option, cautious),
            "attempts": option.remembered.attempts if option.remembered else 0,
            "text": option.explanation.get("text", ""),
        }
        for option in sure[:MAX_ALTERNATIVES]
    ]


def _try(case: Assessment) -> str:
    if case.lies_flat:
        return SLIDE
    if not case.chosen:
        return "no grasp is left: let geometry propose (propose), or plan one (rtask grasp)"
    return "let geometry propose others (propose), try another hand, or turn the object"
