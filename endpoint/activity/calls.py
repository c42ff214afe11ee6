"""Calls of the engine's operations as events for people."""

from __future__ import annotations

from typing import Any

from endpoint.activity.log import ANONYMOUS, Event
from rtask.engine.engine import Call

__all__ = ["call_event"]

_ASKED = {
    "recognise_for_grasp": "asks what it sees and how to grasp it",
    "search_object": "asks what it sees",
    "recall_grasps": "asks how an object was grasped before",
    "recall_motions": "asks how others moved",
    "resolve_entities": "asks what fits a description",
    "plan_in_space": "asks for grasps in space",
    "reconstruct_mesh": "asks for the surface of an object",
    "plan_grasps": "asks for push grasps of a part",
    "insert_object": "tells about an object",
    "report_outcome": "reports an outcome",
    "report_refusal": "tells what it did instead of a grasp",
    "register_robot": "introduces itself",
    "teach_object": "names an object",
    "give_feedback": "judges an attempt",
    "curate_object": "corrects an object",
}


def call_event(call: Call) -> Event:
    """Return a call, when it begins and when it ends, as an event.

    Parameters
    ----------
    call
        With an answer or an error at its end, without either at its beginning.
    """
    who = call.access.agent or ANONYMOUS
    service = f"/rtask/{call.operation}"
    asked = _ASKED.get(call.operation, f"calls {call.operation}")
    if call.error is not None:
        # It may repeat what the robot sent, which pages could not show if it is no Unicode.
        reason = str(call.error).encode(errors="replace").decode()
        return Event("refused", who, f"was refused: {reason}", asked, service)
    if call.answer is None:
        return Event("asks", who, asked, service=service)
    if call.operation == "recognise_for_grasp":
        return _met(who, service, call.answer)
    return Event("answered", who, f"has its answer ({asked})", service=service)


def _met(who: str, service: str, answer: Any) -> Event:
    """Return what a robot was told about the thing that it sees."""
    matches = answer.recognition.get("matches") or []
    if answer.object:
        name = answer.label or answer.class_ or "a known object"
        words = f"sees {name}, recognised with confidence {answer.confidence:.2f}"
    elif matches:
        words = f"sees something new (best match {float(matches[0]['confidence']):.2f})"
    else:
        words = "sees something new"
    return Event("met", who, words, _first_choice(answer.grasps), service, answer.object)


def _first_choice(grasps: list[Any]) -> str:
    """Return the first of the grasps on offer, and why it is the first."""
    if not grasps:
        return "no grasp is on offer"
    best = grasps[0]
    origin = {"memory": "remembered", "candidate": "proposed from its shape"}.get(
        best.source, best.source
    )
    number = f"first of {len(grasps)} grasps" if len(grasps) > 1 else "the only grasp"
    reasons = best.explanation.get("text", "") if isinstance(best.explanation, dict) else ""
    return f"{number}, {origin}: {reasons}".rstrip(": ")
