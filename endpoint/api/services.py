"""Services over HTTP: lists and descriptions, calls, and jobs (Kehoe 2014, 5.6).

::

    GET  /services                               the services
    GET  /services/<ns>/<name>[@version]         description with the schemas of its methods
    POST /services/<ns>/<name>[@version]/<method>    call; with Prefer: respond-async, a job
    GET  /jobs, /jobs/<id>[?wait=s][&after=n]    the caller's jobs; one with its answer, its events,
                                                 which Accept: text/event-stream follows
    DELETE /jobs/<id>                            cancel

Calls and their answers are JSON, or CBOR where Content-Type and Accept say so; calls may be forms
as well (multipart/form-data), with files as bytes or, ending in .npy, as arrays.
Data resources are named by ``?data=robot:robots/NAO`` or the member ``$data`` of the body.
"""

from __future__ import annotations

import json
import math
from concurrent.futures import Future
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.access.rights import authorise
from endpoint.api.operations import json_object
from endpoint.http.form_data import FORM_DATA_TYPE, FormPart, array_from_npy, form_parts
from endpoint.http.messages import (
    CBOR_TYPE,
    JSON_TYPE,
    RefusedError,
    Request,
    Response,
    json_response,
)
from endpoint.http.plan import Elsewhere, Plan
from endpoint.http.problems import details_of
from endpoint.routes.addresses import JOBS, SERVICES
from rtask.errors import UnknownTermError, UsageError
from rtask.services import ServiceHost
from rtask.services.call import Invocation
from rtask.services.host import MAX_JOB_S, MAX_TIMEOUT_S
from rtask.services.jobs import Job
from rtask.services.outward.frames import pack, packed, unpack
from rtask.services.task import Task
from rtask.wire.message import strict_json

DATA = "$data"
MAX_WAIT_S = 60.0
_MAX_DIGITS = 15
_STORED_S = 5.0


def plan_service(
    host: ServiceHost, auth: Authenticator, request: Request, caller: Caller, address: str
) -> Plan:
    """Prepare the answer to a request about services or jobs.

    Raises
    ------
    RefusedError
        404 with the nearest name, 415.
    UsageError
        The request does not fit the method.
    QueueFullError
        Too many calls wait.
    """
    try:
        if address == JOBS or address.startswith(f"{JOBS}/"):
            return _plan_jobs(host, auth, request, caller, address.removeprefix(JOBS).strip("/"))
        if address == SERVICES:
            return Plan(lambda: json_response({"services": host.listing()}))
        parts = address.removeprefix(f"{SERVICES}/").split("/")
        if len(parts) == 2:
            service = host.registry.find("/".join(parts))
            return Plan(lambda: json_response(host.description(service.exact)))
        if len(parts) != 3:
            raise UnknownTermError(f"there is nothing at {address}; see {SERVICES}")
        return _plan_call(host, auth, request, caller, "/".join(parts[:2]), parts[2])
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", str(error)) from None


def _plan_call(
    host: ServiceHost, auth: Authenticator, request: Request, caller: Caller, name: str, method: str
) -> Plan:
    definition, target = host.find(name, method)
    authorise(auth, request, caller, target.scope, f"{definition.name}/{method}")
    args = _arguments(request)
    data = _data(request, args.pop(DATA, None))
    is_job = "respond-async" in request.header("prefer")
    timeout_s = _seconds(request, "timeout", MAX_JOB_S if is_job else MAX_TIMEOUT_S)
    if is_job and timeout_s is None:
        timeout_s = MAX_JOB_S
    asked = Invocation(name, method, args, caller.access, data, timeout_s, data_form=DATA)
    task = host.prepare(asked)
    if is_job:
        return Plan(lambda: _accepted(host.start_job(task, caller.key)), lane="loop")

    def start() -> Future[Any]:
        host.start(task)
        return task.done

    return Plan(
        lambda: _answer(task, CBOR_TYPE in request.header("accept")),
        timeout_s=task.call.timeout_s,
        elsewhere=Elsewhere(start, task.expire, task.cancel),
    )


def _arguments(request: Request) -> dict[str, Any]:
    """Return the request of a call from JSON, CBOR or a form.

    Raises
    ------
    RefusedError, UsageError
        The body cannot be read.
    """
    media_type = request.content_type[0]
    if media_type == CBOR_TYPE:
        return unpack(request.body)
    if media_type != FORM_DATA_TYPE:
        return json_object(request)
    args: dict[str, Any] = {}
    for part in form_parts(request):
        if not part.name or part.name in args:
            raise UsageError("each part of the form is a field of its own name", field=part.name)
        args[part.name] = _field(part)
    return args


