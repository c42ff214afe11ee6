"""Objects: how they look, how they were grasped, and what came of it."""

from __future__ import annotations

import flask

from endpoint.exchange import RefusedError
from endpoint.pages.render import PAGE_SIZE, Model, page, page_number, select
from rtask.kb.terms import iri


def list_objects(limit: int = PAGE_SIZE, offset: int = 0) -> list[Model]:
    """Return objects, the most tried first, with an image and how often they were held."""
    rows = select("objects", limit=limit, offset=offset)
    for row in rows:
        _count(row)
    return rows


def _count(row: Model) -> None:
    """Put numbers where the graph has none, and the share of successes."""
    for name in ("views", "grasps", "attempts", "successes"):
        row[name] = int(row.get(name) or 0)
    row["mean"] = row["successes"] / row["attempts"] if row["attempts"] else None


@page("/objects", "objects.html")
def objects() -> Model:
    """Two queries: one page of objects, and how many there are."""
    number = page_number()
    rows = list_objects(PAGE_SIZE, (number - 1) * PAGE_SIZE)
    total = int(select("object_count")[0]["total"])
    pages = max(1, -(-total // PAGE_SIZE))
    return {"objects": rows, "total": total, "page": number, "pages": pages}


@page("/object", "object.html")
def object_() -> Model:
    """Four queries: facts, views, grasps, outcomes."""
    name = flask.request.args.get("iri", "")
    if not name:
        raise RefusedError(400, "usage", "which object? /object?iri=<IRI>")
    term = iri(name)
    facts = select("object", object=term)
    if not facts:
        raise RefusedError(404, "not-found", f"no object {name}; see /objects")
    grasps = select("object_grasps", object=term)
    for row in grasps:
        _count(row)
    return {
        "iri": name,
        **facts[0],
        "views": select("object_views", object=term),
        "grasps": grasps,
        "outcomes": select("object_outcomes", object=term),
    }
