"""Check of what the table of addresses, an operation or a method says that a caller needs."""

from __future__ import annotations

from endpoint.access.auth import Authenticator, Caller, require_scope
from endpoint.http.messages import Request
from endpoint.routes.route import Declared, Right
from endpoint.served import ServedGraph, embedded
from endpoint.settings import Config
from rtask.errors import AuthenticationError, ForbiddenError

__all__ = ["Rights", "authorise", "require_schema"]

_SAFE = ("GET", "HEAD")


class Rights:
    """Checks whether callers may use an address.

    Parameters
    ----------
    auth
        Checks the origin of changes.
    kb
        The graph that is served.
    config
        Where the server is bound.
    """

    def __init__(self, auth: Authenticator, kb: ServedGraph, config: Config) -> None:
        self._auth, self._kb, self._config = auth, kb, config

    def require(self, right: Right | Declared, request: Request, caller: Caller) -> None:
        """Refuse a caller that lacks a right.

        A request that changes something must not come from a page of another origin either. What
        declares its right itself is checked by its handler.

        Raises
        ------
        AuthenticationError
            No token was sent, and one might help.
        ForbiddenError
            The caller lacks the right, or the Origin is foreign.
        UnsupportedError
            The graph is stored at another server, which knows no such right.
        """
        if right == "declared":
            return
        if request.method not in _SAFE and (request.method != "POST" or right != "read"):
            self._auth.check_origin(request, caller)
        match right:
            case "write":
                self._auth.require_write(request, caller)
            case "rules":
                self._require_rules(caller)
            case "schema":
                self._auth.require_write(request, caller)
                require_schema(caller)
            case "replicate":
                _require_replicate(caller)
            case "token":
                if caller.token is None:
                    raise AuthenticationError(
                        "a ticket stands for a token: sign in, or send a bearer token"
                    )
            case "admin":
                _require_admin(caller)
            case "monitor":
                # The metrics name nobody, so that a collector on this machine needs no token.
                if not (self._config.on_loopback and caller.token is None):
                    _require_admin(caller)
            case "read" | "public":
                pass

    def _require_rules(self, caller: Caller) -> None:
        if caller.token is None and caller.access.role == "reader":
            raise AuthenticationError("rules need a token; send Authorization: Bearer <token>")
        kb = embedded(self._kb, "the reasoner")
        bound = caller.access.bind(kb.graphs, kb.catalogue.is_ontology, kb.plain)
        bound.require_write(kb.graphs.rules, "rules")


def authorise(auth: Authenticator, request: Request, caller: Caller, scope: str, name: str) -> None:
    """Refuse a caller that may not carry out what declares a scope.

    Raises
    ------
    AuthenticationError
        It needs a token, and none came.
    ForbiddenError
        The caller's role lacks the scope, or a page of another origin asks.
    """
    auth.check_origin(request, caller)
    if caller.token is None and caller.access.role == "reader" and scope != "read":
        raise AuthenticationError(f"{name} needs a token; send Authorization: Bearer <token>")
    require_scope(caller.access, scope)


def require_schema(caller: Caller) -> None:
    """Refuse a caller that may not decide about proposals.

    Raises
    ------
    ForbiddenError
        It has no right `schema`.
    """
    if not caller.access.may_decide:
        raise ForbiddenError(
            "deciding about proposals needs the right schema, which an admin has", right="schema"
        )


def _require_replicate(caller: Caller) -> None:
    access = caller.access
    if access.role not in ("admin", "anonymous") and "replicate" not in access.rights:
        raise ForbiddenError(
            "copying the knowledge base needs the right replicate: rtask token create --role "
            "reader --right replicate"
        )


def _require_admin(caller: Caller) -> None:
    if caller.access.role != "anonymous":
        require_scope(caller.access, "admin")
