"""Page of plans: a goal in words, the steps with their reasons, and storing them for robots."""

from __future__ import annotations

import contextlib
from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import SCOPES, require_scope
from endpoint.pages.render import (
    PREFIXES,
    Model,
    blueprint,
    context,
    current_request,
    knowledge_base,
    page,
)
from endpoint.pages.signin import require_form
from rtask.engine.operations.tasks.plan import StorePlan
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import RT
from rtask.wire.forms import read_form

__all__ = ["plan"]

_ADDRESS = "/plan"


@page(_ADDRESS, "plan.html")
def plan() -> Model:
    """Return the plan for the goal in the address, or what was wrong with it."""
    given = flask.request.args
    goal = given.get("goal", "").strip()
    assume_reach = bool(given.get("assume_reach"))
    model: Model = {
        "goal": goal, "assume_reach": assume_reach, "plan": None, "problem": "",
        "task": given.get("task", ""), "commit": given.get("commit", ""), "examples": [],
        "has_looked": False, "proposals": [], "reaches": RT.reaches.value,
    }  # fmt: skip
    access = context().auth.identify(current_request()).access
    if goal:
        require_scope(access, "read")
        request = {"goal": goal, "assume_reach": assume_reach}
        try:
            answer = context().engine.call("plan_goal", request, access).as_json()
            model["plan"] = {**answer, "sparql": [PREFIXES + text for text in answer["sparql"]]}
        except RtaskError as error:
            model["problem"] = str(error)
            model["proposals"] = error.details.get("proposals", [])
    kb = knowledge_base()
    if model["plan"] is None and isinstance(kb, KnowledgeBase) and "read" in SCOPES[access.role]:
        with contextlib.suppress(RtaskError):  # the page serves without them, too
            model["examples"], model["has_looked"] = kb.tasks.examples(access), True
    return model


@blueprint.route(_ADDRESS, methods=["POST"])
def plan_stored() -> WerkzeugResponse:
    """Store the plan that a person agreed to, and show it with a way to take it back."""
    caller = require_form("teach")
    fields = read_form(StorePlan, dict(flask.request.form.lists()))
    stored = context().engine.call("store_plan", fields, caller.access)
    context().audit.event("store_plan", task=stored["task"], by=caller.name)
    shown = {"goal": fields["goal"], "task": stored["task"], "commit": stored["commit"]}
    if fields.get("assume_reach"):
        shown["assume_reach"] = "1"
    return flask.redirect(f"{_ADDRESS}?{urlencode(shown)}", 303)
