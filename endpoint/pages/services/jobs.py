"""Pages of jobs: the calls that a person started and comes back to."""

from __future__ import annotations

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.render import application, blueprint, context, current_request, to_flask
from endpoint.pages.services.composed_runs import run_facts
from endpoint.pages.services.results import shown_answer
from endpoint.pages.signin import require_form
from endpoint.routes.addresses import JOBS
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import UnknownTermError
from rtask.services.jobs import Job

__all__: list[str] = []


@blueprint.route(JOBS, methods=["GET"])
def jobs() -> str | WerkzeugResponse:
    """Show the person's jobs; programs get theirs as JSON."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    caller = context().auth.identify(current_request())
    listed = [run_facts(job) for job in context().services.jobs.of(caller.key)]
    return flask.render_template("jobs.html", jobs=listed)


@blueprint.route(f"{JOBS}/<job_id>", methods=["GET"])
def job(job_id: str) -> str | WerkzeugResponse:
    """Show a job with its progress, its log, and its answer or what went wrong."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    job_run = _job(job_id)
    events = [event for _, event in job_run.events(0) if event.get("message")]
    error = job_run.error
    answer = None
    if job_run.state == "succeeded":
        answer = shown_answer(job_run.task.done.result(), dict(job_run.task.request))
    return flask.render_template(
        "job.html",
        job=run_facts(job_run),
        events=events,
        problem=details_of(error) if error else None,
        answer=answer,
    )


@blueprint.route(f"{JOBS}/<job_id>", methods=["POST"])
def job_cancelled(job_id: str) -> WerkzeugResponse:
    """Cancel a job, and show it."""
    job = _job(job_id)
    require_form()
    job.cancel()
    return flask.redirect(f"{JOBS}/{job.id}", 303)


def _job(job_id: str) -> Job:
    caller = context().auth.identify(current_request())
    try:
        return context().services.jobs.find(job_id, caller.key)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"{error}; see {JOBS}") from None
