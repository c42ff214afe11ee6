"""What a change is on a branch: the facts that are stated there, and the goal that is planned."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import NamedNode
from rtask.tasks.diagnosis import Diagnosis, beliefs_of
from rtask.tasks.diagnosis.attempt import Failure, Hand
from rtask.tasks.diagnosis.changes import FRACTIONS, Change
from rtask.tasks.diagnosis.hypotheses import HOLDS

__all__ = [
    "Supposition", "goal_of", "stated", "suppositions",
]  # fmt: skip

_ELSEWHERE = "urn:rtask:elsewhere"
_UNTRIED = {
    "recognise": "the lab has no camera, and nothing says as what it would be recognised",
    "ask": "what a person would say is not simulated",
    "earlier": "the lab has no clock",
}
"""Changes that a lab without camera, people and clock cannot show, and why."""


@dataclass(frozen=True)
class Supposition:
    """A change as it is tried.

    Parameters
    ----------
    change
        The changed fact.
    facts
        Statements that make it true on a branch, in Turtle; empty for none.
    along, grasp
        Where hands take the thing, m from its middle, and by which stored grasp.
    looks
        Whether robots look for the thing first, and say where it is.
    clears
        Whether what stands beside it is moved first.
    refusal
        Why it cannot be tried; empty if it can.
    """

    change: Change
    facts: str = ""
    along: float | None = None
    grasp: str = ""
    looks: bool = False
    clears: bool = False
    refusal: str = ""


def suppositions(diagnosis: Diagnosis) -> list[Supposition]:
    """Return the changes of a diagnosis as they are tried, in its order, and that of the place."""
    if diagnosis.change is None:
        return []
    proposed = [diagnosis.change, *diagnosis.others]
    changes = [change for change in proposed if change.kind != "again"]
    place = _other_place(diagnosis.failure)
    return [_supposed(diagnosis.failure, change) for change in [*changes, *place]]


def goal_of(plans: Sequence[Mapping[str, Any]], failure: Failure) -> str:
    """Return the goal that was to be reached: that of the plan, else that a hand holds the thing.

    Parameters
    ----------
    plans
        As ``list_plans`` answers.

    Returns
    -------
    A goal as ``plan_goal`` takes it; empty where nothing says which thing it was.
    """
    for plan in plans:
        if failure.step and any(step["task"] == failure.step for step in plan["steps"]):
            return str(plan["settled"] or plan["goal"])
    if not failure.tried.thing:
        return ""
    where = f"VALUES ?thing {{ {NamedNode(failure.tried.thing)} }} ?robot rt:hasEndEffector ?place"
    return json.dumps({"achieve": "?thing rt:locatedOn ?place", "where": where})


def _supposed(failure: Failure, change: Change) -> Supposition:
    own = failure.tried
    usual = Supposition(change, along=own.along, grasp=own.grasp)
    if change.kind in _UNTRIED:
        return replace(usual, refusal=_UNTRIED[change.kind])
    if change.kind == "grasp":
        return replace(usual, along=change.tried.along, grasp=change.tried.grasp)
    if change.kind == "look":
        return replace(usual, looks=True)
    if change.kind == "clear":
        refusal = "" if failure.neighbours else "the graph knows of nothing beside it"
        return replace(usual, clears=True, refusal=refusal)
    if not own.hand.iri:
        return replace(usual, refusal="the graph does not say which hand failed")
    if change.kind == "place" and failure.origin == own.hand.iri:
        return replace(usual, refusal="it was in the hand already")
    hand = NamedNode(own.hand.iri)
    if change.kind == "hand":
        along = _best_along(failure, change.tried.hand)
        return replace(usual, facts=f"{hand} a rt:OutOfOrder .", grasp="new", along=along)
    return replace(usual, facts=f"{NamedNode(failure.origin)} rt:beyondReachOf {hand} .")


def _best_along(failure: Failure, hand: Hand) -> float | None:
    """Return where another hand would take a thing: where it is believed to hold, near the middle.

    Were it to take it where the first hand did, a heavy thing would be tried at its very end.
    """
    if not failure.length:
        return failure.tried.along
    beliefs = beliefs_of(failure)

    def worth(along: float) -> tuple[float, float]:
        tried = replace(failure.tried, hand=hand, along=along, grasp="new", held=False)
        chance = sum(chance * hypothesis.share(tried) for hypothesis, chance in beliefs)
        return round(chance, 2), -abs(along)

    return max((fraction * failure.length for fraction in FRACTIONS), key=worth)


def _other_place(failure: Failure) -> list[Change]:
    """Return the change that the hand takes the thing at another place, if it has one."""
    own = failure.tried
    if not failure.origin or not own.hand.iri:
        return []
    tried = replace(own, place=_ELSEWHERE, held=False, reason="")
    chance = sum(
        chance * HOLDS * hypothesis.share(tried) for hypothesis, chance in beliefs_of(failure)
    )
    text = (
        f"another place: {own.hand.name} does not take it at {local_name(failure.origin)}, and "
        "it is brought to where it can"
    )
    return [Change("place", 4, text, tried, chance)]


def stated(facts: str) -> str:
    """Return the update that states facts."""
    return f"{PREFIXES} INSERT DATA {{ {facts} }}"
