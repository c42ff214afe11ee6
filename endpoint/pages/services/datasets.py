"""Pages of datasets: what there is, its versions and files, and what is done with them by forms."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import Caller
from endpoint.http.messages import RefusedError
from endpoint.http.problems import details_of
from endpoint.pages.render import Model, application, blueprint, context, current_request, to_flask
from endpoint.pages.signin import require_form
from endpoint.routes.addresses import DATASETS
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import ConflictError, RtaskError, UnknownTermError, UsageError
from rtask.services.datasets.store import Datasets

__all__ = ["readable_datasets"]

_Page = str | tuple[str, int] | WerkzeugResponse
_RULE = "rule."


def readable_datasets() -> list[str]:
    """Return the names of the datasets that the person who sees the page may read, sorted."""
    return _datasets().names(_caller().access)


@blueprint.route(DATASETS, methods=["GET"])
def datasets() -> str | WerkzeugResponse:
    """Show the datasets that the person may read; programs get their names as JSON."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    return _listed({})


@blueprint.route(DATASETS, methods=["POST"])
def datasets_sent() -> _Page:
    """Create a dataset, and show it."""
    form, caller = flask.request.form, require_form("write")
    name = form.get("name", "").strip()
    readers = form.get("readers", "").split() or None
    try:
        _datasets().create(name, caller.access, readers)
    except RtaskError as error:
        return _listed(details_of(error)), details_of(error)["status"]
    context().audit.event("create dataset", by=caller.name, dataset=name)
    return flask.redirect(f"{DATASETS}/{name}", 303)


@blueprint.route(f"{DATASETS}/<namespace>/<name>", methods=["GET"])
def dataset(namespace: str, name: str) -> str | WerkzeugResponse:
    """Show a version of a dataset; programs get it as JSON."""
    if not prefers_html(current_request().header("accept")):
        return to_flask(application().handle(current_request()))
    return _shown(f"{namespace}/{name}", {})


@blueprint.route(f"{DATASETS}/<namespace>/<name>", methods=["POST"])
def dataset_sent(namespace: str, name: str) -> _Page:
    """Do with a dataset what a form asks for, and show what came of it or what was wrong."""
    form, caller = flask.request.form, require_form("write")
    plain = f"{namespace}/{name.partition('@')[0]}"
    action = form.get("do", "")
    if action not in _ACTIONS:
        raise RefusedError(404, "not-found", f"nothing here does {action[:40]!r}")
    try:
        there = _ACTIONS[action](plain, caller)
    except UnknownTermError as error:
        return _shown(plain, {"detail": str(error)}), 404
    except RtaskError as error:
        details = details_of(error)
        if isinstance(error, ConflictError):
            details["source"] = form.get("source", "")
        return _shown(plain, details), details["status"]
    context().audit.event(f"{action} dataset", by=caller.name, dataset=plain)
    return flask.redirect(f"{DATASETS}/{there}", 303)


def _upload(name: str, caller: Caller) -> str:
    sent = [file for file in flask.request.files.getlist("files") if file.filename]
    if not sent:
        raise UsageError("files: choose one or more", field="files")
    folder = flask.request.form.get("folder", "").strip().strip("/")
    contents = {f"{folder}/{file.filename}".lstrip("/"): file.read() for file in sent}
    _datasets().put(name, contents, caller.access)
    return f"{name}@head"


def _remove(name: str, caller: Caller) -> str:
    _datasets().remove(name, [flask.request.form.get("path", "")], caller.access)
    return f"{name}@head"


def _snapshot(name: str, caller: Caller) -> str:
    made = _datasets().snapshot(name, flask.request.form.get("message", ""), caller.access)
    return made.name


def _fork(name: str, caller: Caller) -> str:
    made = flask.request.form.get("name", "").strip()
    _datasets().fork(made, flask.request.form.get("version", name), caller.access)
    return made


def _merge(name: str, caller: Caller) -> str:
    form = flask.request.form
    rules: Any = {
        key.removeprefix(_RULE): value
        for key, value in form.items()
        if key.startswith(_RULE) and value in ("ours", "theirs")
    }
    source = form.get("source", "").strip()
    return _datasets().merge(name, source, rules, form.get("message", ""), caller.access).name


_ACTIONS: dict[str, Callable[[str, Caller], str]] = {
    "upload": _upload,
    "remove": _remove,
    "snapshot": _snapshot,
    "fork": _fork,
    "merge": _merge,
}
"""What forms do; each returns the dataset or version to show."""


def _datasets() -> Datasets:
    return context().services.datasets


def _caller() -> Caller:
    return context().auth.identify(current_request())


def _listed(problem: Model) -> str:
    store, access = _datasets(), _caller().access
    rows = []
    for name in readable_datasets():
        newest = store.find(name, access)
        rows.append({**_facts(newest.facts()), "dataset": name, "versions": store.numbers(name)})
    given = flask.request.form if problem else {}
    return flask.render_template("datasets.html", datasets=rows, problem=problem, given=given)


def _shown(name: str, problem: Model) -> str:
    store, access = _datasets(), _caller().access
    try:
        version = store.find(name, access)
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"{error}; see {DATASETS}") from None
    numbers = store.numbers(version.dataset)
    versions = [
        _facts(store.find(f"{version.dataset}@{number}", access).facts()) for number in numbers
    ]
    before, after = (flask.request.args.get(side, "") for side in ("from", "to"))
    diff: dict[str, list[str]] | None = None
    if before and after and not problem:
        old, new = (f"{version.dataset}@{side}" for side in (before, after))
        try:
            diff = store.difference(old, new, access)
        except UnknownTermError as error:
            raise RefusedError(404, "not-found", str(error)) from None
    return flask.render_template(
        "dataset.html",
        dataset=version.dataset,
        version=_facts(version.facts()),
        versions=versions[::-1],
        diff=diff,
        compared=(before, after),
        others=[side for side in readable_datasets() if side != version.dataset],
        problem=problem,
        given=flask.request.form if problem else {},
    )


def _facts(dataset: Model) -> Model:
    """Return what a page shows of a version: its time in words, and where its files are."""
    address = f"{DATASETS}/{dataset['name']}"
    made = datetime.fromtimestamp(dataset["time"], UTC).isoformat() if dataset["time"] else ""
    files = {
        path: {"sha256": sha256, "bytes": size, "href": f"{address}/files/{quote(path)}"}
        for path, (sha256, size) in dataset["files"].items()
    }
    return {**dataset, "time": made, "href": address, "files": files}
