"""Page for questions in words, at the address where programs ask them."""

from __future__ import annotations

from typing import Any

import flask

from endpoint.pages.graph.workbench import samples
from endpoint.pages.render import Model, context, knowledge_base, page
from endpoint.routes.addresses import ASK
from endpoint.sparql.questions import select_within
from rtask.asking.questions import Answer, answer
from rtask.errors import BusyError, GoneError, TooLargeError, UnsupportedError, UsageError
from rtask.rdf.terms import NamedNode, Term, python_value

__all__ = ["ask"]

_REFUSALS = (UsageError, UnsupportedError, GoneError, TooLargeError, BusyError)
"""Why a question is not answered; the last four where it asks about earlier states."""


@page(ASK, "ask.html")
def ask() -> Model:
    """Return the answer to the question in the address, or the questions that can be asked."""
    text = flask.request.args.get("text", "").strip()
    model: Model = {"text": text, "answer": None, "problem": ""}
    if text:
        select = select_within(knowledge_base(), context().config.timeout_s)
        try:
            answered = answer(knowledge_base(), text, select=select)
        except _REFUSALS as error:  # such as too long a text
            return {**model, "problem": str(error), "questions": []}
        model["answer"] = _shown(answered)
    questions = [] if text else [sample["question"] for sample in samples()]
    return {**model, "questions": questions}


def _shown(answered: Answer) -> dict[str, Any]:
    """Return an answer as data, with each cell of its table as it is read."""
    shown = answered.to_dict()
    pages = list(dict.fromkeys(filter(None, answered.why)))
    return {
        **shown,
        # Of several, each number of the table has its own.
        "rests_on": "#rows" if len(pages) > 1 else "".join(pages),
        "cells": [
            [_cell(term, answered, why) for term in row]
            for row, why in zip(answered.rows, answered.why, strict=True)
        ],
    }


def _cell(term: Term | None, answered: Answer, why: str) -> dict[str, str]:
    if term is None:
        return {"text": ""}
    plain = python_value(term)
    if isinstance(plain, int | float) and not isinstance(plain, bool):
        return {"text": f"{plain:.4g}" if isinstance(plain, float) else str(plain), "why": why}
    value = str(plain)
    name = answered.names.get(value, value)
    return {"text": name, "iri": value} if isinstance(term, NamedNode) else {"text": name}
