"""Questions in words at ``/ask``: the nearest of the ontology's questions, with its answer."""

from __future__ import annotations

import json
import time

from endpoint.access.auth import Caller
from endpoint.http.messages import JSON_TYPE, Request, Response
from endpoint.http.plan import Plan, RunningQuery
from endpoint.routes.addresses import ASK
from endpoint.served import ServedGraph
from rtask.asking.questions import answer
from rtask.asking.questions.mentions import Select
from rtask.errors import QueryTimeout, UsageError
from rtask.sparql.results import Solutions

__all__ = ["plan_question", "select_within"]


def plan_question(kb: ServedGraph, request: Request, caller: Caller, timeout_s: float) -> Plan:
    """Plan the answer to the question that the address has as ``text``.

    Parameters
    ----------
    timeout_s
        Time limit of all its queries together.

    Raises
    ------
    UsageError
        There is no text.
    """
    text = (request.values("text") or [""])[-1]
    if not text.strip():
        raise UsageError(f"which question? {ASK}?text=WORDS")
    running = RunningQuery(request.id, caller.key, caller.name, text, timeout_s)

    def run() -> Response:
        body = answer(kb, text, select=select_within(kb, timeout_s, running)).to_dict()
        data = json.dumps(body, ensure_ascii=False, default=str).encode()
        return Response(200, data, JSON_TYPE)

    return Plan(run, timeout_s, lane="query", form="QUESTION", text=text, running=running)


def select_within(kb: ServedGraph, timeout_s: float, running: RunningQuery | None = None) -> Select:
    """Return what evaluates the queries of one question, within one time limit for all of them.

    Parameters
    ----------
    running
        Once it is stopped, no further query is begun.
    """
    end = time.monotonic() + timeout_s

    def select(query: str) -> Solutions:
        left = end - time.monotonic()
        if left <= 0 or (running is not None and running.stopped):
            raise QueryTimeout(f"no answer within {timeout_s:g} s", timeout_s=timeout_s)
        return kb.select(query, timeout_s=left)

    return select
