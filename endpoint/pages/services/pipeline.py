"""Page on which a person composes services into a pipeline and runs it (Kehoe 2014, Fig. 5.4).

The address holds the whole pipeline but files. Every change is a form that leads to another such
address, so that back, reload and a link to somebody else work, without scripts as well.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any
from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import Caller, require_scope
from endpoint.http.problems import details_of
from endpoint.pages.render import Model, blueprint, context, current_request, page
from endpoint.pages.services import composing
from endpoint.pages.services.composed_runs import results_of, run_facts, run_of, start_run
from endpoint.pages.services.composing import INPUT, ITEM, MAX_STEPS, REF, Json, is_reference
from endpoint.pages.services.datasets import readable_datasets
from endpoint.pages.services.snippets import snippets
from endpoint.pages.services.tools import service_named
from endpoint.pages.signin import require_form
from rtask.errors import RtaskError, UsageError
from rtask.services.definition import Definition
from rtask.services.description import ros_service, ros_type
from rtask.services.jobs import ENDED, Job
from rtask.wire.fields import Kind, kind_of
from rtask.wire.fitting import places_in, words_for
from rtask.wire.forms import Control, controls_of, filled_form, read_form

__all__: list[str] = []

_ADDRESS = "/tools/pipeline"
_TEMPLATE = "pipeline.html"
_SERVICE, _RUN, _SAVE, _CANCEL = "rtask/Pipeline", "run", "save", "cancel"
_VALUE, _KEEP, _ASK = "", "kept", INPUT
_MAX_ADDRESS = 30_000
_CONTROL = re.compile(r"add$|json$|save$|s\d+\.|in\.")
"""Controls at which the page says what was wrong."""


@page(_ADDRESS, _TEMPLATE)
def pipeline() -> Model:
    """Return the pipeline in the address, each input with the outputs that may stand for it."""
    given = flask.request.args
    composed = composing.read_pipeline(given.get("pipeline", ""), _find)
    if not given.get("job"):
        return _model(composed)
    caller = context().auth.identify(current_request())
    return _model_of_run(composed, run_of(given["job"], composed, caller))


@blueprint.route(_ADDRESS, methods=["POST"])
def pipeline_sent() -> str | tuple[str, int] | WerkzeugResponse:
    """Change the pipeline as a form asks and lead to its address, or run it and show what came."""
    form = flask.request.form
    caller = require_form()
    composed: Json = {"steps": [], "inputs": {}}
    files: dict[str, Any] = {}
    try:
        composed = composing.read_pipeline(form.get("pipeline", ""), _find)
        if form.get("more"):
            return flask.render_template(_TEMPLATE, **_model(composed, more=form["more"]))
        composed, files = _edited(composed)
        definition, action = service_named(_SERVICE), form.get("do", "")
        if action.startswith(f"{_CANCEL}."):
            job = run_of(action.removeprefix(f"{_CANCEL}."), composed, caller)
            if job is not None:
                job.cancel()
            return flask.redirect(_address(composed, job), 303)
        if action not in (_RUN, _SAVE):
            address = _address(_changed(composed, action))
            if len(address) > _MAX_ADDRESS:
                raise UsageError(
                    "too long for an address: let whoever runs it give the long values",
                    field="json",
                )
            return flask.redirect(address, 303)
        if not composed["steps"]:
            raise UsageError("add a step first", field="add")
        require_scope(caller.access, definition.methods[action].scope)
        if action == _SAVE:
            return flask.redirect(f"/services/{_saved(definition, composed, caller)}", 303)
        job = start_run(definition, _run_request(composed, files), caller)
        if job.state not in ENDED:
            return flask.redirect(_address(composed, job), 303)
        results = results_of(job, composed, _find)
    except RtaskError as error:
        details = details_of(error)
        if not _CONTROL.match(str(details.get("field", ""))):
            details.pop("field", None)  # of a step's own request
        shown = flask.render_template(_TEMPLATE, **_model(composed, problem=details))
        return shown, details["status"]
    return flask.render_template(_TEMPLATE, **_model(composed, results))


def _model_of_run(composed: Json, job: Job | None) -> Model:
    """Return the page of a pipeline with one of its runs, if there still is one."""
    if job is None:
        gone = "this run is no longer kept, or was of another pipeline; run it again"
        return _model(composed, problem={"detail": gone})
    facts = run_facts(job)
    if not facts["ended"]:
        return _model(composed, job=facts)
    try:
        return _model(composed, results_of(job, composed, _find), job=facts)
    except RtaskError as error:
        details = {k: v for k, v in details_of(error).items() if k != "field"}
        return _model(composed, problem=details, job=facts)


def _find(service: str) -> Definition:
    return context().services.registry.find(service)


def _address(composed: Json, job: Job | None = None) -> str:
    text = composing.compact(composed)
    run = {} if job is None else {"job": job.id}
    return f"{_ADDRESS}?{urlencode({'pipeline': text, **run})}" if text else _ADDRESS


def _changed(composed: Json, action: str) -> Json:
    """Carry out what a button says: add, remove.<number>, json, or nothing but the changes."""
    what, _, number = action.partition(".")
    form = flask.request.form
    if what == "add":
        return composing.add_step(composed, form.get("add", ""), _find)
    if what == "remove" and number in map(str, range(len(composed["steps"]))):
        return composing.remove_step(composed, int(number))
    return composing.read_pipeline(form.get("json", ""), _find) if what == "json" else composed


def _edited(composed: Json) -> tuple[Json, dict[str, Any]]:
    """Return a pipeline with what the form says of its steps, and the files for its inputs."""
    form = dict(flask.request.form.lists())
    taken: list[Json] = []
    for number, step in enumerate(composed["steps"]):
        shown = f"s{number}.id" in form
        taken.append(_step_of_form(composed, number, form) if shown else step)
    composed = composing.tidy({**composed, "steps": taken})
    for number, step in enumerate(composed["steps"]):
        name = (form.get(f"s{number}.id") or [step["id"]])[0].strip()
        if name != step["id"]:
            composed = composing.rename_step(composed, number, name)
    sent = {name: file.read() for name, file in flask.request.files.items() if file.filename}
    inputs, files = dict(composed["inputs"]), {}
    for name, (request, field) in composing.asked_of(composed, _find).items():
        path = f"in.{name}."
        value = read_form(request, form, sent, path).get(field)
        if isinstance(value, bytes):
            files[name] = value
        elif value is not None:
            inputs[name] = value
        elif any(key.startswith(path) for key in form):
            inputs.pop(name, None)
    return {**composed, "inputs": inputs}, files


def _step_of_form(composed: Json, number: int, form: Mapping[str, list[str]]) -> Json:
    """Return a step as the form says: from where each input comes, or its value."""
    step = composed["steps"][number]
    request = composing.method_of(step, _find).request
    typed = read_form(request, form, {}, f"s{number}.")
    inputs: Json = {}
    for field in request.model_fields:
        source = (form.get(f"from{number}.{field}") or [_VALUE])[0]
        if source == _KEEP and field in step["inputs"]:
            inputs[field] = step["inputs"][field]
        elif source.startswith(f"{_ASK}."):
            inputs[field] = {INPUT: source.partition(".")[2]}
        elif source not in (_VALUE, _KEEP):
            inputs[field] = {REF: source}
        elif field in typed:
            inputs[field] = typed[field]
    changed: Json = {"id": step["id"], "call": step["call"], "inputs": inputs}
    each = (form.get(f"each{number}") or [""])[0]
    if each:
        changed["each"] = {REF: each}
    else:
        changed["inputs"] = {name: value for name, value in inputs.items() if not _of_item(value)}
    start = f"data{number}."
    data = {name[len(start) :]: values[0].strip() for name, values in form.items()
            if name.startswith(start) and values[0].strip()}  # fmt: skip
    return {**changed, "data": data} if data else changed


def _of_item(value: Any) -> bool:
    path = value.get(REF, "") if isinstance(value, Mapping) else ""
    return isinstance(path, str) and path.partition(".")[0] == ITEM


def _run_request(composed: Json, files: Mapping[str, bytes]) -> Json:
    """Return the request that runs a pipeline.

    Raises
    ------
    UsageError
        Whoever runs it has to give a value, and has not.
    """
    inputs = {**composed["inputs"], **files}
    for name, (request, field) in composing.asked_of(composed, _find).items():
        if name not in inputs:
            (control,) = _controls(request, field, f"in.{name}.", {})
            raise UsageError(f"{name}: needed to run", field=control.name)
    return {**_request(composed), "inputs": inputs}


def _saved(definition: Definition, composed: Json, caller: Caller) -> str:
    """Keep a pipeline as a service, and return its name with its version."""
    form = flask.request.form
    name, version = form.get("save_as", "").strip(), form.get("version", "").strip() or "1.0.0"
    if not name:
        raise UsageError("to keep it, it needs a name, such as lab/NameParts", field="save")
    request = {**_request(composed), "pipeline": name, "version": version}
    given = {"defaults": composed["inputs"]} if composed["inputs"] else {}
    try:
        context().services.call(definition.exact, _SAVE, {**request, **given}, caller.access)
    except RtaskError as error:
        raise type(error)(str(error), **{**error.details, "field": "save"}) from error
    context().audit.event("save pipeline", by=caller.name, pipeline=f"{name}@{version}")
    return f"{name}@{version}"


def _request(composed: Json) -> Json:
    """Return a pipeline as a request that returns the whole answer of each step."""
    output = {step["id"]: {REF: step["id"]} for step in composed["steps"]}
    return {"steps": composed["steps"], "output": output}


def _model(
    composed: Json,
    results: Mapping[str, Model] | None = None,
    problem: Model | None = None,
    more: str = "",
    job: Model | None = None,
) -> Model:
    """Return what the page shows of a pipeline."""
    definition = service_named(_SERVICE)
    method = definition.methods[_RUN]
    asked, compact = composing.asked_of(composed, _find), composing.compact(composed)
    steps: list[Model] = []
    given: dict[str, str] = {}
    for number in range(len(composed["steps"])):
        shown, filled = _step_shown(composed, number, more)
        step_id = shown["id"]
        shown["answers"] = (results or {}).get(step_id)
        shown["problem"] = _problem_of(step_id, problem)
        steps.append(shown)
        given |= filled
    inputs: list[Model] = []
    for name, (request, field) in asked.items():
        inputs += [
            asdict(result)
            for result in _controls(request, field, f"in.{name}.", composed["inputs"], more)
        ]
        value = composed["inputs"].get(name)
        given |= filled_form(request, {field: value}, f"in.{name}.")
    if (more or problem) and flask.request.form:
        given |= flask.request.form.to_dict()
    sample = {name: composed["inputs"].get(name, "...") for name in asked}
    ros = ros_service(definition.name, _RUN), ros_type(definition, method)
    asks = {**_request(composed), **({"inputs": sample} if sample else {})}
    return {
        "service": definition.name,
        "pipeline": compact,
        "text": json.dumps(json.loads(compact), indent=2, ensure_ascii=False) if compact else "",
        "address": _address(composed),
        "job": job,
        "steps": steps,
        "inputs": inputs,
        "given": given,
        "board": composing.board(composed),
        "results": {
            k: {n: v for n, v in result.items() if n != "answers"}
            for k, result in (results or {}).items()
        },
        "methods": _methods(),
        "most": MAX_STEPS,
        "ran": results is not None,
        "problem": problem or {},
        "datasets": readable_datasets(),
        "snippets": snippets(current_request().site, definition.exact, *ros, _RUN, asks, {}),
    }


@blueprint.app_template_filter("place_words")
def place_words(path: str) -> str:
    """Say in words where in the answers of steps a value is.

    Examples
    --------
    >>> place_words("parts.objects.0.cloud"), place_words("item.cloud"), place_words("parts")
    ('parts › objects › first › cloud', 'each › cloud', 'parts')
    """
    start, *rest = path.split(".")
    words = ["first" if part == "0" else part for part in rest]
    return " › ".join(["each" if start == ITEM else start, *words])


def _methods() -> dict[str, list[str]]:
    """Return the names of the methods of each service that a step may call."""
    services = context().services.registry
    names = [str(service["name"]) for service in context().services.listing()]
    return {name: list(services.find(name).methods) for name in names if name != _SERVICE}


def _step_shown(composed: Json, number: int, more: str) -> tuple[Model, dict[str, str]]:
    """Return a step with a port for each input, and what its controls hold."""
    step, before = composed["steps"][number], composed["steps"][:number]
    method, prefix = composing.method_of(step, _find), f"s{number}."
    offered = composing.places(before, _find)
    if "each" in step:
        item = composing.item_kind(step, before, _find)
        if item is not None:
            offered = [*places_in(item, ITEM), *offered]
    values = {name: value for name, value in step["inputs"].items() if not is_reference(value)}
    given = filled_form(method.request, values, prefix)
    asked = composing.asked_of(composed, _find)
    ports: list[Model] = []
    for control in controls_of(method.request, given, more, prefix):
        field = control.name.removeprefix(prefix).partition(".")[0]
        if ports and ports[-1]["field"] == field:  # one more group of the same list
            ports[-1]["controls"].append(asdict(control))
            continue
        kind = kind_of(method.request.model_fields[field])
        source = _source(step["inputs"].get(field), kind)
        fitting = composing.fitting(kind, offered, field)
        inputs = [n for n, (request, f) in asked.items()
                  if kind_of(request.model_fields[f]).type == kind.type]  # fmt: skip
        if not source.startswith(_ASK):
            inputs.append(field if field not in asked else f"{step['id']}_{field}")
        ports.append({
            "field": field, "name": f"from{number}.{field}", "source": source,
            "required": control.is_required, "set": field in step["inputs"],
            "words": words_for(kind), "is_file": kind.type is bytes,
            "offered": fitting if source in fitting or not is_reference(step["inputs"].get(field))
            or source.startswith(_ASK) else [*fitting, source],
            "inputs": inputs,
            "controls": [asdict(control)], "meaning": control.meaning, "absent": control.absent,
        })  # fmt: skip
    definition = _find(str(step["call"]).rpartition("/")[0])
    return {
        "number": number, "id": step["id"], "call": step["call"], "summary": method.summary,
        "href": f"/services/{definition.exact}?{urlencode({'$method': method.name})}",
        "ports": ports,
        "each": step.get("each", {}).get(REF, ""), "lists": composing.lists_before(before, _find),
        "gives": [(path.partition(".")[2], words_for(kind)) for path, kind in
                  places_in(Kind(method.answer), step["id"], 1) if path.count(".") == 1],
        "resources": [
            {"name": name, "summary": need.summary, "default": need.default,
             "value": step.get("data", {}).get(name, "")}
            for name, need in definition.resources.items() if need.type != "graph"
        ],
    }, given  # fmt: skip


def _source(value: Any, kind: Kind) -> str:
    """Return from where an input comes, as its control names it."""
    if not is_reference(value):
        return _KEEP if value is not None and kind.type is bytes else _VALUE
    return f"{_ASK}.{value[INPUT]}" if INPUT in value else str(value[REF])


def _controls(
    request: Any, field: str, path: str, inputs: Mapping[str, Any], more: str = ""
) -> list[Control]:
    """Return the controls of an input that is asked for when the pipeline is run."""
    name = path.removeprefix("in.").removesuffix(".")
    given = filled_form(request, {field: inputs.get(name)}, path)
    controls = controls_of(request, given, more, path)
    return [
        control
        for control in controls
        if control.name.removeprefix(path).partition(".")[0] == field
    ]


def _problem_of(step: str, problem: Model | None) -> str:
    """Return what was wrong if it was wrong at a step."""
    if not problem or problem.get("field"):  # it is said at the field
        return ""
    detail = str(problem["detail"])
    start = f"step {step}: "
    return detail.removeprefix(start) if detail.startswith(start) else ""
