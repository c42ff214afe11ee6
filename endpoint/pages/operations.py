"""Pages of the operations: what each one takes, as a form that carries it out."""

from __future__ import annotations

import difflib
import json

import flask

from endpoint.access.auth import require_scope
from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.render import Model, blueprint, context, page
from endpoint.pages.signin import require_form
from endpoint.rosbridge.services import Operation
from rtask.errors import RtaskError
from rtask.wire.forms import controls_of, read_form
from rtask.wire.message import Message

_ADDRESS = "/operations"


@page(_ADDRESS, "operations.html")
def operations() -> Model:
    """Return the operations of the engine, each with what it needs."""
    return {
        "operations": [
            {"name": name, "summary": operation.summary, "scope": operation.scope}
            for name, operation in context().engine.operations.items()
        ]
    }


@blueprint.route(f"{_ADDRESS}/<name>", methods=["GET"])
def operation_form(name: str) -> str:
    """Show the form of an operation, filled in with what the address gives."""
    return _shown(name, _operation_named(name), flask.request.args.to_dict())


@blueprint.route(f"{_ADDRESS}/<name>", methods=["POST"])
def operation_sent(name: str) -> str | tuple[str, int]:
    """Carry out what a form asks for, and show the answer or what was wrong below the form."""
    operation, form = _operation_named(name), flask.request.form
    caller = require_form()
    given = {key: value for key, value in form.items() if key not in ("secret", "more")}
    if form.get("more"):
        return _shown(name, operation, given, more=form["more"])
    require_scope(caller.access, operation.scope)
    try:
        args = read_request(operation.request)
        answer = context().engine.call(name, args, caller.access)
    except RtaskError as error:
        return _shown(name, operation, given, problem=str(error)), details_of(error)["status"]
    if operation.effect != "reads":
        context().audit.event(name, by=caller.name)
    text = json.dumps(answer.as_json(), indent=2, ensure_ascii=False)
    return _shown(name, operation, given, answer=text)


def read_request(model: type[Message]) -> dict[str, object]:
    """Return the request that the form of the current page means; not yet checked."""
    form, files = flask.request.form, flask.request.files
    contents = {name: file.read() for name, file in files.items() if file.filename}
    return read_form(model, dict(form.lists()), contents)


def _operation_named(name: str) -> Operation:
    operations = context().engine.operations
    if name not in operations:
        near = difflib.get_close_matches(name, operations, n=1)
        hint = f"; did you mean {near[0]}?" if near else "; see /operations"
        raise RefusedError(404, "not-found", f"no operation {name}{hint}")
    return operations[name]


def _shown(
    name: str,
    operation: Operation,
    given: dict[str, str],
    more: str = "",
    answer: str = "",
    problem: str = "",
) -> str:
    return flask.render_template(
        "operation.html",
        name=name,
        summary=operation.summary,
        scope=operation.scope,
        controls=controls_of(operation.request, given, more),
        given=given,
        answer=answer,
        problem=problem,
    )
