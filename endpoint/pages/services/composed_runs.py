"""Runs of a composed pipeline: jobs of the service that carries pipelines out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from endpoint.access.auth import Caller
from endpoint.pages.render import Model, context
from endpoint.pages.services.composing import INPUT, Find, Json, is_reference, method_of
from endpoint.pages.services.results import shown_answer
from endpoint.routes.addresses import JOBS
from rtask.errors import UnknownTermError
from rtask.services.call import Invocation
from rtask.services.definition import Definition
from rtask.services.host import MAX_JOB_S
from rtask.services.jobs import ENDED, Job

__all__ = ["results_of", "run_facts", "run_of", "start_run"]

METHOD = "run"
AT_ONCE_S = 2.0
"""A run that takes longer is a job with an address, a bar and a way to cancel it."""
_MAX_SHOWN = 8


def start_run(definition: Definition, request: Json, caller: Caller) -> Job:
    """Start a pipeline and wait a moment for its end.

    Parameters
    ----------
    request
        Of the method ``run``.

    Raises
    ------
    RtaskError
        The pipeline is refused, or failed within that moment.
    """
    services = context().services
    asked = Invocation(definition.exact, METHOD, request, caller.access, None, MAX_JOB_S)
    job = services.start_job(services.prepare(asked), caller.key)
    job.wait(AT_ONCE_S)
    if job.state in ENDED:
        services.jobs.forget(job)  # whoever started it has the answer
        if job.error is not None:
            raise job.error
        job.task.result()
    return job


def run_of(job_id: str, composed: Json, caller: Caller) -> Job | None:
    """Return a caller's run of a pipeline; none if it is forgotten or ran another pipeline."""
    try:
        job = context().services.jobs.find(job_id, caller.key)
    except UnknownTermError:
        return None
    ran = dict(job.task.request).get("steps") or []
    steps = [step.model_dump(exclude_none=True) for step in ran if hasattr(step, "model_dump")]
    return job if job.task.method.name == METHOD and steps == composed["steps"] else None


def run_facts(job: Job) -> Model:
    """Return what the page shows of a run."""
    facts = job.facts()
    return {**facts, "href": f"{JOBS}/{job.id}", "ended": facts["state"] in ENDED}


def results_of(job: Job, composed: Json, find: Find) -> dict[str, Model]:
    """Return the answers of each step of a run that succeeded, as pages show them.

    Raises
    ------
    RtaskError
        The run failed or was cancelled.
    """
    if job.error is not None:
        raise job.error
    ran, inputs = job.task.result(), dict(job.task.request).get("inputs") or {}
    shown: dict[str, Model] = {}
    for step in composed["steps"]:
        value, answer = ran["output"][step["id"]], method_of(step, find).answer
        every = value if "each" in step else [value]
        sent = _sent(step["inputs"], inputs)
        shown[step["id"]] = {
            "answers": [
                shown_answer(answer.model_validate(value), sent) for value in every[:_MAX_SHOWN]
            ],
            "count": len(every),
            "took_ms": ran["took_ms"][step["id"]],
            "size": len(json.dumps(value, ensure_ascii=False, separators=(",", ":"))),
        }
    return shown


def _sent(given: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the inputs of a step, with the values that whoever ran it gave."""
    return {
        name: inputs.get(value[INPUT]) if is_reference(value) and INPUT in value else value
        for name, value in given.items()
    }
