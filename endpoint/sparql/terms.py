"""Terms of the ontology at ``/terms``: a list of classes and properties, or the card of one."""

from __future__ import annotations

import json
from dataclasses import asdict

from endpoint.access.auth import Caller
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan, RunningQuery
from endpoint.routes.addresses import TERMS
from endpoint.served import ServedGraph
from endpoint.sparql.questions import select_within
from rtask.asking.cards import Card, card_of, find_term, list_terms
from rtask.asking.questions.mentions import Select
from rtask.errors import UnknownTermError

__all__ = ["card_at", "plan_terms"]


def plan_terms(kb: ServedGraph, request: Request, caller: Caller, timeout_s: float) -> Plan:
    """Plan the card of the class or property ``term``, or the terms that have all ``words``.

    Parameters
    ----------
    timeout_s
        Time limit of all queries together.
    """
    name = (request.values("term") or [""])[-1].strip()
    words = (request.values("words") or [""])[-1]
    text = f"term {name}" if name else f"terms {words}"
    running = RunningQuery(request.id, caller.key, caller.name, text, timeout_s)

    def run() -> Response:
        select = select_within(kb, timeout_s, running)
        body = (
            card_at(kb, select, name).to_dict()
            if name
            else {"terms": [asdict(line) for line in list_terms(select, words)]}
        )
        data = json.dumps(body, ensure_ascii=False).encode()
        return Response(200, data, JSON_TYPE)

    return Plan(run, timeout_s, lane="query", form="TERMS", text=text, running=running)


def card_at(kb: ServedGraph, select: Select, name: str) -> Card:
    """Return the card of a term by what the address says.

    Raises
    ------
    RefusedError
        404 if there is no such class or property.
    UsageError
        Several terms have the name, or the text is no term.
    """
    try:
        return card_of(select, find_term(select, name, kb.base))
    except UnknownTermError as error:
        raise RefusedError(404, "not-found", f"{error}; {TERMS} lists them") from error
