"""The Flask application: all addresses except websockets, under any WSGI server.

``rtask serve`` runs it behind the ASGI application, which answers programs and robots itself. A
program's request that arrives here gets the same answer.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from functools import cache, partial
from typing import Any
from urllib.parse import urlencode

import flask
from flask import Flask
from werkzeug.exceptions import HTTPException
from werkzeug.routing import Rule

from endpoint.application import Application
from endpoint.http.messages import RefusedError
from endpoint.http.problems import problem
from endpoint.pages import blueprint
from endpoint.pages.render import current_request, finish_page, problem_page, to_flask
from endpoint.pages.signin import OPEN
from endpoint.routes import ROUTES
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import AuthenticationError, RtaskError
from rtask.extras import missing_extra

_METHODS = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"]
_OTHERS = ("service", "dataset")
"""Handlers whose addresses are pages under a WSGI server; their programs need ASGI."""

_SHARED = frozenset(
    route.pattern for route in ROUTES if route.pages and route.handler not in _OTHERS
)
"""Addresses that are pages for people, and answer programs here too."""

_PROGRAMS = tuple(
    dict.fromkeys(
        route.pattern
        for route in ROUTES
        if route.lane != "stream" and route.handler not in _OTHERS and route.pattern not in _SHARED
    )
)


class _Rule(Rule):
    """A rule that learns to build its address when it first has to.

    Werkzeug compiles two functions for each rule, a quarter of the time that a server takes to
    start; pages build the addresses of few rules, and by name.
    """

    def _compile_builder(self, append_unknown: bool = True) -> Callable[..., tuple[str, str]]:
        compiled = cache(partial(super()._compile_builder, append_unknown))

        def build(rule: Rule, **values: Any) -> tuple[str, str]:
            return compiled()(rule, **values)

        return build


class _Application(Flask):
    url_rule_class = _Rule


def create_app(application: Application) -> Flask:
    """Make the Flask application.

    Parameters
    ----------
    application
        Answers programs; its context serves the pages too.
    """
    app = _Application("endpoint.pages", static_url_path="/static")
    app.jinja_options = {"trim_blocks": True, "lstrip_blocks": True}
    app.json.sort_keys = False  # type: ignore[attr-defined]
    app.url_map.strict_slashes = False
    app.config["MAX_CONTENT_LENGTH"] = application.context.config.max_upload_bytes
    app.extensions["rtask"] = application

    def programs(**parts: str) -> flask.Response:
        return to_flask(application.handle(current_request()))

    for number, rule in enumerate(_PROGRAMS):
        app.add_url_rule(
            rule, f"programs{number}", programs, methods=_METHODS, provide_automatic_options=False
        )
    app.register_blueprint(blueprint)
    app.before_request(lambda: _admit(application))
    app.after_request(finish_page)
    app.register_error_handler(Exception, _on_error)
    return app


def _admit(application: Application) -> flask.Response | None:
    """Pass programs on to the application, and check who opens a page."""
    context = application.context
    request = current_request()
    at_protocol = flask.request.path.rstrip("/") in _SHARED
    wants_page = flask.request.method in ("GET", "HEAD") and prefers_html(request.header("accept"))
    if at_protocol and not wants_page:
        return to_flask(application.handle(request))
    if _is_open():
        context.auth.check_host(request)
    elif at_protocol or _is_page():
        try:
            # A page counts against the same allowance as a request of a program.
            context.limiter.admit(context.auth.identify(request))()
        except AuthenticationError:
            context.limiter.admit_stranger(request.client)
            if not wants_page or "authorization" in request.headers:
                raise
            query = f"?{request.query_string}" if request.query_string else ""
            there = urlencode({"next": request.raw_path + query})
            return flask.redirect(f"/login?{there}", 303)  # type: ignore[return-value]
    return None


def _is_open() -> bool:
    """Tell whether the address is open to people who have not signed in."""
    return flask.request.endpoint in OPEN


def _is_page() -> bool:
    """Tell whether the address belongs to a page; the application checks the others itself."""
    return (flask.request.endpoint or "").startswith("pages.")


def _on_error(error: Exception) -> flask.Response:
    """Answer people with a page and programs with problem details, never with a traceback."""
    if isinstance(error, HTTPException):
        code = error.code or 500
        detail = error.description or error.name
        if code == 404:
            detail = f"there is nothing at {flask.request.path}{_nearest_page()}"
        methods = getattr(error, "valid_methods", None) or ()
        allow = (("Allow", ", ".join(sorted(methods))),) if methods else ()
        error = RefusedError(code, "not-found" if code == 404 else "usage", detail, allow)
    if isinstance(error, ModuleNotFoundError):
        error = missing_extra(error, f"the page {flask.request.path}") or error
    response = problem(error)
    if prefers_html(flask.request.headers.get("Accept", "")) and not _is_data_address():
        return problem_page(error if isinstance(error, RtaskError) else None, response)
    return to_flask(response)


def _nearest_page() -> str:
    """Return a hint that names the page with the most similar address; empty if none is."""
    rules = flask.current_app.url_map.iter_rules()
    pages = {rule.rule for rule in rules if "GET" in (rule.methods or ()) and not rule.arguments}
    near = difflib.get_close_matches(flask.request.path, sorted(pages), n=1, cutoff=0.7)
    return f"; did you mean {near[0]}?" if near else ""


def _is_data_address() -> bool:
    return flask.request.path.endswith(".json")
