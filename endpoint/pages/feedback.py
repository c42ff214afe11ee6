"""What came of the latest attempts, and what people say about it: confirm, refuse or correct."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote, urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import require_scope
from endpoint.pages.render import Model, blueprint, context, current_request, page, select
from endpoint.pages.signin import require_form

_ADDRESS = "/feedback"


def list_attempts() -> list[Model]:
    """Return the latest attempts with their pictures and what people said, the newest first."""
    rows = select("attempts")
    for row in rows:
        shots = [line.split("\t") for line in str(row.pop("pictures") or "").splitlines()]
        row["pictures"] = [{"phase": phase, "sha": sha} for phase, sha in shots]
        row["verdicts"] = [
            dict(zip(("time", "by", "held", "reason", "comment"), line.split("\t"), strict=True))
            for line in sorted(str(row.pop("words") or "").splitlines())
        ]
        for verdict in row["verdicts"]:
            verdict["held"] = verdict["held"] == "true"
        row["disputed"] = bool(row["disputed"])
    return rows


@page(_ADDRESS, "feedback.html")
def feedback() -> Model:
    """Two queries: the attempts, and the reasons to choose from."""
    return {
        "attempts": list_attempts(),
        "reasons": [row["code"] for row in select("reasons")],
    }


@blueprint.route(_ADDRESS, methods=["POST"])
def judge() -> WerkzeugResponse:
    """Store a person's verdict and show the list again."""
    caller = context().auth.identify(current_request())
    require_form()
    require_scope(caller.access, "teach")
    form = flask.request.form
    told: dict[str, Any] = {"verdict": form.get("verdict", "")}
    for name in ("task_id", "grasp", "held", "reason", "operator", "comment"):
        if form.get(name, "").strip():
            told[name] = form[name].strip()
    if told["verdict"] != "correct":
        told.pop("held", None)
        told.pop("reason", None)
    answer = context().engine.call("give_feedback", told, caller.access)
    context().audit.event(
        "feedback", attempt=answer["attempt"], verdict=told["verdict"], by=caller.name
    )
    by = f"?{urlencode({'by': told['operator']})}" if "operator" in told else ""
    return flask.redirect(f"{_ADDRESS}{by}#{anchor(answer['attempt'])}", 303)


@blueprint.app_template_filter("anchor")
def anchor(iri: str) -> str:
    """Return the name of an attempt's place on the page.

    >>> anchor("https://example.org/kb/attempt/12")
    'attempt-12'
    """
    return "attempt-" + quote(iri.rsplit("/", 1)[-1], safe="")
