"""Pages about robots: all of them, and what one is, has, tried and saw last."""

from __future__ import annotations

from collections import Counter

import flask

from endpoint.http.messages import RefusedError
from endpoint.pages.drawn import belief_over
from endpoint.pages.feedback import list_attempts
from endpoint.pages.render import Model, context, knowledge_base, page, select
from rtask.rdf.namespaces import CORA, RDF
from rtask.rdf.terms import iri

__all__ = ["list_robots"]

_SHOWN_ATTEMPTS = 12
_SHOWN_REASONS = 5


def list_robots() -> list[Model]:
    """Return each robot with its last outcome."""
    rows: dict[str, Model] = {}
    for row in select("robots", chosen=""):
        rows.setdefault(str(row["robot"]), _counted(row))
    return list(rows.values())


def _counted(row: Model) -> Model:
    attempts, successes = int(row.get("attempts") or 0), int(row.get("successes") or 0)
    mean = successes / attempts if attempts else None
    return {**row, "attempts": attempts, "successes": successes, "mean": mean}


@page("/robots", "robots.html")
def robots() -> Model:
    """Return all robots; one query."""
    return {"robots": list_robots()}


@page("/robot", "robot.html")
def robot() -> Model:
    """Return what a robot is, its hands and cameras, its tasks and their success; four queries."""
    asked = flask.request.args.get("iri", "")
    if not asked:
        raise RefusedError(400, "usage", f"which robot? {flask.request.path}?iri=<IRI>")
    term = iri(asked)
    if not knowledge_base().match(term, RDF.type, CORA.Robot):
        raise RefusedError(404, "not-found", f"no robot {asked}; see /robots")
    facts = _counted(select("robots", chosen=f"VALUES ?robot {{ {term} }}")[0])
    parts = select("robot", robot=term)
    outcomes = select("robot_outcomes", robot=term)
    reasons = Counter(row["reason"] for row in outcomes if row["reason"] and not row["success"])
    attempts = list_attempts(f"?attempt rt:performedBy {term}")[:_SHOWN_ATTEMPTS]
    lane = context().activity.lane(str(facts["name"] or ""))
    return {
        **facts,
        "hands": [part for part in parts if part["is_hand"]],
        "cameras": [part for part in parts if not part["is_hand"]],
        "belief": belief_over([bool(row["success"]) for row in reversed(outcomes)]),
        "reasons": reasons.most_common(_SHOWN_REASONS),
        "tasks": attempts,
        "connections": lane.connections if lane else 0,
        "doing": lane.doing if lane else "",
        "frame": lane.frame if lane else 0,
    }
