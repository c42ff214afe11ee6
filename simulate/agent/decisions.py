"""Decisions before a grasp: the graph refuses what is too uncertain, and the robot responds.

The server compares the confidences in identity, pose and grasp with thresholds (Kehoe 2014, 4.3)
and stores each refusal. The robot then does what may help: look from elsewhere, do without the
pose, use another planner's grasp, wait until neighbours are gone, or push the object; what remains
uncertain is left alone. Each response is stored with its refusal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

__all__ = ["Decided", "Refusal", "Thresholds", "ask_for_decision"]

_WITHOUT_GRASP = ("postponed", "pushed", "left_alone")


@dataclass(frozen=True)
class Thresholds:
    """Least confidences of a robot's task, each 0..1.

    Parameters
    ----------
    identity, pose
        c_I and c_T; None = as the server's policy has them.
    grasp
        c_G. Low by default: a robot that clears a table loses little by a grasp that fails, and
        ranks its grasps anyway. A grasp below it has failed, or others like it, so that another
        attempt would rather do harm.
    cautious
        Whether the task asks for caution: the lower end of what is believed of a grasp must reach
        ``grasp``, so that a grasp of which little is known is refused.
    """

    identity: float | None = None
    pose: float | None = None
    grasp: float = 0.1
    cautious: bool = False

    def as_request(self) -> dict[str, Any]:
        """Return the fields of ``recognise_for_grasp`` that ask for a decision."""
        thresholds = {"min_identity": self.identity, "min_pose": self.pose, "min_grasp": self.grasp}
        given = {k: v for k, v in thresholds.items() if v is not None}
        return {"decide": True, "cautious": self.cautious, **given}


@dataclass(frozen=True)
class Refusal:
    """A refusal, and the robot's response as ``rt:refusalResponse`` has it.

    Parameters
    ----------
    lacking
        ``identity``, ``pose`` or ``grasp``.
    iri
        In the graph; empty where it was not stored.
    """

    lacking: str
    confidence: float
    threshold: float
    response: str
    iri: str = ""


@dataclass(frozen=True)
class Decided:
    """The server's last answer and the refusals before it.

    Parameters
    ----------
    answer
        Of ``recognise_for_grasp``; without grasps where the last refusal stands.
    refusals
        In order.
    """

    answer: dict[str, Any]
    refusals: tuple[Refusal, ...] = ()

    @property
    def ends(self) -> str:
        """Response that ends the attempt: ``postponed``, ``pushed``, ``left_alone``; or empty."""
        last = self.refusals[-1].response if self.refusals else ""
        return last if last in _WITHOUT_GRASP else ""


class Asked(Protocol):
    """The operations of the engine for decisions."""

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]: ...

    def report_refusal(self, **request: Any) -> dict[str, Any]: ...


def ask_for_decision(
    server: Asked,
    request: Mapping[str, Any],
    look_again: Callable[[], dict[str, Any] | None],
    has_others: Callable[[], bool] = lambda: False,
    may_wait: bool = False,
    push: Callable[[bool], bool] = lambda has_grasp: False,
) -> Decided:
    """Ask about an object until the server grants a grasp or nothing more helps.

    Parameters
    ----------
    request
        For ``recognise_for_grasp``, with thresholds.
    look_again
        Returns the object as seen from elsewhere, an observation, or None where the camera cannot
        see it from elsewhere; called at most once.
    has_others
        Tells whether another planner has grasps of the object, which the server does not know of.
    may_wait
        Whether other things can be handled first.
    push
        Pushes the object if that may help, and tells whether it did; the last resort. Called with
        whether the server has any grasp of it.
    """
    request = dict(request)
    refusals: list[Refusal] = []
    while True:
        answer = server.recognise_for_grasp(**request)
        decision = answer.get("decision")
        if not decision or not decision["too_low"]:
            return Decided(answer, tuple(refusals))
        lacking = str(decision["too_low"])
        response, change = _respond(lacking, request, look_again, has_others)
        if not response:
            has_grasp = lacking != "grasp" or float(decision["confidence"]) > 0
            pushed = not may_wait and push(has_grasp)
            response = "postponed" if may_wait else "pushed" if pushed else "left_alone"
        refusals.append(
            Refusal(
                lacking, float(decision["confidence"]), float(decision["threshold"]), response,
                str(decision["refusal"]),
            )
        )  # fmt: skip
        if decision["refusal"]:
            server.report_refusal(refusal=decision["refusal"], response=response)
        if not change:
            return Decided(answer, tuple(refusals))
        request.update(change)


def _respond(
    lacking: str,
    request: Mapping[str, Any],
    look_again: Callable[[], dict[str, Any] | None],
    has_others: Callable[[], bool],
) -> tuple[str, dict[str, Any]]:
    """Return the response to a refusal, empty if nothing helps, and what the next request changes.

    Without a change there is no next request.
    """
    if lacking == "identity" and request.get("unknown") != "grasp":
        look = look_again()
        if look is not None:
            return "second_look", {"looks": [look], "unknown": "grasp"}
        return "new_object", {"unknown": "grasp"}
    if lacking == "pose" and request.get("min_pose") != 0.0:
        return "measured_sides", {"min_pose": 0.0}
    return ("other_grasp" if has_others() else ""), {}