def _field(part: FormPart) -> Any:
    """Return the value of a part: a file's array or bytes, JSON, or else text."""
    if part.filename.lower().endswith(".npy"):
        array = array_from_npy(part.data)
        if array is None:
            words = f"{part.name}: {part.filename[:80]} is no array of numbers"
            raise UsageError(words, field=part.name)
        return array
    if part.filename:
        return part.data
    try:
        text = part.data.decode("utf-8")
    except UnicodeDecodeError:
        raise UsageError(f"{part.name}: the text is not UTF-8", field=part.name) from None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


def _answer(task: Task, is_binary: bool) -> Response:
    """Return the response to a call that has ended."""
    answer = task.result()
    body = pack(packed(answer)) if is_binary else answer.to_json()
    timing = f"queue;dur={task.queued_ms:.3f}, run;dur={task.run_ms:.3f}"
    headers = (
        ("RTASK-Service", task.service),
        ("RTASK-Call", task.call.id),
        ("Server-Timing", timing),
    )
    return Response(200, body, CBOR_TYPE if is_binary else JSON_TYPE, headers)


def _accepted(job: Job) -> Response:
    place = f"{JOBS}/{job.id}"
    headers = (("Location", place), ("Preference-Applied", "respond-async"))
    return Response(202, strict_json({**job.facts(), "href": place}), JSON_TYPE, headers)


def _plan_jobs(
    host: ServiceHost, auth: Authenticator, request: Request, caller: Caller, job_id: str
) -> Plan:
    if not job_id:
        return Plan(
            lambda: json_response({"jobs": [job.facts() for job in host.jobs.of(caller.key)]})
        )
    job = host.jobs.find(job_id, caller.key)
    if request.method == "DELETE":
        return Plan(lambda: _cancelled(job))
    wait_s = _seconds(request, "wait", MAX_WAIT_S)
    after = event_number(request) if request.values("after") else None
    if not wait_s:
        return Plan(lambda: _job(job, after))
    return Plan(
        lambda: _job(job, after),
        timeout_s=wait_s,
        elsewhere=Elsewhere(lambda: job.task.done, None, _nothing),
    )


def _nothing() -> None:
    """Let a job go on when the caller that waits for it leaves."""


def _cancelled(job: Job) -> Response:
    job.cancel()
    job.wait(_STORED_S)  # one that is being stored at this moment ends by itself
    return _job(job)


def _job(job: Job, after: int | None = None) -> Response:
    """Return a job with its answer or its problem, and its events after a number."""
    facts = job_facts(job)
    if after is not None:
        facts["events"] = [{"number": number, **event} for number, event in job.events(after)]
    return json_response(facts)


def job_facts(job: Job) -> dict[str, Any]:
    """Return a job with its answer or its problem, as JSON data."""
    facts = job.facts()
    error = job.error
    if error is not None:
        facts["problem"] = details_of(error)
    answer = job.answer()
    if answer is not None:
        facts["answer"] = answer
    return facts


def _data(request: Request, in_body: Any) -> dict[str, str]:
    """Return the datasets that a call names.

    Raises
    ------
    UsageError
        ``?data`` or ``$data`` cannot be read.
    """
    if in_body is not None and not (
        isinstance(in_body, dict) and all(isinstance(name, str) for name in in_body.values())
    ):
        raise UsageError(f'{DATA}: expected {{"resource": "<namespace>/<name>"}}', field=DATA)
    files: dict[str, str] = dict(in_body or {})
    for text in request.values("data"):
        name, colon, dataset = text.partition(":")
        if not (name and colon and dataset):
            raise UsageError(f"data={text}: expected data=<resource>:<namespace>/<name>")
        files[name] = dataset
    return files


def _seconds(request: Request, name: str, most: float) -> float | None:
    texts = request.values(name)
    if not texts:
        return None
    try:
        seconds = float(texts[-1])
    except ValueError:
        seconds = math.nan
    if not seconds >= 0:
        raise UsageError(f"{name}={texts[-1]}: expected a number of seconds", field=name)
    return min(seconds, most)


def event_number(request: Request) -> int:
    """Return the number of the last event that a follower of a job has received, 0 for none.

    Raises
    ------
    UsageError
        ``after``, or ``Last-Event-ID``, is no number.
    """
    texts = request.values("after")
    text = request.header("last-event-id").strip() or (texts[-1] if texts else "0")
    if not (text.isdecimal() and len(text) <= _MAX_DIGITS):
        raise UsageError(f"after={text[:40]}: expected a whole number", field="after")
    return int(text)
