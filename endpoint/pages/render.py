"""Rendering of models as pages and JSON twins, with the headers of every page."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote, urlencode

import flask
from flask import Blueprint

import ontology
from endpoint.activity.words import title
from endpoint.application import Application
from endpoint.context import ServerContext
from endpoint.follow.versions import staleness_headers
from endpoint.http.messages import JSON_TYPE, Request, Response
from endpoint.http.problems import details_of
from endpoint.served import ServedGraph, embedded
from rtask.engine.words import phase_words, reason_words
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import NamedNode
from rtask.sparql.results import Solutions

blueprint = Blueprint("pages", __name__)
Model = dict[str, Any]
PAGE_SIZE = 50
PREFIXES = "".join(f"PREFIX {name}: <{iri}>\n" for name, iri in ontology.PREFIXES.items())
_POLICY = (
    "default-src 'self'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "X-Content-Type-Options": "nosniff",
    # Not no-referrer: our own forms would then be sent with the Origin "null".
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def knowledge_base() -> ServedGraph:
    """Return the knowledge base of the current application."""
    return context().kb


def embedded_graph() -> KnowledgeBase:
    """Return the embedded knowledge base of the current application.

    Raises
    ------
    UnsupportedError
        The graph is stored at another server.
    """
    return embedded(knowledge_base(), "this page")


def application() -> Application:
    """Return the application behind the current page."""
    return cast(Application, flask.current_app.extensions["rtask"])


def context() -> ServerContext:
    """Return the parts of the current server."""
    return application().context


def current_request() -> Request:
    """Convert Flask's current request.

    Most servers keep the path as sent in ``RAW_URI`` or ``REQUEST_URI``; otherwise the decoded path
    is encoded again.
    """
    current = flask.request
    sent = current.environ.get("RAW_URI") or current.environ.get("REQUEST_URI") or ""
    raw_path = sent.split("?")[0] if sent.startswith("/") else quote(current.path, safe="/%:@")
    return Request(
        current.method,
        raw_path,
        current.query_string.decode("latin-1"),
        {name.lower(): value for name, value in current.headers.items()},
        current.get_data(cache=True) if current.method in ("POST", "PUT", "PATCH") else b"",
        context().config.site(current.scheme, current.host),
        current.remote_addr or "",
    )


def to_flask(response: Response) -> flask.Response:
    """Convert a response to Flask's."""
    out = flask.Response(response.body, response.status)
    out.headers.remove("Content-Type")
    for name, value in response.header_list():
        out.headers.add(name, value)
    return out


def finish_page(response: flask.Response) -> flask.Response:
    """Add the headers that keep hostile data harmless, unless a response sets its own."""
    for name, value in _HEADERS.items():
        response.headers.setdefault(name, value)
    if (following := context().following) is not None:
        for name, value in staleness_headers(following):
            response.headers.setdefault(name, value)
    return response


def page(rule: str, template: str, twin: str = "") -> Callable[..., Any]:
    """Register a function that builds a model, served as HTML at `rule` and as JSON at `twin`.

    Parameters
    ----------
    rule
        Address of the page.
    template
        Template whose variables are the members of the model.
    twin
        Address of the JSON twin; by default `rule` plus ``.json``.
    """

    def register(build: Callable[[], Model]) -> Callable[[], Model]:
        data_rule = twin or f"{rule}.json"

        def html() -> str:
            arguments = flask.request.query_string.decode("latin-1")
            alternate = f"{data_rule}?{arguments}" if arguments else data_rule
            return flask.render_template(template, alternate=alternate, **build())

        def data() -> flask.Response:
            model = with_evidence(_without_nan(build()))
            text = json.dumps(model, ensure_ascii=False, default=str)
            return flask.Response(text, content_type=JSON_TYPE)

        blueprint.add_url_rule(rule, build.__name__, html)
        blueprint.add_url_rule(data_rule, f"{build.__name__}_json", data)
        return build

    return register


def _without_nan(value: Any) -> Any:
    """Return a model with null for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {name: _without_nan(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_LEARNT = frozenset({"attempts", "successes", "held", "expected", "confidence", "chance"})
_SUBJECTS = (("grasp", "grasp"), ("robot", "robot"), ("object", "object"), ("iri", "object"))
"""Members that say what counts are about, the narrowest first, with the filter of outcomes: the
object of a robot's row is only the one that it grasped last."""


def with_evidence(model: Any) -> Any:
    """Return a model in which each group of learnt numbers has the address of its evidence.

    That is ``why``: the attempt, the outcomes of a grasp, robot or object, or all outcomes. A group
    that has a member of this name keeps it.

    Examples
    --------
    >>> with_evidence({"robots": [{"robot": "urn:r", "attempts": 2, "successes": 1}]})["robots"]
    [{'robot': 'urn:r', 'attempts': 2, 'successes': 1, 'why': '/feedback?robot=urn%3Ar'}]
    """
    if isinstance(model, list):
        return [with_evidence(item) for item in model]
    if not isinstance(model, dict):
        return model
    entry = {name: with_evidence(item) for name, item in model.items()}
    is_learnt = any(_is_number(entry.get(name)) for name in _LEARNT)
    return {**entry, "why": _evidence(entry)} if is_learnt and "why" not in entry else entry


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _evidence(entry: Mapping[str, Any]) -> str:
    if isinstance(entry.get("attempt"), str):
        return f"/resource?{urlencode({'iri': entry['attempt']})}"
    for name, role in _SUBJECTS:
        if isinstance(entry.get(name), str) and entry[name]:
            return f"/feedback?{urlencode({role: entry[name]})}"
    return "/feedback"


