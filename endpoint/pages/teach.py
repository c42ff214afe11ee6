"""Pages on which people name the objects that robots met."""

from __future__ import annotations

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.pages.choosing import by_words, unnamed, without
from endpoint.pages.curation import back_to, carry_out, objects_alike, side
from endpoint.pages.objects import list_objects, resolve_object
from endpoint.pages.render import Model, blueprint, context, page
from rtask.engine.engine import Engine
from rtask.engine.operations.teach import TeachObject
from rtask.engine.terms import folded
from rtask.wire.forms import read_form

_ADDRESS = "/teach"
MAX_CANDIDATES = 12


@page(_ADDRESS, "teach.html")
def teach() -> Model:
    """Return the unnamed objects or, with ``iri``, one of them and what it may be."""
    if "iri" not in flask.request.args:
        return {"unnamed": list_objects(chosen=unnamed())}
    subject = resolve_object("iri")
    name, description = (
        " ".join(flask.request.args.get(field, "").split()) for field in ("name", "description")
    )
    model: Model = {
        "iri": subject,
        "object": side(subject),
        "name": name,
        "description": description,
    }
    if name or description:
        return {**model, **_candidates(subject, name, description)}
    alike = objects_alike(subject, "")
    return {
        **model,
        "candidates": alike.matches,
        "untried": alike.views_untried,
        "is_compared": alike.is_compared,
    }


def _candidates(subject: str, name: str, description: str) -> Model:
    """Return the objects and kinds that match the words, those that look alike first."""
    found = objects_alike(subject, description)
    alike = found.matches
    seen = {candidate["object"] for candidate in alike}
    worded = [
        candidate
        for words in (name, description)
        if words
        for candidate in list_objects(
            MAX_CANDIDATES + 1, chosen=f"{by_words(words)} {without(subject)}"
        )
    ]
    for candidate in worded:
        if candidate["object"] not in seen:
            seen.add(candidate["object"])
            alike.append(candidate)
    kinds = _engine().classes.find(description) if description else []
    folded_words = folded(description)
    return {
        "candidates": alike[:MAX_CANDIDATES],
        # Of those with these words one more than is shown is read, so that a cut is seen.
        "has_more": len(alike) > MAX_CANDIDATES,
        "untried": found.views_untried,
        "suggestions": found.suggestions,
        "kinds": [kind.label for kind in kinds],
        "is_known_kind": any(folded_words in map(folded, kind.names) for kind in kinds),
    }


def _engine() -> Engine:
    engine = context().engine
    assert isinstance(engine, Engine)  # another has no objects to name
    return engine


@blueprint.route(_ADDRESS, methods=["POST"])
def name_it() -> WerkzeugResponse:
    """Store a name and a kind, and show the object."""
    given = dict(flask.request.form.lists())
    fields = {**read_form(TeachObject, given), "operation": "teach"}
    answer = carry_out("teach_object", fields)
    done = {"done": answer["commit"]} if answer["commit"] else {}
    return back_to("/object", {"iri": fields.get("object", ""), **done}, fields)
