"""Page of a failure: its causes, what would have helped, and a button that tries it."""

from __future__ import annotations

from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import require_scope
from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.render import Model, blueprint, context, current_request, page
from endpoint.pages.services.composed_runs import run_facts
from endpoint.pages.signin import require_form
from rtask.errors import RtaskError, UnknownTermError
from rtask.services.call import Invocation
from rtask.services.host import MAX_JOB_S
from rtask.services.jobs import Job

__all__ = ["why"]

_ADDRESS = "/why"
_SERVICE, _METHOD = "rtask/FailureTrials", "try_changes"


@page(_ADDRESS, "why.html")
def why() -> Model:
    """Return why something failed, and how far the trial of what would have helped is."""
    subject = flask.request.args.get("iri", "").strip()
    if not subject:
        raise RefusedError(400, "usage", "why did what fail? /why?iri=<IRI> of an attempt or task")
    caller = context().auth.identify(current_request())
    require_scope(caller.access, "read")
    model: Model = {"iri": subject, "failure": None, "problem": "", "job": None, "trial": None,
                    "can_try": _can_try(), "events": []}  # fmt: skip
    try:
        answer = context().engine.call("explain_failure", {"subject": subject}, caller.access)
    except RtaskError as error:
        model["problem"] = str(error)
        return model
    model["failure"] = answer.as_json()
    job = _job(flask.request.args.get("job", ""), caller.key)
    if job is not None:
        model["job"] = run_facts(job)
        model["events"] = [event for _, event in job.events(0) if event.get("message")]
        model["trial"] = job.answer()
        model["problem"] = str(details_of(job.error)["detail"]) if job.error else ""
    return model


@blueprint.route(_ADDRESS, methods=["POST"])
def why_tried() -> WerkzeugResponse:
    """Begin to try what would have helped, and show how far it is; the graph stays as it is."""
    caller = require_form("write")
    subject = flask.request.form.get("iri", "").strip()
    services = context().services
    asked = Invocation(_SERVICE, _METHOD, {"subject": subject}, caller.access, timeout_s=MAX_JOB_S)
    job = services.start_job(services.prepare(asked), caller.key)
    return flask.redirect(f"{_ADDRESS}?{urlencode({'iri': subject, 'job': job.id})}#tried", 303)


def _can_try() -> bool:
    """Return whether this server has the simulation."""
    try:
        context().services.registry.find(_SERVICE)
    except UnknownTermError:
        return False
    return True


def _job(job_id: str, key: str) -> Job | None:
    """Return a trial of the caller; None for none, and for one that is no longer kept."""
    try:
        job = context().services.jobs.find(job_id, key) if job_id else None
    except UnknownTermError:
        return None
    return job if job is not None and job.task.method.name == _METHOD else None