def problem_page(error: RtaskError | None, response: Response) -> flask.Response:
    """Render an error as a page with the details that programs get."""
    details = details_of(error) if error else json.loads(response.body)
    return flask.make_response(flask.render_template("problem.html", **details), response.status)


def page_number() -> int:
    """Return the requested page number of a list, at least 1."""
    return max(1, flask.request.args.get("page", 1, type=int))


@cache
def _query(name: str) -> str:
    text = (Path(__file__).parent / "queries" / f"{name}.rq").read_text(encoding="utf-8")
    return PREFIXES + text


def query_text(name: str) -> str:
    """Return one of the queries in the folder ``queries``, to be shown and run again."""
    return _query(name)


def solutions(
    name: str, *, limit: int | None = None, offset: int = 0, **terms: NamedNode | str
) -> Solutions:
    """Run one of the queries in the folder ``queries``.

    Parameters
    ----------
    name
        File name without its suffix.
    limit, offset
        Rows to return, for queries that do not limit themselves.
    **terms
        Replacements of each ``$name`` in the text: a term, or a pattern built from terms by
        :mod:`endpoint.pages.choosing`.
    """
    text = filled_query(name, **terms)
    if limit is not None:
        text += f"LIMIT {limit:d} OFFSET {offset:d}\n"
    return knowledge_base().select(text)


def filled_query(name: str, **terms: NamedNode | str) -> str:
    """Return a query with its terms, to be shown and run again."""
    return re.sub(r"\$(\w+)", lambda match: str(terms[match.group(1)]), _query(name))


def select_first(name: str, most: int, **terms: NamedNode | str) -> tuple[list[Model], str]:
    """Return at most so many rows of a query, and the query for all if there are more."""
    rows = select(name, limit=most + 1, **terms)
    return rows[:most], filled_query(name, **terms) if len(rows) > most else ""


def select(name: str, **options: Any) -> list[Model]:
    """Return the rows of :func:`solutions` as dictionaries of plain values."""
    return solutions(name, **options).to_dicts()


@blueprint.app_template_filter("short")
def short(iri: str) -> str:
    """Shorten an IRI for people, in a form that every page and command reads.

    That is a prefixed name, with ``kb:`` for the base of the knowledge base.

    Examples
    --------
    >>> short(ontology.NS + "Mug")
    'rt:Mug'
    """
    own = {"kb": knowledge_base().base} if flask.has_app_context() else {}
    for name, start in {**ontology.PREFIXES, **own}.items():
        if start and iri.startswith(start) and len(iri) > len(start):
            return f"{name}:{iri[len(start) :]}"
    return iri


@blueprint.app_template_filter("resource_url")
def resource_url(iri: str) -> str:
    """Return the address of the page about an IRI, which is in the query, never in the path."""
    return f"/resource?{urlencode({'iri': iri})}"


@blueprint.app_template_filter("object_url")
def object_url(iri: str) -> str:
    """Return the address of the page about an object."""
    return f"/object?{urlencode({'iri': iri})}"


@blueprint.app_template_filter("robot_url")
def robot_url(iri: str) -> str:
    """Return the address of the page about a robot."""
    return f"/robot?{urlencode({'iri': iri})}"


@blueprint.app_template_filter("about")
def about(iri: str, address: str) -> str:
    """Return the address of another page about an object."""
    return f"{address}?{urlencode({'iri': iri})}"


@blueprint.app_template_filter("query")
def query(arguments: dict[str, str], address: str) -> str:
    """Return an address with arguments, without the empty ones."""
    return f"{address}?{urlencode({name: value for name, value in arguments.items() if value})}"


@blueprint.app_template_filter("blob_url")
def blob_url(sha256: str) -> str:
    """Return the address of a blob's bytes."""
    return f"/api/blobs/{quote(sha256)}"


@blueprint.app_template_filter("query_url")
def query_url(text: str) -> str:
    """Return the address of the workbench with a query filled in and run."""
    return f"/sparql?{urlencode({'query': text})}"


@blueprint.app_template_filter("percent")
def percent(value: float | None) -> str:
    """Format a share in percent; a dash for none."""
    return "–" if value is None else f"{100 * value:.0f} %"


@blueprint.app_template_filter("moment")
def moment(value: object) -> str:
    """Format a time of the graph for a list: day, month, hour and minute; a dash for none.

    Examples
    --------
    >>> moment("2026-01-02T12:05:59+00:00"), moment(None)
    ('2 Jan 12:05', '–')
    """
    if not value:
        return "–"
    at = datetime.fromisoformat(str(value))
    return f"{at.day} {at:%b %H:%M}"


@blueprint.app_template_filter("when")
def when(value: object) -> str:
    """Format a time of the graph to the second; a dash for none."""
    return str(value)[:19].replace("T", " ") if value else "–"


# Words in place of the codes that robots report.
for _words in (phase_words, reason_words, title):
    blueprint.add_app_template_filter(_words)
