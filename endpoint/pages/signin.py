"""Sign-in of people: a token in exchange for a session cookie."""

from __future__ import annotations

from urllib.parse import urlsplit

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.access.auth import SCOPES, Caller, require_scope
from endpoint.access.sessions import session_name, set_cookie
from endpoint.pages.render import blueprint, context, current_request
from rtask.errors import AccessError, AuthenticationError, ForbiddenError
from rtask.kb.commit.access import Access

# Addresses for people who have not signed in.
OPEN = ("pages.login", "pages.sign_in", "static")
_START = "/"


@blueprint.route("/login", methods=["GET"])
def login() -> str:
    """Show the sign-in form."""
    return flask.render_template("login.html", next=_local(flask.request.args.get("next", "")))


@blueprint.route("/login", methods=["POST"])
def sign_in() -> WerkzeugResponse | tuple[str, int]:
    """Start a session by a token."""
    request = current_request()
    server = context()
    server.auth.check_origin(request)
    there = _local(flask.request.form.get("next", ""))
    try:
        token = server.tokens.authenticate(flask.request.form.get("token", "").strip())
    except AuthenticationError as error:
        server.limiter.admit_stranger(request.client)
        server.request_log.denied(request, None, 401, f"sign-in: {error}")
        return flask.render_template("login.html", next=there, problem=str(error)), 401
    server.audit.event("sign-in", token=token.id, agent=token.agent, client=request.client)
    answer = flask.redirect(there, 303)
    secure = request.site.startswith("https:")
    answer.headers.add(
        "Set-Cookie", set_cookie(server.auth.sessions.begin(token.id), secure=secure)
    )
    return answer


@blueprint.route("/logout", methods=["POST"])
def sign_out() -> WerkzeugResponse:
    """End the session."""
    require_form()
    request = current_request()
    context().auth.sessions.end(session_name(request.header("cookie")))
    answer = flask.redirect("/login", 303)
    secure = request.site.startswith("https:")
    answer.headers.add("Set-Cookie", set_cookie("", secure=secure))
    return answer


def require_form(scope: str = "") -> Caller:
    """Return the person who sent a form that one of our pages made for this session.

    Parameters
    ----------
    scope
        Needed to do what the form asks for; empty where that is found out later.

    Raises
    ------
    ForbiddenError
        The Origin is foreign, the form's secret is not the session's, or the role lacks the scope.
    """
    request = current_request()
    auth = context().auth
    caller = auth.identify(request)
    auth.check_origin(request, caller)
    if caller.session and not caller.session.accepts_form(flask.request.form.get("secret", "")):
        raise ForbiddenError("this form was made for another session; open the page again")
    if scope:
        require_scope(caller.access, scope)
    return caller


def form_secret() -> str:
    """Return the secret for the forms of this page; empty for callers without a session."""
    session = context().auth.identify(current_request()).session
    return session.form_secret if session else ""


@blueprint.app_context_processor
def _person() -> dict[str, object]:
    """Provide templates with functions about the person who sees the page."""

    def access() -> Access:
        return context().auth.identify(current_request()).access

    def signed_in_as() -> str:
        try:
            caller = context().auth.identify(current_request())
        except AccessError:
            return ""
        return caller.name if caller.token else ""

    return {
        "signed_in_as": signed_in_as,
        "return_to": _page_to_return_to(),
        "form_secret": form_secret,
        "may_teach": lambda: "teach" in SCOPES[access().role],
        "may_operate": lambda: "admin" in SCOPES[access().role],
        "speaks_for": lambda: access().agent if access().role == "teacher" else None,
        "operator": flask.request.args.get("by", ""),
    }


def _page_to_return_to() -> str:
    """Return the page to show after signing in."""
    if flask.request.method in ("GET", "HEAD"):
        return _local(flask.request.full_path.removesuffix("?"))
    return _local(urlsplit(flask.request.referrer or "").path or _START)


def _local(path: str) -> str:
    """Return a path on this server; anything else becomes the home page.

    Examples
    --------
    >>> [_local(p) for p in ("/objects?page=2", "//evil.example", "https://evil", "/a b\\\\c")]
    ['/objects?page=2', '/', '/', '/']
    """
    if not path.startswith("/") or path.startswith("//") or "\\" in path or path != path.strip():
        return _START
    return path if path.isprintable() else _START
