"""The addresses of the reasoner: rules of the user."""

from __future__ import annotations

import json
from typing import Any

from endpoint.access.auth import Authenticator, Caller
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan
from rtask.errors import AuthenticationError, UsageError
from rtask.kb.rules.rule import Rule
from rtask.kb.rules.rulebook import find
from rtask.knowledge_base import KnowledgeBase

ADDRESS = "/reasoner/"
RULES = ADDRESS + "rules"
SPARQL_TYPE = "application/sparql-query"
_FIELDS = ("label", "text", "comment", "replace")


def methods_of(address: str) -> tuple[str, ...]:
    """Return the methods that an address takes; none where there is nothing.

    >>> methods_of("/reasoner/rules"), methods_of("/reasoner/rules/heavy")
    (('GET', 'HEAD', 'POST'), ('GET', 'HEAD', 'DELETE'))
    """
    if address == RULES:
        return ("GET", "HEAD", "POST")
    if address.startswith(RULES + "/"):
        return ("GET", "HEAD", "DELETE")
    return ()


def plan_reasoner(kb: KnowledgeBase, auth: Authenticator, request: Request, caller: Caller) -> Plan:
    """Plan the answer to a request to the reasoner.

    Raises
    ------
    RefusedError
        404, 405, 415.
    AuthenticationError
        A change needs a token, and none was sent.
    """
    address = request.path.rstrip("/")
    methods = methods_of(address)
    if not methods:
        raise RefusedError(404, "not-found", f"there is nothing at {address}; see /openapi")
    if request.method not in methods:
        allow = (("Allow", ", ".join(methods)),)
        raise RefusedError(405, "method-not-allowed", f"use {' or '.join(methods)}", headers=allow)
    name = address.removeprefix(RULES).removeprefix("/")
    if request.method == "POST":
        _require_author(auth, request, caller)
        return Plan(lambda: _add(kb, request, caller))
    if request.method == "DELETE":
        _require_author(auth, request, caller)
        return Plan(lambda: _remove(kb, name, request, caller))
    return Plan(lambda: _json(_one(kb, name).to_dict() if name else {"rules": _all(kb)}))


def _require_author(auth: Authenticator, request: Request, caller: Caller) -> None:
    """Refuse callers without a token before anything else; the knowledge base decides the rest."""
    auth.check_origin(request, caller)
    if caller.token is None and caller.access.role == "reader":
        raise AuthenticationError("rules need a token; send Authorization: Bearer <token>")


def _all(kb: KnowledgeBase) -> list[dict[str, Any]]:
    return [rule.to_dict() for rule in kb.rules()]


def _one(kb: KnowledgeBase, name: str) -> Rule:
    """Return a rule by its label, its IRI or the last part of that."""
    rules = kb.rules()
    for rule in rules:
        if rule.iri is not None and rule.iri.value.rpartition("/rule/")[2] == name:
            return rule
    wanted = find(rules, name)
    return next(rule for rule in rules if rule.iri == wanted)


def _add(kb: KnowledgeBase, request: Request, caller: Caller) -> Response:
    rule, replace = _sent(request)
    note = caller.note(request)
    commit = kb.add_rules([rule], access=caller.access, replace=replace, note=note)
    made = _one(kb, rule.label.strip())
    location = RULES + "/" + (made.iri.value.rpartition("/rule/")[2] if made.iri else "")
    body = {**made.to_dict(), "commit": commit.seq, "derived": commit.derived}
    return _json(body, 201, (("Location", location),))


def _remove(kb: KnowledgeBase, name: str, request: Request, caller: Caller) -> Response:
    caller.access.bind(kb.graphs, kb.catalogue.is_ontology, kb.plain).require_write(
        kb.graphs.rules, "rules"
    )
    rule = _one(kb, name)
    commit = kb.remove_rules(rule.label, access=caller.access, note=caller.note(request))
    return _json({"removed": rule.label, "commit": commit.seq})


def _sent(request: Request) -> tuple[Rule, bool]:
    """Return the rule of a request, and whether it replaces one of the same label."""
    media_type, _ = request.content_type
    if media_type == SPARQL_TYPE:
        label = (request.values("label") or [""])[-1]
        try:
            text = request.body.decode()
        except UnicodeDecodeError:
            raise UsageError("the rule is not UTF-8 text") from None
        return Rule(label, text), "1" in request.values("replace")
    if media_type != JSON_TYPE:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"send a rule as {JSON_TYPE} with label and text, or as {SPARQL_TYPE} with ?label=",
            headers=(("Accept-Post", f"{JSON_TYPE}, {SPARQL_TYPE}"),),
        )
    try:
        sent = json.loads(request.body)
    except (ValueError, RecursionError):
        raise UsageError("not JSON that can be read") from None
    if not isinstance(sent, dict) or not isinstance(sent.get("text"), str):
        raise UsageError("a rule is one JSON object with label and text")
    unknown = sorted(set(sent) - set(_FIELDS))
    if unknown:
        raise UsageError(f"unknown field {unknown[0]!r}; one of {', '.join(_FIELDS)}")
    label, comment = sent.get("label", ""), sent.get("comment", "")
    if not isinstance(label, str) or not isinstance(comment, str):
        raise UsageError("label and comment are text")
    return Rule(label, sent["text"], comment), sent.get("replace") is True


def _json(
    value: dict[str, Any], status: int = 200, headers: tuple[tuple[str, str], ...] = ()
) -> Response:
    return Response(status, json.dumps(value).encode(), JSON_TYPE, headers)
