"""Pages of services: what is offered, and each method as a form with code that does the same."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import flask
from werkzeug.datastructures import MultiDict
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import require_scope
from endpoint.api.services import DATA
from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.operations import read_request
from endpoint.pages.render import application, blueprint, context, current_request, to_flask
from endpoint.pages.services.datasets import readable_datasets
from endpoint.pages.services.results import shown_answer
from endpoint.pages.services.snippets import snippets
from endpoint.pages.signin import require_form
from endpoint.routes.addresses import JOBS, SERVICES
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import RtaskError, UnknownTermError
from rtask.services.call import Invocation
from rtask.services.definition import Definition, Method
from rtask.services.description import ros_service, ros_type
from rtask.services.host import MAX_JOB_S
from rtask.wire.forms import controls_of

_DATA = DATA + "."
_METHOD = "$method"
_TOOLS = {
    "example/Grasping": ("/tools/grasp", "Draw the part in the grasp editor"),
    "example/Kinematics": ("/tools/arm", "Pose an arm by hand"),
    "example/Trajopt": ("/tools/arm", "Plan for an arm that is drawn"),
    "rtask/Pipeline": ("/tools/pipeline", "Compose a pipeline"),
}
"""Pages that do what a service does with a drawing instead of a form."""
_OWN = ("secret", "more", "job", _METHOD)


@blueprint.route(SERVICES, methods=["GET"])
def services() -> str | WerkzeugResponse:
    """Show the services that are offered; programs get the list as JSON."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    return flask.render_template("services.html", services=context().services.listing())


@blueprint.route(f"{SERVICES}/<namespace>/<name>", methods=["GET"])
def service(namespace: str, name: str) -> str | WerkzeugResponse:
    """Show the forms of a service; programs get its description as JSON."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    definition = _definition(f"{namespace}/{name}")
    given = flask.request.args
    chosen = given.get(_METHOD, "")
    if chosen and chosen not in definition.methods:
        raise RefusedError(404, "not-found", f"{definition.exact} has no method {chosen}")
    return _shown(definition, chosen or next(iter(definition.methods)), given)


@blueprint.route(f"{SERVICES}/<namespace>/<name>", methods=["POST"])
def service_sent(namespace: str, name: str) -> str | tuple[str, int] | WerkzeugResponse:
    """Call the method that a form names, and show the answer or what was wrong at its field.

    As a job, it is started, and the page of the job is shown.
    """
    definition, form = _definition(f"{namespace}/{name}"), flask.request.form
    caller = require_form()
    method = definition.methods.get(form.get(_METHOD, ""))
    if method is None:
        raise RefusedError(404, "not-found", f"{definition.exact} has no such method")
    if form.get("more"):
        return _shown(definition, method.name, form, more=form["more"])
    require_scope(caller.access, method.scope)
    args: dict[str, Any] = {}
    try:
        args = read_request(method.request)
        services = context().services
        as_job = "job" in form
        asked = Invocation(
            definition.exact, method.name, args, caller.access, _datasets(form),
            MAX_JOB_S if as_job else None,
        )  # fmt: skip
        task = services.prepare(asked)
        if as_job:
            return flask.redirect(f"{JOBS}/{services.start_job(task, caller.key).id}", 303)
        services.start(task)
        answer = task.result()
    except RtaskError as error:
        details = details_of(error)
        return _shown(definition, method.name, form, args=args, problem=details), details["status"]
    if method.effect != "reads":
        context().audit.event(f"{definition.exact}/{method.name}", by=caller.name)
    shown = {
        **shown_answer(answer, dict(task.request)),
        "service": task.service,
        "queued_ms": task.queued_ms,
        "run_ms": task.run_ms,
    }
    return _shown(definition, method.name, form, args=args, answer=shown)


def _definition(name: str) -> Definition:
    try:
        return context().services.registry.find(name)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"{error}; see {SERVICES}") from None


def _datasets(form: Mapping[str, str]) -> dict[str, str]:
    """Return the datasets that a form chooses for data resources."""
    return {
        key.removeprefix(_DATA): value.strip()
        for key, value in form.items()
        if key.startswith(_DATA) and value.strip()
    }


def _shown(
    definition: Definition,
    name: str,
    given: MultiDict[str, str],
    more: str = "",
    args: dict[str, Any] | None = None,
    answer: dict[str, Any] | None = None,
    problem: dict[str, Any] | None = None,
) -> str:
    method = definition.methods[name]
    values = {key: value for key, value in given.items() if key not in _OWN}
    site = current_request().site
    return flask.render_template(
        "service.html",
        service=definition,
        tool=_TOOLS.get(definition.name),
        method=method,
        ros=(ros_service(definition.name, method.name), ros_type(definition, method)),
        controls=controls_of(method.request, values, more),
        resources={n: r for n, r in definition.resources.items() if r.type != "graph"},
        given=values,
        answer=answer,
        datasets=readable_datasets(),
        problem=problem or {},
        snippets=snippets(site, definition.exact, ros_service(definition.name, method.name),
                          ros_type(definition, method), method.name,
                          _sample(method, args), _datasets(values)),
    )  # fmt: skip


def _sample(method: Method, args: dict[str, Any] | None) -> dict[str, Any]:
    """Return what the code beside the form sends: what was sent, else the required fields."""
    if args:
        return args
    required = [n for n, field in method.request.model_fields.items() if field.is_required()]
    return dict.fromkeys(required, "...")
