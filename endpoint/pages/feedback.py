"""Outcomes page: the latest attempts with their pictures, and people's verdicts on them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from urllib.parse import quote, urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.activity.words import AFTER
from endpoint.pages.choosing import read_resource
from endpoint.pages.render import (
    PAGE_SIZE,
    Model,
    blueprint,
    context,
    page,
    page_number,
    select,
)
from endpoint.pages.signin import require_form
from rtask.engine.memory.statistics import lower_95
from rtask.engine.operations.feedback import GiveFeedback
from rtask.engine.words import PHASES
from rtask.errors import MissingExtraError, UsageError
from rtask.extras import naming_extras
from rtask.wire.forms import read_form

_ADDRESS = "/feedback"
_FILTERS = {
    "all": "",
    "unjudged": "FILTER NOT EXISTS { ?outcome rt:hasFeedback/a rt:HumanFeedback }",
    "disputed": "?outcome rt:disputed true",
    "failed": "?outcome rt:judgedSuccess false",
}
VISIBLE_REASONS = (
    "missed",
    "slip_lift",
    "slip_hold",
    "slip_transport",
    "pushed_away",
    "touched",
    "drop_outside",
    "wrong_object",
    "hardware",
)
"""What a person can see on the pictures; the keys 1 to 9 choose these."""


def list_attempts(chosen: str = "", most: int = PAGE_SIZE, offset: int = 0) -> list[Model]:
    """Return the latest attempts with their pictures and what people said, the newest first.

    Parameters
    ----------
    chosen
        Pattern about ``?attempt`` and ``?outcome`` that says which.
    most, offset
        At most so many, without so many of the newest.
    """
    pattern = f". {chosen}" if chosen else ""
    rows = select("attempts", chosen=pattern, most=str(most), skipped=str(offset))
    for row in rows:
        shots = [line.split("\t") for line in str(row.pop("pictures") or "").splitlines()]
        row["pictures"] = in_order(shots)
        row["before"], row["after"] = before_and_after(row["pictures"], row["view"])
        row["object_classes"] = ", ".join(sorted((row["object_classes"] or "").split(", ")))
        alpha, beta = row.pop("alpha"), row.pop("beta")
        row["expected"] = alpha / (alpha + beta) if alpha and beta else None
        row["verdicts"] = [
            dict(zip(("time", "by", "held", "reason", "comment"), line.split("\t"), strict=True))
            for line in sorted(str(row.pop("words") or "").splitlines())
        ]
        for verdict in row["verdicts"]:
            verdict["held"] = verdict["held"] == "true"
        row["disputed"] = bool(row["disputed"])
    return rows


def in_order(shots: Iterable[list[str]]) -> list[Model]:
    """Return pictures in the order in which they were taken; the graph has no order.

    Known phases follow each other; others come last, in the order of their numbers.

    Parameters
    ----------
    shots
        Phase, SHA-256 and IRI of each picture.

    Examples
    --------
    >>> shots = [["held", "d", "/4"], ["spun", "e", "/10"], ["up", "c", "/9"], ["closed", "a", ""]]
    >>> [shot["phase"] for shot in in_order(shots)]
    ['closed', 'held', 'up', 'spun']
    """
    phases = list(PHASES)

    def place(shot: list[str]) -> tuple[int, int]:
        phase, _, name = shot
        number = re.search(r"\d+$", name)
        position = phases.index(phase) if phase in PHASES else len(phases)
        return position, int(number.group()) if number else 0

    return [{"phase": phase, "sha": sha} for phase, sha, _ in sorted(shots, key=place)]


def before_and_after(pictures: list[Model], view: str | None) -> tuple[Model | None, Model | None]:
    """Return the two pictures that tell whether a grasp held; none where none was taken.

    Examples
    --------
    >>> shots = [{"phase": name, "sha": name} for name in ("pre_grasp", "closed", "held", "placed")]
    >>> [shot["phase"] for shot in before_and_after(shots, None)]
    ['pre_grasp', 'placed']
    """
    taken = {picture["phase"]: picture for picture in pictures}
    seen = {"phase": "view", "sha": view} if view else None
    after = next((taken[phase] for phase in AFTER if phase in taken), None)
    return taken.get("pre_grasp", seen), after


@page(_ADDRESS, "feedback.html")
def feedback() -> Model:
    """Return the attempts that the address asks for, and the reasons to choose from."""
    asked = flask.request.args
    show = asked.get("show", "all")
    if show not in _FILTERS:
        raise UsageError(f"show={show}: one of {', '.join(_FILTERS)} is expected")
    about = []
    if asked.get("robot"):
        about.append(f"?attempt rt:performedBy {read_resource(asked['robot'])}")
    if asked.get("object"):
        about.append(f"{read_resource(asked['object'])} rt:hasGrasp/rt:triedIn ?attempt")
    if asked.get("grasp"):
        about.append(f"{read_resource(asked['grasp'])} rt:triedIn ?attempt")
    patterns = [_FILTERS[show], *about]
    reasons = [row["code"] for row in select("reasons")]
    number = page_number()
    chosen = " . ".join(filter(None, patterns))
    rows = list_attempts(chosen, PAGE_SIZE + 1, (number - 1) * PAGE_SIZE)
    names = list(dict.fromkeys(row["attempt"] for row in rows))
    return {
        "show_only": show,
        "evidence": _evidence(" . ".join(about)),
        "attempts": [row for row in rows if row["attempt"] in names[:PAGE_SIZE]],
        "page": number,
        "has_more": len(names) > PAGE_SIZE,
        "reasons": [*VISIBLE_REASONS, *(code for code in reasons if code not in VISIBLE_REASONS)],
    }


def _evidence(chosen: str) -> Model:
    """Return what a share of attempts that held rests on: the counts of each robot, and of all.

    Parameters
    ----------
    chosen
        Pattern about ``?attempt`` that says which.
    """
    rows = select("attempts_by_robot", chosen=f". {chosen}" if chosen else "")
    made, attempts, held = (
        sum(int(row[name]) for row in rows) for name in ("made", "attempts", "successes")
    )
    return {
        "robots": [
            {
                "robot": row["robot"],
                "name": row["robot_name"],
                "attempts": int(row["attempts"]),
                "held": int(row["successes"]),
            }
            for row in rows
        ],
        "attempts": attempts,
        "held": held,
        "undecided": made - attempts,
        "share": held / attempts if attempts else None,
        "belief": (held + 1) / (attempts + 2),
        "at_least": _at_least(held, attempts),
    }


def _at_least(held: int, attempts: int) -> float | None:
    """Return the lower 95 % bound of a share; None without the library that computes it."""
    try:
        with naming_extras("pictures"):
            return lower_95(held, attempts)
    except MissingExtraError:
        return None


@blueprint.route(_ADDRESS, methods=["POST"])
def judge() -> WerkzeugResponse:
    """Store a person's verdict and show the list again."""
    caller = require_form("teach")
    fields = read_form(GiveFeedback, dict(flask.request.form.lists()))
    if fields.get("verdict") != "correct":
        fields.pop("held", None)
        fields.pop("reason", None)
    answer = context().engine.call("give_feedback", fields, caller.access)
    context().audit.event(
        "feedback", attempt=answer["attempt"], verdict=fields["verdict"], by=caller.name
    )
    by = f"?{urlencode({'by': fields['operator']})}" if "operator" in fields else ""
    return flask.redirect(f"{_ADDRESS}{by}#{anchor(answer['attempt'])}", 303)


@blueprint.app_template_filter("anchor")
def anchor(iri: str) -> str:
    """Return the fragment of an attempt's place on the page.

    >>> anchor("https://example.org/kb/attempt/12")
    'attempt-12'
    """
    return "attempt-" + quote(iri.rsplit("/", 1)[-1], safe="")
