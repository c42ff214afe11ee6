"""The addresses of the reasoner: rules of the user, proofs, entailment, contradictions."""

from __future__ import annotations

from itertools import islice
from typing import Any, NamedTuple

from pyoxigraph import RdfFormat

from endpoint.access.auth import Caller
from endpoint.api.operations import json_object
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.routes.addresses import RULES
from endpoint.routes.reasoning import BUDGET, MAX_BUDGET, SPARQL_TYPE
from rtask.asking.decisions import explain
from rtask.asking.terms import reader_of
from rtask.errors import TooLargeError, UsageError
from rtask.kb.rules.rule import Rule
from rtask.kb.rules.rulebook import find
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.documents import Document
from rtask.rdf.formats import find_format, statements
from rtask.rdf.terms import TripleKey, triple_key

CAUSES_MS = 500.0

MAX_CONCLUSION = 1_000
MAX_RULES = 1_000
_FIELDS = ("label", "text", "comment", "replace")


def plan_explain(kb: KnowledgeBase, request: Request) -> Plan:
    """Plan the proof of a statement, or what it lacks.

    Raises
    ------
    UsageError
        A parameter is missing, or is not what is expected.
    """
    triple, budget = _triple(kb, request), _budget(request)
    return Plan(lambda: json_response(explain(kb, triple, budget).to_dict()))


def plan_entails(kb: KnowledgeBase, request: Request) -> Plan:
    """Plan whether a statement, or a document of them, follows.

    Raises
    ------
    RefusedError
        415.
    UsageError, TooLargeError
        The statements cannot be read, or are too many.
    """
    conclusion, budget = _conclusion(kb, request), _budget(request)
    return Plan(lambda: json_response(kb.entails(conclusion, budget=budget).to_dict()))


def plan_contradictions(kb: KnowledgeBase) -> Plan:
    """Plan the list of contradictions."""
    return Plan(lambda: _contradictions(kb))


def plan_rules(kb: KnowledgeBase, request: Request, caller: Caller) -> Plan:
    """Plan the list of rules, one of them, or a change to them; the caller has the right to it.

    Raises
    ------
    UsageError
        No rule is named.
    """
    name = request.path.rstrip("/").removeprefix(RULES).removeprefix("/")
    if request.method == "POST":
        return Plan(lambda: _add(kb, request, caller))
    if request.method == "DELETE":
        if name:
            return Plan(lambda: _remove(kb, [name], request, caller))
        names = request.values("label")
        if not names:
            raise UsageError(f"name the rules to remove: DELETE {RULES}?label=<label>")
        return Plan(lambda: _remove(kb, names, request, caller))
    return Plan(
        lambda: json_response(_rule_named(kb, name).to_dict() if name else {"rules": _all(kb)})
    )


def _all(kb: KnowledgeBase) -> list[dict[str, Any]]:
    return [rule.to_dict() for rule in kb.rules()]


def _rule_named(kb: KnowledgeBase, name: str) -> Rule:
    """Return a rule by its label, its IRI or the last part of that."""
    rules = kb.rules()
    for rule in rules:
        # The last part of an IRI goes first: it is what Location named, and another rule may have
        # it as its label.
        if rule.iri is not None and rule.iri.value.rpartition("/rule/")[2] == name:
            return rule
    match = find(rules, name)
    return next(rule for rule in rules if rule.iri == match)


def _add(kb: KnowledgeBase, request: Request, caller: Caller) -> Response:
    sent = _sent(request)
    note = caller.note(request)
    commit = kb.add_rules(sent.rules, access=caller.access, replace=sent.replace, note=note)
    # Read back: the store may have given another IRI than the label suggests.
    made = [_rule_named(kb, rule.label.strip()) for rule in sent.rules]
    facts = {"commit": commit.seq, "derived": commit.derived, "changed": commit.added > 0}
    if sent.several:
        return json_response({"rules": [rule.to_dict() for rule in made], **facts}, 201)
    (rule,) = made
    location = RULES + "/" + (rule.iri.value.rpartition("/rule/")[2] if rule.iri else "")
    return json_response({**rule.to_dict(), **facts}, 201, (("Location", location),))


def _remove(kb: KnowledgeBase, names: list[str], request: Request, caller: Caller) -> Response:
    labels = [_rule_named(kb, name).label for name in names]
    commit = kb.remove_rules(labels, access=caller.access, note=caller.note(request))
    # One rule in the path is answered by itself, a list of ?label= by a list, however many it has.
    removed = labels if request.values("label") else labels[0]
    return json_response({"removed": removed, "commit": commit.seq, "withdrawn": commit.withdrawn})


