"""Pages about objects: their views, grasps and outcomes."""

from __future__ import annotations

import flask

from endpoint.http.messages import RefusedError
from endpoint.pages.choosing import by_iri, read_resource
from endpoint.pages.drawn import belief_over, clouds_of, curve, gripper_lines, has_viewer
from endpoint.pages.render import (
    PAGE_SIZE,
    Model,
    blueprint,
    knowledge_base,
    page,
    page_number,
    select,
    select_first,
)
from rtask.engine.curation.merging import present_name
from rtask.engine.memory.statistics import lower_95
from rtask.errors import MissingExtraError
from rtask.extras import naming_extras
from rtask.rdf.namespaces import PROV, RDF, RT
from rtask.rdf.terms import NamedNode, iri, python_value

MAX_GRASPS = 100
MAX_OUTCOMES = MAX_VIEWS = 50
blueprint.add_app_template_filter(curve)


def list_objects(limit: int = PAGE_SIZE, offset: int = 0, chosen: str = "") -> list[Model]:
    """Return objects with an image and their successes, the most tried first.

    Parameters
    ----------
    chosen
        Pattern that selects them; see :mod:`endpoint.pages.choosing`.
    """
    rows = select("objects", limit=limit, offset=offset, chosen=chosen)
    for row in rows:
        _count(row)
        row["classes"] = ", ".join(sorted((row["classes"] or "").split(", ")))
    return rows


def _count(row: Model) -> None:
    """Fill in missing counts and the share of successes."""
    for name in ("views", "grasps", "attempts", "successes"):
        row[name] = int(row.get(name) or 0)
    row["mean"] = row["successes"] / row["attempts"] if row["attempts"] else None


def resolve_object(argument: str) -> str:
    """Return the present name of the object that the address names.

    Raises
    ------
    RefusedError
        400 without a name, 404 if there is no such object, 410 if it was forgotten.
    """
    asked = flask.request.args.get(argument, "").strip()
    if not asked:
        raise RefusedError(400, "usage", f"which object? {flask.request.path}?{argument}=<IRI>")
    kb = knowledge_base()
    name = present_name(kb, read_resource(asked).value)
    if kb.match(name, RDF.type, RT.ManipulableObject):
        return name
    gone = kb.match(name, PROV.invalidatedAtTime)
    if gone:
        when = str(python_value(gone[0].object))[:19]
        raise RefusedError(410, "gone", f"the object {name} was forgotten at {when}; see /curation")
    raise RefusedError(404, "not-found", f"no object {name}; see /objects")


@page("/objects", "objects.html")
def objects() -> Model:
    """Return one page of objects and their number; two queries."""
    number = page_number()
    rows = list_objects(PAGE_SIZE, (number - 1) * PAGE_SIZE)
    total = int(select("object_count")[0]["total"])
    pages = max(1, -(-total // PAGE_SIZE))
    return {"objects": rows, "total": total, "page": number, "pages": pages}


@page("/object", "object.html")
def object_() -> Model:
    """Return the facts, views, grasps and outcomes of one object; four queries."""
    name = resolve_object("iri")
    term = iri(name)
    (facts,) = select("object", object=term)
    grasps, more_grasps = select_first("object_grasps", MAX_GRASPS, object=term)
    for row in grasps:
        _count(row)
    outcomes, more_outcomes = select_first("object_outcomes", MAX_OUTCOMES, object=term)
    views, more_views = select_first("object_views", MAX_VIEWS, object=by_iri([name]))
    return {
        "iri": name,
        **facts,
        "done": flask.request.args.get("done", ""),
        "views": views,
        "grasps": grasps,
        "outcomes": outcomes,
        "all": {"views": more_views, "grasps": more_grasps, "outcomes": more_outcomes},
        **_drawn(term, views, grasps, outcomes),
    }


def _drawn(
    term: NamedNode, views: list[Model], grasps: list[Model], outcomes: list[Model]
) -> Model:
    """Return what is drawn of an object: clouds, grippers, and the belief over its attempts.

    Without the libraries of perception nothing is.
    """
    try:
        with naming_extras("pictures"):
            for grasp in grasps:
                grasp["lower"] = lower_95(grasp["successes"], grasp["attempts"])
                grasp["lines"] = gripper_lines(grasp)
            judged = [row["success"] for row in reversed(outcomes) if row["success"] is not None]
            clouds = clouds_of(term, views)
            return {"clouds": clouds, "belief": belief_over(judged), "viewer": has_viewer()}
    except MissingExtraError:
        return {"clouds": [], "belief": [], "viewer": False}
