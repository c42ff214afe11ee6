"""What a robot asks a person about a step, and what it does with the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rtask.rdf.namespaces import PREFIXES, local_name

__all__ = ["ACT", "MAX_REPAIRS", "WHERE", "Reply", "about_acting", "about_place", "read_reply"]

MAX_REPAIRS = 12
"""How often a goal is planned again."""
ACT, WHERE = "act", "where"
"""Kinds of questions: whether to do what is likely to fail, and where a thing is."""
_MAX_PLACES = 17
"""Of those to choose from, so that a page on a phone has all of them."""
_REACHED = f"""{PREFIXES}
SELECT DISTINCT ?place ?name WHERE {{
  ?robot rt:reaches ?place OPTIONAL {{ ?place rt:name ?name }}
}} ORDER BY ?name ?place LIMIT {_MAX_PLACES}"""
_NAME = f"""{PREFIXES}
SELECT ?name WHERE {{ <%s> rt:exemplarOf?/rt:name ?name }} LIMIT 1"""

Query = Callable[[str], Sequence[Mapping[str, Any]]]
Claim = Mapping[str, Any]


def about_acting(claim: Claim) -> dict[str, Any]:
    """Return the question before a step that may fail: fields of ``ask_person``."""
    return {
        "kind": ACT, "retries": MAX_REPAIRS,
        "text": f"{claim['text']}: I expect to fail with a chance of {1 - claim['chance']:.2f}. "
                "What shall I do?",
        "choices": [
            {"code": "go_on", "text": "Try it as you are"},
            {"code": "helped", "text": "I have helped: now try it", "helps": True},
            {"code": "done", "text": "I have done it myself", "helps": True},
            {"code": "leave", "text": "Leave it"},
        ],
    }  # fmt: skip


def about_place(claim: Claim, missing: str, query: Query) -> dict[str, Any]:
    """Return the question where a thing is that the robot does not see: fields of ``ask_person``.

    Without an answer the step fails surely.

    Parameters
    ----------
    missing
        What the robot saw when it looked, in words.
    """
    item = claim["arguments"]["thing"]
    names = query(_NAME % item)
    name = str(names[0]["name"]) if names else local_name(item)
    places = [
        {
            "code": "at", "place": str(row["place"]), "helps": True,
            "text": f"It is at: {row['name'] or local_name(str(row['place']))}",
        }
        for row in query(_REACHED)
    ]  # fmt: skip
    choices = [{"code": "go_on", "text": "I do not know"}, {"code": "gone", "text": "It is gone"}]
    return {
        "kind": WHERE, "chance": 0.0, "choices": [*places, *choices],
        "otherwise": len(places) + 1,
        "text": f"{claim['text']}: {missing}. Where is {name}?",
    }  # fmt: skip


@dataclass(frozen=True)
class Reply:
    """What an answer makes of a step.

    Parameters
    ----------
    does
        go_on: what it would have done without asking; try: act, with a person's help; look: see
        whether it is done; end: end it with what follows.
    result, comment, place, lost
        How the step ends.
    """

    does: Literal["go_on", "try", "look", "end"]
    result: str = ""
    comment: str = ""
    place: str | None = None
    lost: bool = False


def read_reply(claim: Claim) -> Reply:
    """Return what came of the last question about a step; to go on where nobody was asked."""
    answer = claim["answer"]
    if answer is None or not answer["by"]:
        return Reply("go_on")
    by, code = answer["by"], answer["code"]
    if code == "leave":
        return Reply("end", "declined", f"{by} says to leave it")
    if code == "gone":
        return Reply("end", "failed", f"{by} says that it is gone", lost=True)
    if code == "at" and answer["place"] != claim["arguments"].get("place"):
        name = local_name(answer["place"])
        return Reply("end", "released", f"{by} says that it is at {name}", answer["place"])
    if code == "done":
        return Reply("look", comment=f"{by} did it")
    if code == "helped":
        return Reply("try", comment=f"{by} helped")
    return Reply("go_on")