def _triple(kb: KnowledgeBase, request: Request) -> TripleKey:
    """Return the statement that the parameters s, p and o name."""
    texts = []
    for name in "spo":
        given = request.values(name)
        if len(given) != 1 or not given[0].strip():
            raise UsageError(f"{name} is needed once: an IRI, a prefixed name or another term")
        texts.append(given[0])
    return reader_of(kb).statement(*texts)


def _budget(request: Request) -> int:
    """Return the steps that a request asks for."""
    given = (request.values("budget") or [str(BUDGET)])[-1]
    # isdecimal alone takes the digits of every script; ten are looked at, since int() of a million
    # is slow.
    if not (given.isascii() and given.isdecimal()) or not 1 <= int(given[:10]) <= MAX_BUDGET:
        raise UsageError(
            f"budget is a whole number of steps from 1 to {MAX_BUDGET}, got {given[:20]!r}; "
            "`rtask explain --budget` on the folder takes more"
        )
    return int(given)


def _conclusion(kb: KnowledgeBase, request: Request) -> list[TripleKey]:
    """Return the statements to test: of the parameters, or of an RDF document in the body."""
    if request.method != "POST":
        return [_triple(kb, request)]
    media_type, _ = request.content_type
    if media_type == JSON_TYPE:
        form, data = RdfFormat.TURTLE, _text_of(request)
    else:
        named = RdfFormat.from_media_type(media_type)
        if named is None:
            raise RefusedError(
                415,
                "unsupported-media-type",
                "send the statements in an RDF format, such as text/turtle, or as JSON with text",
                headers=(("Accept-Post", f"text/turtle, application/n-triples, {JSON_TYPE}"),),
            )
        form, data = named, request.body
    document = Document("<body>", data=data)
    # One more than may be, to tell a full document from a longer one without reading that.
    quads = list(islice(statements(document, find_format(form)), MAX_CONCLUSION + 1))
    if len(quads) > MAX_CONCLUSION:
        raise TooLargeError(
            f"at most {MAX_CONCLUSION} statements are tested at once; `rtask entails` takes more",
            limit="statements",
            allowed=MAX_CONCLUSION,
        )
    return [triple_key(quad) for quad in quads]


def _text_of(request: Request) -> bytes:
    """Return the Turtle document that a JSON object carries under ``text``."""
    sent = json_object(request)
    if set(sent) != {"text"} or not isinstance(sent["text"], str):
        raise UsageError("expected one JSON object with text: the statements as Turtle")
    return sent["text"].encode()


def _contradictions(kb: KnowledgeBase) -> Response:
    return json_response(
        {
            "contradictions": [contradiction.message for contradiction in kb.contradictions()],
            "causes": kb.causes(CAUSES_MS),
        }
    )


class _Sent(NamedTuple):
    """The rules of a request; one that is sent by itself is answered by itself."""

    rules: list[Rule]
    replace: bool
    several: bool = False


def _sent(request: Request) -> _Sent:
    media_type, _ = request.content_type
    if media_type == SPARQL_TYPE:
        label = (request.values("label") or [""])[-1]
        try:
            text = request.body.decode()
        except UnicodeDecodeError:
            raise UsageError("the rule is not UTF-8 text") from None
        return _Sent([Rule(label, text)], "1" in request.values("replace"))
    if media_type != JSON_TYPE:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"send a rule as {JSON_TYPE} with label and text, or as {SPARQL_TYPE} with ?label=",
            headers=(("Accept-Post", f"{JSON_TYPE}, {SPARQL_TYPE}"),),
        )
    sent = json_object(request)
    # A text such as "no" would be true.
    replace = sent.get("replace") is True
    if "rules" not in sent:
        return _Sent([_rule(sent, _FIELDS)], replace)
    _check_fields(sent, ("rules", "replace"))
    given = sent["rules"]
    if not isinstance(given, list) or not given:
        raise UsageError("rules is a list of objects with label and text")
    if len(given) > MAX_RULES:
        raise TooLargeError(
            f"at most {MAX_RULES} rules are added at once", limit="rules", allowed=MAX_RULES
        )
    return _Sent([_rule(rule, _FIELDS[:3]) for rule in given], replace, several=True)


def _rule(sent: Any, fields: tuple[str, ...]) -> Rule:
    if not isinstance(sent, dict) or not isinstance(sent.get("text"), str):
        raise UsageError("a rule is one JSON object with label and text")
    _check_fields(sent, fields)
    label, comment = sent.get("label", ""), sent.get("comment", "")
    if not isinstance(label, str) or not isinstance(comment, str):
        raise UsageError("label and comment are text")
    return Rule(label, sent["text"], comment)


def _check_fields(sent: dict[str, Any], fields: tuple[str, ...]) -> None:
    unknown = sorted(set(sent) - set(fields))
    if unknown:
        raise UsageError(f"unknown field {unknown[0]!r}; one of {', '.join(fields)}")
