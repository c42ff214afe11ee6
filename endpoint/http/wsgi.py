"""The Flask application: every address by itself, under any WSGI server.

``rtask serve`` puts an asynchronous front before it that answers programs and robots directly; what
a program sends may as well arrive here, and gets the same answer.
"""

from __future__ import annotations

import difflib
from urllib.parse import urlencode

import flask
from flask import Flask
from werkzeug.exceptions import HTTPException

from endpoint.access.tokens import TokenStore
from endpoint.application import Gateway
from endpoint.config import Config
from endpoint.http.messages import RefusedError, Response
from endpoint.http.problems import problem
from endpoint.pages import blueprint
from endpoint.pages.render import current_request, finish_page, problem_page
from endpoint.pages.signin import OPEN
from endpoint.rosbridge.services import Engine
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import AuthenticationError, RtaskError
from rtask.knowledge_base import KnowledgeBase

_METHODS = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"]
_PROGRAMS = (
    "/sparql",
    "/query",
    "/update",
    "/store",
    "/store/<path:rest>",
    "/engine/<path:rest>",
    "/openapi",
    "/tokens/ticket",
    "/openapi.json",
    "/api/<path:rest>",
    "/health",
    "/health/<path:rest>",
)


def create_app(
    kb: KnowledgeBase,
    engine: Engine,
    tokens: TokenStore,
    config: Config,
    gateway: Gateway | None = None,
) -> Flask:
    """Make the application.

    Parameters
    ----------
    kb
        The knowledge base, open.
    engine
        Behind ``/engine/<operation>``.
    tokens
        Who may do what.
    config
        Settings of the server.
    gateway
        What the front uses already; made here where there is no front.
    """
    app = Flask("endpoint.pages", static_url_path="/static")
    app.jinja_options = {"trim_blocks": True, "lstrip_blocks": True}
    app.json.sort_keys = False  # type: ignore[attr-defined]
    app.url_map.strict_slashes = False
    app.config["MAX_CONTENT_LENGTH"] = config.max_upload_bytes
    gateway = gateway or Gateway(kb, engine, tokens, config)
    app.extensions["rtask"] = gateway

    def programs(rest: str = "") -> flask.Response:
        return to_flask(gateway.handle(current_request()))

    for number, rule in enumerate(_PROGRAMS[1:]):
        app.add_url_rule(
            rule, f"programs{number}", programs, methods=_METHODS, provide_automatic_options=False
        )
    app.register_blueprint(blueprint)
    app.before_request(lambda: _admit(gateway))
    app.after_request(finish_page)
    app.register_error_handler(Exception, _on_error)
    return app


def _admit(gateway: Gateway) -> flask.Response | None:
    """Let programs through to the gateway, which decides itself; check who opens a page."""
    request = current_request()
    at_protocol = flask.request.path.rstrip("/") == "/sparql"
    wants_page = flask.request.method in ("GET", "HEAD") and prefers_html(request.header("accept"))
    if at_protocol and not wants_page:
        return to_flask(gateway.handle(request))
    if _is_open():
        gateway.auth.check_host(request)
    elif at_protocol or _is_page():
        try:
            gateway.count_page(gateway.auth.identify(request))
        except AuthenticationError:
            gateway.count_stranger(request)
            if not wants_page or "authorization" in request.headers:
                raise
            query = f"?{request.query_string}" if request.query_string else ""
            there = urlencode({"next": request.raw_path + query})
            return flask.redirect(f"/login?{there}", 303)  # type: ignore[return-value]
    return None


def _is_open() -> bool:
    """Tell whether the address is for people who have not signed in yet."""
    return flask.request.endpoint in OPEN


def _is_page() -> bool:
    """Tell whether the address belongs to a page; the gateway decides about the others itself."""
    return (flask.request.endpoint or "").startswith("pages.")


def to_flask(response: Response) -> flask.Response:
    """Return one of our responses as Flask's."""
    out = flask.Response(response.body, response.status)
    out.headers.remove("Content-Type")
    for name, value in response.header_list():
        out.headers.add(name, value)
    return out


def _on_error(error: Exception) -> flask.Response:
    """Answer people with a page and programs with problem details; never with a traceback."""
    if isinstance(error, HTTPException):
        code = error.code or 500
        detail = error.description or error.name
        if code == 404:
            detail = f"there is nothing at {flask.request.path}{_nearest_page()}"
        error = RefusedError(code, "not-found" if code == 404 else "usage", detail)
    response = problem(error)
    if prefers_html(flask.request.headers.get("Accept", "")) and not _is_data_address():
        return problem_page(error if isinstance(error, RtaskError) else None, response)
    return to_flask(response)


def _nearest_page() -> str:
    """Return the words that name a page whose address is near to the one asked for."""
    rules = flask.current_app.url_map.iter_rules()
    pages = {rule.rule for rule in rules if "GET" in (rule.methods or ()) and not rule.arguments}
    near = difflib.get_close_matches(flask.request.path, sorted(pages), n=1, cutoff=0.7)
    return f"; did you mean {near[0]}?" if near else ""


def _is_data_address() -> bool:
    return flask.request.path.endswith(".json")
