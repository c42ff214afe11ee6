"""Page for the terms of the ontology, at the address where programs read their cards."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import flask

import ontology
from endpoint.http.messages import RefusedError
from endpoint.pages.render import Model, context, knowledge_base, page
from endpoint.routes.addresses import TERMS
from endpoint.sparql.questions import select_within
from endpoint.sparql.terms import card_at
from rtask.asking.cards import Card, list_terms
from rtask.errors import UsageError
from rtask.rdf.terms import prologue

__all__ = ["terms"]

SHOWN = 100


@page(TERMS, "terms.html", twin="/terms/card.json")  # the editor reads /terms.json
def terms() -> Model:
    """Return the card of the term in the address, or the terms that have its words."""
    name = flask.request.args.get("term", "").strip()
    words = flask.request.args.get("words", "").strip()
    select = select_within(knowledge_base(), context().config.timeout_s)
    if not name:
        terms = list_terms(select, words)
        lines = [asdict(line) for line in terms[:SHOWN]]
        known = {line.term for line in terms}
        return {
            "card": None, "words": words, "terms": lines, "total": len(terms), "known": known,
        }  # fmt: skip
    try:
        card = card_at(knowledge_base(), select, name)
    except UsageError as error:
        raise RefusedError(400, "bad-request", str(error)) from error
    # Datatypes, and the terms of RDF itself, have no card to lead to.
    known = {line.term for line in list_terms(select, "")}
    return {"card": _shown(card), "words": words, "terms": [], "total": 0, "known": known}


def _shown(card: Card) -> dict[str, Any]:
    """Return a card as data, with the query as the workbench takes it."""
    return {**card.to_dict(), "query": f"{prologue(ontology.PREFIXES)}\n{card.example}"}
