"""Page of questions: what robots ask, with a picture and the answers to choose from."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import require_scope
from endpoint.pages.render import (
    PAGE_SIZE,
    PREFIXES,
    Model,
    blueprint,
    context,
    current_request,
    knowledge_base,
    page,
)
from endpoint.pages.signin import require_form
from rtask.engine.operations.tasks.questions import AnswerQuestion
from rtask.rdf.terms import NamedNode
from rtask.wire.forms import read_form

__all__ = ["questions"]

_ADDRESS = "/questions"
_VIEWS = """
SELECT ?thing (MIN(?sha) AS ?view) WHERE {
  VALUES ?thing { %s }
  ?thing rt:exemplarOf/rt:hasView/rt:viewContent ?picture .
  ?picture a rt:ColorImage ; rt:hasBlob/rt:sha256 ?sha
} GROUP BY ?thing"""


@page(_ADDRESS, "questions.html")
def questions() -> Model:
    """Return the questions that wait for an answer, and the latest that no longer do."""
    access = context().auth.identify(current_request()).access
    require_scope(access, "read")
    answer = context().engine.call("list_questions", {"state": "all"}, access).as_json()
    listed = [_shown(question) for question in answer["questions"]]
    waiting = [question for question in listed if question["state"] == "open"]
    ended = [question for question in reversed(listed) if question["state"] != "open"]
    views = _views(question["thing"] for question in waiting if not question["picture"])
    for question in waiting:
        question["view"] = views.get(question["thing"], "")
    return {
        "waiting": waiting, "ended": ended[:PAGE_SIZE], "has_more": len(ended) > PAGE_SIZE,
        "helped": answer["helped"], "counted": answer["ended"],
        "commit": flask.request.args.get("commit", ""),
    }  # fmt: skip


@blueprint.route(_ADDRESS, methods=["POST"])
def question_answered() -> WerkzeugResponse:
    """Store the choice of a person, and show what else robots ask."""
    caller = require_form("teach")
    fields = read_form(AnswerQuestion, dict(flask.request.form.lists()))
    stored = context().engine.call("answer_question", fields, caller.access)
    context().audit.event(
        "answer_question", question=fields["question"], choice=fields["choice"], by=caller.name
    )
    shown = {name: value for name, value in
             (("commit", stored["commit"]), ("by", fields.get("operator"))) if value}  # fmt: skip
    return flask.redirect(f"{_ADDRESS}?{urlencode(shown)}" if shown else _ADDRESS, 303)


def _shown(question: Model) -> Model:
    """Return a question with times as the pages write them, and what was chosen in words."""
    made = question["chosen"] or question["otherwise"]
    return {
        **question,
        "asked": dt.datetime.fromtimestamp(question["asked"], dt.UTC),
        "until": dt.datetime.fromtimestamp(question["until"], dt.UTC),
        "made": question["choices"][made - 1]["text"],
    }


def _views(things: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of a picture of the product of each thing, where there is one."""
    nodes = " ".join(str(NamedNode(thing)) for thing in sorted(set(things) - {""}))
    if not nodes:
        return {}
    rows = knowledge_base().select(PREFIXES + _VIEWS % nodes)
    return {str(row.value("thing")): str(row.value("view")) for row in rows}
