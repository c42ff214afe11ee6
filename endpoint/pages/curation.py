"""Pages on which people correct objects: merge, split, forget, and undo."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlencode

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.http.messages import RefusedError
from endpoint.pages.choosing import by_iri, by_words, without
from endpoint.pages.objects import MAX_VIEWS, list_objects, resolve_object
from endpoint.pages.render import (
    Model,
    blueprint,
    context,
    current_request,
    embedded_graph,
    page,
    select_first,
)
from endpoint.pages.signin import require_form
from rtask.engine.curation.edit import NOTE
from rtask.engine.operations.curate import CurateObject
from rtask.errors import UnknownTermError
from rtask.wire.forms import read_form
from rtask.wire.message import Answer

_ADDRESS = "/curation"
MAX_CANDIDATES = 24
MAX_LISTED = 50
_RECENT_COMMITS = 2_000


@page("/object/merge", "merge.html")
def merge() -> Model:
    """Return candidates for a merge or, with ``into``, both side by side and how alike they are."""
    subject = resolve_object("iri")
    into, words = flask.request.args.get("into", ""), flask.request.args.get("find", "").strip()
    if not into:
        chosen = f"{by_words(words)} {without(subject)}"
        candidates = list_objects(MAX_CANDIDATES + 1, chosen=chosen)
        return {
            "iri": subject, "object": side(subject), "find": words,
            "found": candidates[:MAX_CANDIDATES], "has_more": len(candidates) > MAX_CANDIDATES,
        }  # fmt: skip
    into = resolve_object("into")
    if into == subject:
        raise RefusedError(422, "usage", f"both names mean {subject}: there is nothing to merge")
    likeness = next(
        (row for row in objects_alike(subject, "").matches if row["object"] == into), None
    )
    return {"iri": subject, "object": side(subject), "into": side(into), "likeness": likeness}


@page("/object/split", "split.html")
def split() -> Model:
    """Return the views to choose from, for a split."""
    subject = resolve_object("iri")
    return {"iri": subject, "object": side(subject)}


@page("/object/forget", "forget.html")
def forget() -> Model:
    """Return what would be forgotten."""
    subject = resolve_object("iri")
    return {"iri": subject, "object": side(subject)}


def side(name: str) -> Model:
    """Return an object with its pictures, to be seen before it is changed; two queries."""
    rows = list_objects(1, chosen=by_iri([name]))
    if not rows:
        raise RefusedError(404, "not-found", f"no object {name}; see /objects")
    pictures, all_views = select_first("object_views", MAX_VIEWS, object=by_iri([name]))
    return {**rows[0], "pictures": pictures, "all_views": all_views}


@dataclass(frozen=True)
class Alike:
    """What looks like an object.

    Parameters
    ----------
    matches
        Objects, the likest first.
    suggestions
        Words of kinds, where the described one is not known.
    views_untried
        Stored views that were not compared: without a match, it is not decided that there is none.
    is_compared
        Whether the object has a view that could be compared.
    """

    matches: list[Model] = field(default_factory=list)
    suggestions: list[str] = field(default_factory=list)
    views_untried: int = 0
    is_compared: bool = True


def objects_alike(subject: str, description: str) -> Alike:
    """Return the objects of the described kind that look like one."""
    caller = context().auth.identify(current_request())
    search_request: dict[str, Any] = {"operation": "search", "object": subject}
    if description:
        search_request["class_description"] = description
    try:
        answer = context().engine.call("teach_object", search_request, caller.access)
    except UnknownTermError:  # nothing was seen of it that can be compared
        return Alike(is_compared=False)
    alike = {row["object"]: row for row in answer["similar_objects"]}
    rows = list_objects(len(alike), chosen=by_iri(alike)) if alike else []
    matches = [
        # The side that looks alike says more than the side that was stored first.
        {
            **row,
            "confidence": alike[row["object"]]["confidence"],
            "why": alike[row["object"]]["why"],
            "image": alike[row["object"]]["picture"] or row["image"],
        }
        for row in rows
    ]
    matches.sort(key=lambda row: -row["confidence"])
    # Of an unknown kind nothing is compared, and the answer has suggestions alone.
    return Alike(matches, answer["suggestions"], answer.get("views_untried", 0))


@page(_ADDRESS, "curation.html")
def curation() -> Model:
    """Return the latest changes by people, the newest first."""
    since = max(0, embedded_graph().seq - _RECENT_COMMITS)
    changes = list_changes(since)
    return {
        "changes": changes[:MAX_LISTED],
        "since": since,
        "has_more": since > 0 or len(changes) > MAX_LISTED,
    }


def list_changes(since: int) -> list[Model]:
    """Return changes by people after a commit, and whether each was undone."""
    kb = embedded_graph()
    entries = [e for e in kb.history(since=since) if (e.note or "").startswith(NOTE)]
    changes = [(entry, (entry.note or "").removeprefix(NOTE)) for entry in entries]
    back = {note.removeprefix("take back ") for _, note in changes if note.startswith("take back ")}
    return [
        {
            "commit": f"c-{entry.seq:05d}",
            "time": entry.time,
            "by": entry.agent or "an operator",
            "what": note,
            "added": len(entry.added),
            "removed": len(entry.removed),
            "taken_back": f"c-{entry.seq:05d}" in back,
        }
        for entry, note in reversed(changes)
    ]


@blueprint.route("/object/curate", methods=["POST"])
def curate() -> WerkzeugResponse:
    """Carry out the change in a form and show the resulting object."""
    fields = read_form(CurateObject, dict(flask.request.form.lists()))
    answer = carry_out("curate_object", fields)
    shown = answer["object"]
    arguments = {"iri": shown} if shown else {}
    if fields["operation"] != "undo":
        arguments["done"] = answer["commit"]
    return back_to("/object" if shown else _ADDRESS, arguments, fields)


def carry_out(operation: str, fields: dict[str, Any]) -> Answer:
    """Call an operation with the fields of a form, for the person who sent it, and audit that.

    Raises
    ------
    ForbiddenError
        The form belongs to another page or session, or the caller may not teach.
    """
    caller = require_form("teach")
    answer = context().engine.call(operation, fields, caller.access)
    what = {"object": fields.get("object"), "commit": answer["commit"], "by": caller.name}
    context().audit.event(fields["operation"], **what)
    return answer


def back_to(address: str, arguments: dict[str, str], fields: dict[str, Any]) -> WerkzeugResponse:
    """Redirect to a page, keeping the name that a person without a token typed."""
    if "operator" in fields:
        arguments = {**arguments, "by": fields["operator"]}
    return flask.redirect(f"{address}?{urlencode(arguments)}" if arguments else address, 303)
